"""What differs between operating systems: opening, syncing, reserving and locking files, signals that end a program."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

WINDOWS = sys.platform == "win32"
_ENDING = ("SIGTERM", "SIGHUP", "SIGBREAK")

_LOCK_AT = 2**40  # byte that is locked on Windows, far beyond any data, because a lock there also keeps readers out


def open_raw(path: Path, flags: int) -> int:
    """Open a file for unbuffered bytes (Windows would otherwise change line ends); return its descriptor."""
    return os.open(path, flags | getattr(os, "O_BINARY", 0), 0o666)


def ending_signals(*, with_keyboard: bool = False) -> list[int]:
    """Return the signals that ask a program to end on this system; ``SIGBREAK`` is Ctrl-Break on Windows."""
    names = (("SIGINT",) if with_keyboard else ()) + _ENDING
    return [int(getattr(signal, name)) for name in names if hasattr(signal, name)]


@contextlib.contextmanager
def ending_by_keyboard() -> Iterator[None]:
    """Context in which Ctrl-C ends the whole program at once, without KeyboardInterrupt and without tidying up: for a
    library that may never come back to Python.

    For reading only. Outside of the main thread, and where an interrupt is ignored, nothing changes.
    """
    is_ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not is_ours or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def synchronise_whole(descriptor: int) -> None:
    """Flush the file's data and its size to the disk itself."""
    os.fsync(descriptor)


def synchronise(descriptor: int) -> None:
    """Flush the file's data to the disk itself (``fdatasync``, on Windows ``fsync``)."""
    getattr(os, "fdatasync", os.fsync)(descriptor)


def is_deleted(descriptor: int) -> bool:
    """Whether the open file has been deleted; Windows does not let that happen."""
    return os.fstat(descriptor).st_nlink == 0


def reserve(descriptor: int, path: Path, size: int) -> None:
    """Make sure that ``size`` bytes fit; where the system can, set them aside as zeros at the end of the file."""
    allocate = getattr(os, "posix_fallocate", None)
    if allocate is not None:
        allocate(descriptor, 0, size)
    elif (free := shutil.disk_usage(path.parent).free) < size:
        raise OSError(28, f"{free} bytes free, {size} needed")


def lock(descriptor: int) -> bool:
    """Lock the open file of this ``descriptor`` for this process, without waiting, until it is closed or the process
    ends; False when another process has it."""
    try:
        if WINDOWS:
            import msvcrt  # platform: Windows only

            os.lseek(descriptor, _LOCK_AT, os.SEEK_SET)
            try:
                msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined, unused-ignore]
            finally:
                os.lseek(descriptor, 0, os.SEEK_SET)
        else:
            import fcntl  # platform: POSIX only

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


WINDOWS_CODES = (32, 33)  # of Windows: sharing violation, lock violation


def is_locked(error: BaseException) -> bool:
    """Whether opening or reading a file failed because another program has locked it; HDF5 says so in words only."""
    codes = getattr(error, "errno", None), getattr(error, "winerror", None)
    is_taken = codes[0] in (errno.EAGAIN, errno.EWOULDBLOCK) or codes[1] in WINDOWS_CODES
    return is_taken or "unable to lock file" in str(error)


def is_held(path: Path) -> bool:
    """Whether another program has the file open for writing with a lock; always False on Windows, where reading it then
    fails."""
    if WINDOWS:
        return False
    import fcntl  # platform: POSIX only

    with path.open("rb") as stream:
        try:
            fcntl.flock(stream.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError as error:
            return is_locked(error)
    return False


def make_read_only(path: Path) -> None:
    """Take the permission to write from a file for everybody, so that no other program opens it for writing by mistake;
    nothing on Windows.

    Not on Windows, where a folder with such a file cannot be removed; nor where the file system has no permissions.
    """
    if not WINDOWS:
        with contextlib.suppress(OSError):
            path.chmod(path.stat().st_mode & ~0o222)


def replace(source: Path, target: Path) -> None:
    """Rename ``source`` over ``target``; on Windows a target that is read-only is made writable first, as it refuses
    otherwise."""
    try:
        os.replace(source, target)
    except PermissionError:
        if not target.is_file() or target.stat().st_mode & stat.S_IWRITE:
            raise
        target.chmod(target.stat().st_mode | stat.S_IWRITE)
        os.replace(source, target)


def remove(path: Path, *, attempts: int = 20, wait: Callable[[float], None] = time.sleep) -> None:  # 0.2 s in all
    """Delete a file; on Windows, where another program may be reading it, try ``attempts`` times 10 ms apart, after
    which it stays without an error. A file that is not there is no error.

    A later reader of the folder recognises one that stayed as obsolete.
    """
    for attempt in range(attempts):
        try:
            path.unlink(missing_ok=True)
            return
        except PermissionError:
            if attempt < attempts - 1:
                wait(0.01)  # as the line of the function says
