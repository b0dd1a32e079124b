"""B-spline coefficients of a rectangle of a frame, compiled: as `bspline.coefficients`, in half the time.

Along x the filter is a sum, along y the recursion of M. Unser (`bspline`), which runs over whole rows at once. Nothing
is reordered by fast arithmetic, so that the same rectangle always gives the same bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.fitting.bspline import HALF_TAPS, POLE, prefilter_taps

TAPS = tuple(np.float32(6.0 * tap) for tap in prefilter_taps()[HALF_TAPS:])
"""From the middle outwards, times the gain of the recursion; frozen into the compiled code."""
Z = np.float32(POLE)
END = np.float32(POLE / (POLE**2 - 1.0))
START = 16
"""Rows that begin the recursion; the next would count 1e-9."""
F32 = NDArray[np.float32]


@njit(cache=True, nogil=True)
def filter_along(line: F32, out: F32) -> None:
    """Filter a line, of which ``out`` lacks `HALF_TAPS` values at each end."""
    t0, t1, t2, t3, t4, t5, t6, t7 = TAPS
    for x in range(out.size):
        near = t0 * line[x + 7] + t1 * (line[x + 6] + line[x + 8]) + t2 * (line[x + 5] + line[x + 9])
        far = t3 * (line[x + 4] + line[x + 10]) + t4 * (line[x + 3] + line[x + 11])
        rest = t5 * (line[x + 2] + line[x + 12]) + t6 * (line[x + 1] + line[x + 13]) + t7 * (line[x] + line[x + 14])
        out[x] = near + far + rest


@njit(cache=True, nogil=True)
def add_times(factor: np.float32, one: F32, out: F32) -> None:
    """Add ``factor`` times a line."""
    for x in range(out.size):
        out[x] += factor * one[x]


@njit(cache=True, nogil=True)
def less_times(factor: np.float32, one: F32, out: F32) -> None:
    """Replace a line by ``factor`` times its difference from another."""
    for x in range(out.size):
        out[x] = factor * (one[x] - out[x])


@njit(cache=True, nogil=True)
def prefilter(picture: NDArray[Any], out: F32) -> int:
    """Fill ``out`` with the coefficients of a picture of at least 17 x 17 pixels; returns its largest grey value."""
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
        filter_along(line, out[y])
    # the picture is mirrored at its edges
    factor = Z
    for k in range(1, START):
        add_times(factor, out[k], out[0])
        factor *= Z
    for y in range(1, rows):
        add_times(Z, out[y - 1], out[y])
    last = out[rows - 1]
    add_times(Z, out[rows - 2], last)
    for x in range(width):
        last[x] = END * last[x]
    for y in range(rows - 2, -1, -1):
        less_times(Z, out[y + 1], out[y])
    return brightest


@njit(cache=True, nogil=True)
def saturated_inside(picture: NDArray[Any], top: int) -> int:
    """Number of pixels that reach ``top`` together with their four neighbours, as far as the picture has them."""
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
