"""HDF5 files that end with the SHA-256 of themselves: written whole, and never opened when a single byte has changed.

The HDF5 library may crash the process on damaged metadata, so the seal is checked before the library sees the file. The
seal is one line of text after the last byte of HDF5, which the library and netCDF-4 tools ignore.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from rig.errors import RigInputError
from rig.storage.atomic_write import refused, replace_when_complete

MARK = b"\npiano-action-rig sha256 "
_TAIL = len(MARK) + 64 + 1
_CHUNK = 1 << 20


class _Patient(io.RawIOBase):
    """A file whose failures wait until it is closed: on a full disk the library would leave objects it cannot close."""

    def __init__(self, stream: io.FileIO) -> None:
        self._stream = stream
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of ``data``, or remember why not."""
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
        """Read into ``buffer``."""
        return self._stream.readinto(buffer) or 0

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move to a position."""
        return self._stream.seek(offset, whence)

    def tell(self) -> int:
        """Return the position."""
        return self._stream.tell()


@contextlib.contextmanager
def write_sealed(path: Path) -> Iterator[h5py.File]:
    """Yield an empty HDF5 file to fill; seal it and put it at ``path`` when the block ends without an exception.

    Raises RigInputError when the file system refuses, e.g. a full disk.
    """
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
    """Check the seal and yield the HDF5 file for reading.

    Raises RigInputError when the file is missing, unreadable, not sealed or altered, or lacks what the block reads.
    """
    _check_seal(path)
    try:
        with h5py.File(path, "r") as file:
            yield file
    except RigInputError:
        raise
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RigInputError(f"{path}: not a file of this program or version ({reason})") from error


def _check_seal(path: Path) -> None:
    with refused(path, "read"), path.open("rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(max(size - _TAIL, 0))
        tail = stream.read()
        if len(tail) != _TAIL or not tail.startswith(MARK):
            raise RigInputError(
                f"{path}: has no seal at its end: truncated, or rewritten by another program; restore it"
            )
        digest = hashlib.sha256()
        stream.seek(0)
        left = size - _TAIL
        while left > 0 and (chunk := stream.read(min(left, _CHUNK))):
            digest.update(chunk)
            left -= len(chunk)
    if tail[len(MARK) : -1] != digest.hexdigest().encode():
        raise RigInputError(f"{path}: altered since it was sealed (SHA-256 does not match); restore it from a copy")
