"""Frames that repeat the one before, byte for byte: a camera's software fills a dropped frame with its neighbour.

Two exposures differ by their noise in some of thousands of pixels, so equal bytes mean that no light was taken in
between, and the frame says nothing about its own time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource

Box = tuple[int, int, int, int]


class Repeats:
    """Compares frames with the one before, inside a rectangle (y0, y1, x0, x1)."""

    def __init__(self, film: FrameSource, box: Box) -> None:
        self._film, self._box = film, box
        y0, y1 = box[:2]
        # one row tells nearly all frames apart; the whole frame before is read again only where that is cheap
        self._kept = (y0, y1) if getattr(film, "in_order", True) else ((y0 + y1) // 2, (y0 + y1) // 2 + 1)
        self._newest: tuple[int, NDArray[Any]] | None = None
        # a codec that predicts frames from others repeats what stands still
        self.meaningful = film.compression is None or film.compression.steps is not None

    @property
    def line(self) -> tuple[int, int, int]:
        """Row y and columns x0..x1-1 that differ between nearly all frames that are not repeated."""
        return self._kept[0], self._box[2], self._box[3]

    def at(self, index: int) -> bool:
        """True when frame ``index`` repeats frame ``index - 1``."""
        if not self.meaningful or index < 1:
            return False
        if self._newest is None or self._newest[0] != index - 1:
            self._newest = (index - 1, self._read(index - 1, self._kept))
        before, here = self._newest[1], self._read(index, self._kept)
        self._newest = (index, here)
        if not np.array_equal(here, before):
            return False
        rows = self._box[:2]
        if self._kept != rows:
            before, here = self._read(index - 1, rows), self._read(index, rows)
        # without contrast (a dark or a saturated frame) equal bytes mean nothing
        return bool(np.array_equal(here, before) and here.min() != here.max())

    def _read(self, index: int, rows: tuple[int, int]) -> NDArray[Any]:
        # a copy: some readers give a view of a window that moves
        return np.array(self._film.read_region(index, *rows, *self._box[2:]))
