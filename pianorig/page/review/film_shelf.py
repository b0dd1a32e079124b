"""Frames of films, read when they are asked for; a film is never loaded whole."""

from __future__ import annotations

import threading
from collections import OrderedDict
from pathlib import Path

import numpy as np

import vision

MOST_OPEN = 4

Key = tuple[Path, int, int]


class FilmShelf:
    """Films that stay open between two frames, the last `MOST_OPEN` of them."""

    def __init__(self) -> None:
        self._films: OrderedDict[Key, tuple[vision.Film, threading.Lock]] = OrderedDict()
        self._lock = threading.Lock()

    def frames(self, path: Path, first: int, count: int) -> bytes:
        """Some frames one after the other, a byte a pixel, row by row; of deeper films the upper eight bits.

        Not encoded: on the loopback a byte is cheaper than what it takes to compress it.

        Raises
        ------
        vision.VisionError : the film cannot be read, or has no such frame
        """
        film, lock = self._film(path)
        with lock:
            frames = [film.read(index) for index in range(first, min(first + count, film.n_frames))] or [
                film.read(first)
            ]
        down = max(0, film.bit_depth - 8)
        grey = [frame if frame.dtype == np.uint8 else (frame >> down).astype(np.uint8) for frame in frames]
        return b"".join(frame.tobytes() for frame in grey)

    def _film(self, path: Path) -> tuple[vision.Film, threading.Lock]:
        stat = path.stat()
        key = (path, stat.st_size, stat.st_mtime_ns)
        with self._lock:
            if key not in self._films:
                self._films[key] = vision.open_film(path, allow_truncated=True), threading.Lock()
            self._films.move_to_end(key)
            while len(self._films) > MOST_OPEN:
                _, (old, busy) = self._films.popitem(last=False)
                with busy:
                    old.close()
            return self._films[key]

    def close(self) -> None:
        """Close all films."""
        with self._lock:
            for film, busy in self._films.values():
                with busy:
                    film.close()
            self._films.clear()
