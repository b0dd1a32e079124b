"""HDF5 files that end with the SHA-256 of themselves: written whole, and never opened when a single byte has changed.

The HDF5 library may crash the process on damaged metadata, so the seal is checked before the library sees the file. The
seal is one line of text after the last byte of HDF5, which the library and netCDF-4 tools ignore.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from pathlib import Path

import h5py

from rig.errors import RigInputError
from rig.storage.atomic_write import replace_when_complete
from rig.storage.file_errors import refused

MARK = b"\npiano-action-rig sha256 "
_TAIL = len(MARK) + 64 + 1


@contextlib.contextmanager
def write_sealed(path: Path) -> Iterator[h5py.File]:
    """Yield an empty HDF5 file to fill; seal it and put it at ``path`` when the block ends without an exception.

    It is filled in memory: on a full disk the library would leave objects behind that it cannot close.
    """
    with replace_when_complete(path) as temporary:
        with h5py.File(temporary, "w", track_order=True, driver="core", backing_store=False) as file:
            yield file
            file.flush()
            image = file.id.get_file_image()
        temporary.write_bytes(image + MARK + hashlib.sha256(image).hexdigest().encode() + b"\n")


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
        while left > 0 and (chunk := stream.read(min(left, 1 << 20))):
            digest.update(chunk)
            left -= len(chunk)
    if tail[len(MARK) : -1] != digest.hexdigest().encode():
        raise RigInputError(f"{path}: altered since it was sealed (SHA-256 does not match); restore it from a copy")
