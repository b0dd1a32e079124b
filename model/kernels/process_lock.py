"""A lock between processes that use one kernel cache, so that two that start together compile once.

The operating system lets go of a lock whose process died. Where files cannot be locked nobody waits.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

POLL_S = 0.05  # s between two looks at a lock


if sys.platform == "win32":

    def _take(file: BinaryIO) -> None:
        """Lock an open file, when no other process holds it any more."""
        while True:
            try:
                file.seek(0)
                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            except PermissionError:
                time.sleep(POLL_S)
            else:
                return

else:

    def _take(file: BinaryIO) -> None:
        """Lock an open file, when no other process holds it any more."""
        fcntl.flock(file, fcntl.LOCK_EX)


@contextmanager
def hold_lock(folder: Path | None, name: str) -> Iterator[None]:
    """Hold the lock ``name`` among the processes that use a cache folder, waiting for it; nothing is locked without a
    folder, or where it cannot be written."""
    with ExitStack() as held:
        if folder is not None:
            with suppress(OSError):  # a folder that cannot be written, a file system without locks
                file = held.enter_context(open(folder / (re.sub(r"\W+", "_", name) + ".lock"), "ab"))
                _take(file)
        yield  # closing the file lets go of the lock
