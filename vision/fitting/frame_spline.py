"""B-spline coefficients of the part of a frame that the bodies cover, filtered once for all of them.

The tracker says before a frame where it expects its bodies; a fit that needs a rectangle inside reads nothing more.
What lies outside (a search, a body that has gone elsewhere) is read and filtered for itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource, saturated_areas, saturated_grey
from vision.fitting.base import LEAST_PX
from vision.fitting.bspline import HALF_TAPS, POLE, prefilter_taps
from vision.kernel_cache import cached_njit, inner_njit

TAPS = tuple(np.float32(6.0 * tap) for tap in prefilter_taps()[HALF_TAPS:])
"""From the middle outwards, times the gain of the recursion; frozen into the compiled code."""
Z = np.float32(POLE)
END = np.float32(POLE / (POLE**2 - 1.0))
F32 = NDArray[np.float32]


@inner_njit()
def filter_line(line: F32, out: F32) -> None:
    """Fill ``out`` (n,) with a line of grey values filtered by `TAPS`; ``line`` has `HALF_TAPS` more values at each
    end."""
    t0, t1, t2, t3, t4, t5, t6, t7 = TAPS
    for x in range(out.size):
        near = t0 * line[x + 7] + t1 * (line[x + 6] + line[x + 8]) + t2 * (line[x + 5] + line[x + 9])
        far = t3 * (line[x + 4] + line[x + 10]) + t4 * (line[x + 3] + line[x + 11])
        rest = t5 * (line[x + 2] + line[x + 12]) + t6 * (line[x + 1] + line[x + 13]) + t7 * (line[x] + line[x + 14])
        out[x] = near + far + rest


@inner_njit()
def add_scaled(factor: np.float32, one: F32, out: F32) -> None:
    for x in range(out.size):
        out[x] += factor * one[x]


@inner_njit()
def subtract_scaled(factor: np.float32, one: F32, out: F32) -> None:
    for x in range(out.size):
        out[x] = factor * (one[x] - out[x])


@cached_njit(nogil=True)
def prefilter(picture: NDArray[Any], out: F32) -> int:
    """Fill ``out`` (height, width) with the spline coefficients of a picture of that shape, at least 17 x 17 pixels,
    mirrored at its edges; returns its largest grey value."""
    rows, width = picture.shape
    line = np.empty(width + 2 * HALF_TAPS, dtype=np.float32)
    middle = line[HALF_TAPS : HALF_TAPS + width]
    brightest = 0
    for y in range(rows):
        here = picture[y]
        for x in range(width):
            middle[x] = here[x]
        for x in range(width):
            brightest = max(brightest, int(here[x]))
        for k in range(1, HALF_TAPS + 1):
            line[HALF_TAPS - k], line[HALF_TAPS - 1 + width + k] = middle[k], middle[width - 1 - k]
        filter_line(line, out[y])
    # the picture is mirrored at its edges
    factor = Z
    for k in range(1, LEAST_PX):  # as many rows as every region has: the next would count 1e-9
        add_scaled(factor, out[k], out[0])
        factor *= Z
    for y in range(1, rows):
        add_scaled(Z, out[y - 1], out[y])
    last = out[rows - 1]
    add_scaled(Z, out[rows - 2], last)
    for x in range(width):
        last[x] = END * last[x]
    for y in range(rows - 2, -1, -1):
        subtract_scaled(Z, out[y + 1], out[y])
    return brightest


@cached_njit(nogil=True)
def count_saturated_inside(picture: NDArray[Any], top: int) -> int:
    """Number of pixels that reach ``top`` and whose four neighbours, as far as the picture has them, reach it too."""
    rows, width = picture.shape
    count = 0
    for y in range(rows):
        above, here, below = picture[max(y - 1, 0)], picture[y], picture[min(y + 1, rows - 1)]
        for x in range(1, width - 1):
            full = (here[x] >= top) & (above[x] >= top) & (below[x] >= top)
            count += full & (here[x - 1] >= top) & (here[x + 1] >= top)
        for x, beside in ((0, 1), (width - 1, width - 2)):
            count += (here[x] >= top) & (above[x] >= top) & (below[x] >= top) & (here[beside] >= top)
    return count


Box = tuple[int, int, int, int]
"""y0, y1, x0, x1: rows ``y0..y1-1`` and columns ``x0..x1-1``."""


@dataclass(frozen=True)
class FilteredPart:
    """B-spline coefficients (h, w) of a rectangle of a frame, grey values, number of pixels inside saturated areas."""

    box: Box
    coefficient: NDArray[np.float32]
    picture: NDArray[Any]
    n_saturated: int

    def saturated_pixels(self, top: int) -> NDArray[np.bool_] | None:
        """Pixels inside areas that reach ``top``, (h, w), None where there are none."""
        return saturated_areas(self.picture, top) if self.n_saturated else None


NO_PART = FilteredPart((0, 0, 0, 0), np.zeros((0, 0), dtype=np.float32), np.zeros((0, 0), dtype=np.uint8), 0)
"""Holds no body."""


class FrameSpline:
    """Reads and filters parts of one film's frames; holds the newest."""

    def __init__(self, film: FrameSource) -> None:
        self.film = film
        self._expected: tuple[int, Box | None] = (-1, None)
        self._newest: tuple[int, FilteredPart] | None = None
        self._buffer = np.empty(0, dtype=np.float32)

    def expect(self, index: int, box: Box | None) -> None:
        """Say that rectangles inside ``box`` of frame ``index`` will be asked for."""
        self._expected = (index, box)

    def take(self, index: int, box: Box, coefficient: NDArray[np.float32], n_saturated: int) -> None:
        """Take over the coefficients of a rectangle of frame ``index``, with which an array of compiled code begins."""
        picture = np.ascontiguousarray(self.film.read_region(index, *box))
        part = coefficient[: picture.size].reshape(picture.shape)
        self._newest = (index, FilteredPart(box, part, picture, n_saturated))

    def newest(self, index: int) -> FilteredPart | None:
        """The rectangle of frame ``index`` that was filtered last, None where it was another frame's."""
        return self._newest[1] if self._newest is not None and self._newest[0] == index else None

    def filtered_part(self, index: int, box: Box) -> FilteredPart:
        """Spline coefficients of a rectangle of frame ``index`` that holds ``box``: the one filtered last, or read and
        filtered now; valid until the next call."""
        if self._newest is not None and self._newest[0] == index and _is_inside(box, self._newest[1].box):
            return self._newest[1]
        expected = self._expected[1] if self._expected[0] == index else None
        whole = box if expected is None or not _is_inside(box, expected) else expected
        picture = np.ascontiguousarray(self.film.read_region(index, *whole))
        if picture.size > self._buffer.size:
            self._buffer = np.empty(picture.size, dtype=np.float32)
        coefficient = self._buffer[: picture.size].reshape(picture.shape)
        top = saturated_grey(self.film)
        many = count_saturated_inside(picture, top) if prefilter(picture, coefficient) >= top else 0
        part = FilteredPart(whole, coefficient, picture, many)
        self._newest = (index, part)
        return part


def _is_inside(box: Box, other: Box) -> bool:
    return box[0] >= other[0] and box[1] <= other[1] and box[2] >= other[2] and box[3] <= other[3]
