"""Bytes of a large file through a memory-mapped window that moves along it.

Only the pages that are accessed are read, and they count as used memory only until their window is released.
"""

from __future__ import annotations

import mmap
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError

WINDOW_BYTES = 1 << 25  # mapped at a time, unless one request needs more


class FileWindow:
    """Read-only access to a file's bytes.

    Attributes
    ----------
    size : of the file, bytes
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = path.open("rb")
            self.size = path.stat().st_size
        except OSError as error:
            raise FilmError(f"{path}: cannot be read ({error.strerror or error})") from None
        # one tuple, so that threads that move the window at the same time do not mix them
        self._held = (0, np.empty(0, dtype=np.uint8))

    def view(self, start: int, end: int) -> NDArray[np.uint8]:
        """Bytes ``start..end-1`` of the file, (end - start,), read-only, which stay valid after the window has moved on
        or the file was closed; `FilmError` beyond the end of the file."""
        if not 0 <= start <= end <= self.size:
            raise FilmError(f"{self.path}: bytes {start}..{end} requested, the file has {self.size}; it is cut short")
        held, window = self._held
        if not (held <= start and end <= held + window.size):
            held = start // mmap.ALLOCATIONGRANULARITY * mmap.ALLOCATIONGRANULARITY
            length = min(max(WINDOW_BYTES, end - held), self.size - held)
            if length == 0:
                return np.empty(0, dtype=np.uint8)
            try:
                mapped = mmap.mmap(self._file.fileno(), length, access=mmap.ACCESS_READ, offset=held)
            except (OSError, ValueError) as error:
                raise FilmError(f"{self.path}: cannot be read at byte {held} ({error})") from None
            window = np.frombuffer(mapped, dtype=np.uint8)
            self._held = (held, window)
        return window[start - held : end - held]

    def close(self) -> None:
        self._held = (0, np.empty(0, dtype=np.uint8))
        self._file.close()
