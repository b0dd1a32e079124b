"""Files: written so that they appear under their name only when they are complete; TOML read and written."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vision.errors import VisionError


def temporary_name(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.part")


def remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        # the folder itself may be missing or read-only, then nothing was written
        return


@contextmanager
def whole_file(path: Path, error: type[VisionError], advice: str) -> Iterator[Path]:
    """Context manager: yields a temporary name to write to, which becomes ``path`` when the block ends without an
    exception and is removed otherwise; an `OSError` is raised as ``error`` with ``advice``."""
    temporary = temporary_name(path)
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as problem:
        raise error(f"{path}: cannot be written ({problem.strerror or problem}); {advice}") from None
    finally:
        remove(temporary)


def read_toml(path: Path, error: type[VisionError], advice: str) -> dict[str, Any]:
    """What a TOML file holds; ``error`` with the reason and ``advice`` where it cannot be read."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror or problem}); {advice}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise error(f"{path}: not valid TOML ({problem}); {advice}") from None


def toml_text(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}" for c in escaped) + '"'
