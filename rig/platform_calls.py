"""What differs between operating systems: getting data onto the disk, reserving room there, locking a file.

Place in the data flow: under the journal. Everything here takes an open file descriptor. Failures of the file system
come as OSError, for the caller to put into words.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

_LOCK_AT = 2**62
"""Byte that is locked on Windows, far behind any data, because a lock there also keeps readers out."""


def synchronise(descriptor: int) -> None:
    """Have the file's data on the disk itself before returning (``fdatasync``, on Windows ``fsync``)."""
    getattr(os, "fdatasync", os.fsync)(descriptor)


def reserve(descriptor: int, path: Path, size: int) -> None:
    """Make sure that ``size`` bytes fit; where the system can, set them aside as zeros at the end of the file.

    Raises
    ------
    OSError
        When there is not enough room.
    """
    allocate = getattr(os, "posix_fallocate", None)
    if allocate is not None:
        allocate(descriptor, 0, size)
    elif (free := shutil.disk_usage(path.parent).free) < size:
        raise OSError(28, f"{free} bytes free, {size} needed")


def lock(descriptor: int) -> bool:
    """Take the file for this process until it is closed, or the process ends; False when another one has it."""
    try:
        if os.name == "nt":
            import msvcrt

            os.lseek(descriptor, _LOCK_AT, os.SEEK_SET)
            try:
                msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined, unused-ignore]
            finally:
                os.lseek(descriptor, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
