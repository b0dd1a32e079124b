"""The seal of an HDF5 file: the SHA-256 of all its bytes, one line of text after the last byte of HDF5.

A sealed file is written whole, and never opened when a single byte has changed: the HDF5 library may crash the process
on damaged metadata, so the seal is checked before the library sees the file. The library and netCDF-4 tools ignore it.

A program that opens the file for writing and closes it unchanged cuts the seal off (the library truncates the file to
its own length). Such a file is read as long as its content still has the SHA-256 that its root states; that is found
out in a process of its own, which a damaged file may crash. One that is killed while it has the file open leaves a mark
in the header, that the file is in use: such a file is read as well. `seal_again` restores seal and header.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
from numpy.typing import NDArray

from rig import platform_calls
from rig.atomic_write import replace_when_complete, translate_os_error
from rig.errors import RigInputError

MARK = b"\npiano-action-rig sha256 "
_TAIL = len(MARK) + len(hashlib.sha256().hexdigest()) + 1
_CHUNK = 1 << 20
CONTENT = "sha256"
"""Attribute of the root: SHA-256 of the content."""
BOOKKEEPING = (
    "CLASS",
    "NAME",
    "DIMENSION_LIST",
    "REFERENCE_LIST",
    "_Netcdf4Coordinates",
    "_Netcdf4Dimid",
    "_NCProperties",
)
"""Attributes that HDF5 and netCDF-4 write by themselves."""
SIGNATURE = b"\x89HDF\r\n\x1a\n"
NOT_AS_SEALED = "has no seal at its end and is not what was sealed: truncated, or altered; restore it from a copy"
OPEN_ELSEWHERE = "another program has it open for writing; close it there"


class _Patient(io.RawIOBase):
    """A file whose failures wait until it is closed: on a full disk the library would leave objects it cannot close."""

    def __init__(self, stream: io.FileIO) -> None:
        self._stream = stream
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of ``data`` to the stream; an OSError is kept in ``error`` instead of raised, and nothing is
        written from then on. Returns the size of ``data`` in any case: HDF5 must not see the failure."""
        left = memoryview(data).cast("B")
        size = left.nbytes
        try:
            while left and self.error is None:
                left = left[self._stream.write(left) or 0 :]
        except OSError as error:
            self.error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Cut or extend the file, or remember why not."""
        try:
            return self._stream.truncate(size)
        except OSError as error:
            self.error = self.error or error
        return size or 0

    def readinto(self, buffer: Any) -> int:
        return self._stream.readinto(buffer) or 0

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._stream.seek(offset, whence)

    def tell(self) -> int:
        return self._stream.tell()


@contextlib.contextmanager
def write_sealed(path: Path) -> Iterator[h5py.File]:
    """Context that yields an empty HDF5 file to fill; at its end a line with the SHA-256 is appended and the file
    replaces the one at ``path``; after an exception ``path`` is as before."""
    with replace_when_complete(path) as temporary, temporary.open("xb+", buffering=0) as stream:
        patient = _Patient(stream)
        with h5py.File(patient, "w", track_order=True) as file:
            yield file
        if patient.error is not None:
            raise patient.error
        stream.seek(0)
        digest = hashlib.sha256()
        while chunk := stream.read(_CHUNK):
            digest.update(chunk)
        mark = MARK + digest.hexdigest().encode() + b"\n"
        if stream.write(mark) != len(mark):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextlib.contextmanager
def open_sealed(path: Path) -> Iterator[h5py.File]:
    """Context that yields a sealed HDF5 file for reading, once its content is found to be as it was sealed;
    RigInputError for one that was altered, cannot be read, or is being written.

    A file without its seal is read, with one warning, where its content is as it was sealed. One that another program
    has locked is read from memory.
    """
    has_seal = _check_seal(path)
    try:
        with _open_locked_or_not(path, has_seal) as file:
            yield file
    except RigInputError:
        raise
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        if platform_calls.is_locked(error):
            raise RigInputError(f"{path}: {OPEN_ELSEWHERE}") from error
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RigInputError(f"{path}: not a file of this program or version ({reason})") from error


def _open_locked_or_not(path: Path, has_seal: bool) -> h5py.File:
    """Open an HDF5 file for reading; one that another program holds locked is read into memory, if it ``has_seal`` and
    that is right, else RigInputError."""
    try:
        return h5py.File(path, "r")
    except OSError as error:
        if not (has_seal and platform_calls.is_locked(error)):
            raise
    whole = path.read_bytes()
    if not whole.endswith(MARK + hashlib.sha256(whole[:-_TAIL]).hexdigest().encode() + b"\n"):
        raise RigInputError(f"{path}: {OPEN_ELSEWHERE}")
    return h5py.File(io.BytesIO(whole), "r")


def _check_seal(path: Path) -> bool:
    """Whether the file ends with a seal; RigInputError where its content is not as sealed; warn where only the seal is
    missing, or only the mark of an open file in its header differs."""
    try:
        with path.open("rb") as stream:
            size = stream.seek(0, 2)
            stream.seek(max(size - _TAIL, 0))
            tail = stream.read()
            if not tail.startswith(MARK) or len(tail) != _TAIL:
                _check_content(path)
                return False
            stated, found = tail[len(MARK) : -1].decode("ascii", "replace"), _hash_sealed(stream, size)
            is_marked = stated != found and _hash_sealed(stream, size, is_unmarked=True) == stated
    except OSError as error:
        if platform_calls.is_locked(error):
            raise RigInputError(f"{path}: {OPEN_ELSEWHERE}") from error
        raise RigInputError(f"{path}: cannot be read ({error.strerror or error})") from error
    if stated != found:
        if platform_calls.is_held(path):
            raise RigInputError(f"{path}: {OPEN_ELSEWHERE}")
        if not is_marked:
            raise RigInputError(f"{path}: altered since it was sealed (SHA-256 does not match); restore it from a copy")
        _warn(path, "another program was ended while it had it open for writing; but for that mark in its header")
    return True


_IN_USE = slice(20, 24)
"""Bytes of a header of version 0 or 1 in which the HDF5 library marks a file that is open for writing."""


def _hash_sealed(stream: BinaryIO, size: int, is_unmarked: bool = False) -> str:
    """Return the SHA-256 of a file of ``size`` bytes without its seal line; ``is_unmarked``: as if HDF5's mark of a
    file open for writing were not in its header."""
    digest = hashlib.sha256()
    stream.seek(0)
    left = size - _TAIL
    while left > 0 and (chunk := stream.read(min(left, _CHUNK))):
        is_first = left == size - _TAIL
        digest.update(_remove_mark(chunk) if is_first and is_unmarked else chunk)
        left -= len(chunk)
    return digest.hexdigest()


def _remove_mark(begin: bytes) -> bytes:
    is_known = begin.startswith(SIGNATURE) and begin[len(SIGNATURE) : len(SIGNATURE) + 1] in (b"\0", b"\1")
    return begin[: _IN_USE.start] + bytes(4) + begin[_IN_USE.stop :] if is_known else begin


def _warn(path: Path, reason: str) -> None:
    """Warn that a file is read although its seal is not right, with ``reason`` (the beginning of the sentence); once a
    process for each state of a file."""
    if (state := file_state(path)) not in _warned:
        _warned.add(state)
        warnings.warn(
            f"{path}: {reason} its content is as it was sealed (SHA-256), so it is read; to seal it again:  "
            f"pianorig recover {path.parent}",
            stacklevel=3,
        )


_warned: set[tuple[str, int, int, int]] = set()
_content_problem: dict[tuple[str, int, int, int], str] = {}
"""What is wrong with the content of files without a seal, by path and state; empty: nothing."""
_ROOT = str(Path(__file__).resolve().parents[2])
_VERIFY = f"import sys; sys.path.insert(0, {_ROOT!r}); from rig.session.seal import print_digests; print_digests()"


def _check_content(path: Path, warn: bool = True) -> None:
    """Raise RigInputError where the content of a file without a seal is not as its SHA-256 says; else warn (once a
    process) that its seal is missing, unless ``warn`` is False."""
    state = file_state(path)
    if state not in _content_problem:
        _content_problem[state] = _compare_content(path)
        if warn and not _content_problem[state]:
            _warn(path, "another program opened it for writing, which took its seal off;")
    if problem := _content_problem[state]:
        raise RigInputError(f"{path}: {problem}")


def file_state(path: Path) -> tuple[str, int, int, int]:
    """What changes when a file does: its path, inode, size and time of change."""
    found = path.stat()
    return str(path.resolve()), found.st_ino, found.st_size, found.st_mtime_ns


def _compare_content(path: Path) -> str:
    """Why the content of a file does not agree with the SHA-256 it states, empty where it does; read in another
    process, which a damaged file may crash."""
    with path.open("rb") as stream:
        if stream.read(len(SIGNATURE)) != SIGNATURE:
            return NOT_AS_SEALED
    done = subprocess.run([sys.executable, "-c", _VERIFY, str(path)], capture_output=True, text=True, check=False)
    try:
        found = json.loads(done.stdout)
    except ValueError:  # it ended without a word
        found = {}
    if found.get("locked"):
        return OPEN_ELSEWHERE
    if found.get("stated") and found["stated"] == found.get("found"):
        return ""
    return NOT_AS_SEALED


def print_digests() -> None:
    """Print as JSON, of the HDF5 file named by the first argument of the process, the ``stated`` and the ``found``
    SHA-256 of its content, or, where it cannot be read, whether another program has it ``locked``."""
    found: dict[str, Any] = {}
    try:
        with h5py.File(sys.argv[1], "r") as file:
            found = {"stated": str(file.attrs.get(CONTENT, "")), "found": content_sha256(file)}
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        found = {"locked": platform_calls.is_locked(error)}
    print(json.dumps(found))


def content_sha256(file: h5py.File) -> str:
    """Return the SHA-256 over the names, attributes and arrays of all groups and datasets in an HDF5 file, sorted by
    name, without the stated digest itself and HDF5's own attributes of scales."""
    nodes: dict[str, Any] = {"/": file}
    file.visititems(lambda name, node: nodes.__setitem__(name, node))
    digest = hashlib.sha256()
    for name in sorted(nodes):
        node = nodes[name]
        digest.update(name.encode() + b"\0")
        for key in sorted(set(node.attrs) - set(BOOKKEEPING)):
            if (name, key) != ("/", CONTENT):
                digest.update(f"{key}={array_sha256(np.asarray(node.attrs[key]))}\0".encode())
        if isinstance(node, h5py.Dataset):
            digest.update(array_sha256(np.asarray(node[()])).encode())
    return digest.hexdigest()


def array_sha256(values: NDArray[Any]) -> str:
    """Return the SHA-256 of an array's little-endian bytes in C order; text as UTF-8, one item a line."""
    array = np.ascontiguousarray(values)
    if array.dtype.kind in "OUS":
        text = "\n".join(item.decode() if isinstance(item, bytes) else str(item) for item in array.ravel())
        return hashlib.sha256(text.encode("utf-8")).hexdigest()
    return hashlib.sha256(array.astype(array.dtype.newbyteorder("<")).tobytes()).hexdigest()


def has_seal(path: Path) -> bool:
    """Whether a file ends with the line of a seal; False also where the seal fits only without HDF5's mark of an open
    file in its header, so that it must be sealed again. A seal that is wrong counts."""
    with translate_os_error(path, "read"), path.open("rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(max(size - _TAIL, 0))
        tail = stream.read()
        stated = tail[len(MARK) : -1].decode("ascii", "replace")
        if not tail.startswith(MARK):
            return False
        return _hash_sealed(stream, size) == stated or _hash_sealed(stream, size, is_unmarked=True) != stated


def seal_again(path: Path) -> None:
    """Put a seal back on a file whose content is as its SHA-256 says, and make it read-only; RigInputError for an
    altered file, or one in use by another program."""
    with translate_os_error(path, "read"):
        _check_content(path, warn=False)
        before = file_state(path)
    if platform_calls.is_held(path):
        raise RigInputError(f"{path}: {OPEN_ELSEWHERE}")
    with translate_os_error(path, "read"):
        whole = path.read_bytes()
    rest_of_seal = whole.rfind(MARK, max(len(whole) - _TAIL, 0))
    whole = _remove_mark(whole[:rest_of_seal] if rest_of_seal >= 0 else whole)
    with replace_when_complete(path) as temporary:
        temporary.write_bytes(whole + MARK + hashlib.sha256(whole).hexdigest().encode() + b"\n")
        if file_state(path) != before:
            raise RigInputError(f"{path}: {OPEN_ELSEWHERE}")
    platform_calls.make_read_only(path)
