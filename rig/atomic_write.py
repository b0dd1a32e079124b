"""Files that are written whole or not at all, hashes of their contents, and the errors of the file system."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

from rig import platform_calls
from rig.errors import RigInputError


@contextlib.contextmanager
def translate_os_error(path: Path, action: str, advice: str = "") -> Iterator[None]:
    """Turn an OSError in the block into :class:`rig.errors.RigInputError`: ``path: cannot be <action> (reason)``."""
    try:
        yield
    except OSError as error:
        reason = f"({error.strerror or error})"
        raise RigInputError(f"{path}: cannot be {action} {reason}{advice and '; '}{advice}") from error


@contextlib.contextmanager
def replace_when_complete(path: Path) -> Iterator[Path]:
    """Context that yields a temporary path, beside ``path``, to write a file to; at its end the file replaces ``path``,
    after an exception it is deleted. OSError becomes RigInputError."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with translate_os_error(path, "written", "choose a writable place"):
            yield temporary
            with temporary.open("rb+") as stream:
                platform_calls.synchronise_whole(stream.fileno())
            platform_calls.replace(temporary, path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file as UTF-8 with Unix line ends, whole or not at all."""
    with replace_when_complete(path) as temporary:
        temporary.write_bytes(text.encode("utf-8"))


def sha256_of_bytes(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def sha256_of_file(path: Path) -> str:
    with translate_os_error(path, "read"), path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
