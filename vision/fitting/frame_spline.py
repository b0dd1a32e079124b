"""The part of a frame that the bodies take up, read and filtered once for all of them.

The tracker says before a frame where it expects its bodies; a fit that needs a rectangle inside reads nothing more.
What lies outside (a search, a body that has gone elsewhere) is read and filtered for itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource, saturated_areas, saturated_grey
from vision.fitting.prefilter import prefilter, saturated_inside

Box = tuple[int, int, int, int]
"""y0, y1, x0, x1: rows ``y0..y1-1`` and columns ``x0..x1-1``."""


@dataclass(frozen=True)
class FilteredPart:
    """B-spline coefficients (h, w) of a rectangle of a frame, grey values, number of pixels inside saturated areas."""

    box: Box
    coefficient: NDArray[np.float32]
    picture: NDArray[Any]
    n_saturated: int

    def saturated(self, bit_depth: int) -> NDArray[np.bool_] | None:
        """Pixels inside saturated areas, (h, w), None where there are none."""
        return saturated_areas(self.picture, bit_depth) if self.n_saturated else None


class FrameSpline:
    """Reads and filters parts of one film's frames; holds the newest."""

    def __init__(self, film: FrameSource) -> None:
        self.film = film
        self._expected: tuple[int, Box | None] = (-1, None)
        self._newest: tuple[int, FilteredPart] | None = None
        self._buffer = np.empty(0, dtype=np.float32)

    def expect(self, index: int, boxes: list[Box]) -> None:
        """Say which rectangles of frame ``index`` will be asked for."""
        self._expected = (index, None)
        if boxes:
            y0, y1, x0, x1 = zip(*boxes, strict=True)
            self._expected = (index, (min(y0), max(y1), min(x0), max(x1)))

    def take(self, index: int, box: Box, coefficient: NDArray[np.float32], n_saturated: int) -> None:
        """Take over the coefficients of a rectangle of frame ``index``, with which an array of compiled code begins."""
        picture = np.ascontiguousarray(self.film.read_region(index, *box))
        part = coefficient[: picture.size].reshape(picture.shape)
        self._newest = (index, FilteredPart(box, part, picture, n_saturated))

    def newest(self, index: int) -> FilteredPart | None:
        """The rectangle of frame ``index`` that was filtered last, None where it was another frame's."""
        return self._newest[1] if self._newest is not None and self._newest[0] == index else None

    def part(self, index: int, box: Box) -> FilteredPart:
        """A filtered rectangle of frame ``index`` that holds ``box``, valid until the next one is asked for."""
        if self._newest is not None and self._newest[0] == index and _inside(box, self._newest[1].box):
            return self._newest[1]
        expected = self._expected[1] if self._expected[0] == index else None
        whole = box if expected is None or not _inside(box, expected) else expected
        picture = np.ascontiguousarray(self.film.read_region(index, *whole))
        if picture.size > self._buffer.size:
            self._buffer = np.empty(picture.size, dtype=np.float32)
        coefficient = self._buffer[: picture.size].reshape(picture.shape)
        top = saturated_grey(self.film.bit_depth)
        many = saturated_inside(picture, top) if prefilter(picture, coefficient) >= top else 0
        part = FilteredPart(whole, coefficient, picture, many)
        self._newest = (index, part)
        return part


def _inside(box: Box, other: Box) -> bool:
    return box[0] >= other[0] and box[1] <= other[1] and box[2] >= other[2] and box[3] <= other[3]
