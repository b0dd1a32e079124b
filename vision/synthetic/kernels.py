"""The compiled loop that draws synthetic films (numba).

Place in the data flow: `render` calls `composite` once per body and exposure step. It stands alone: numba's
disk cache would not notice a change of a jitted function in another file.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FAST = {"reassoc", "contract", "arcp", "nsz"}


@njit(cache=True, nogil=True, fastmath=FAST)
def composite(
    picture: NDArray[np.float32],
    coefficient: NDArray[np.float32],
    alpha: NDArray[np.float32],
    oversampling: float,
    table_x: float,
    table_y: float,
    pivot_x: float,
    pivot_y: float,
    phi: float,
    flat_x: NDArray[np.float64],
    flat_y: NDArray[np.float64],
    bend: int,
) -> None:
    """Draw a textured body over a picture: its texture table is sampled by splines, its edge blended by
    ``alpha``.

    ``flat_x``, ``flat_y`` (height, width) give the point of the plane of motion that each pixel shows, at most
    ``bend`` px from the pixel itself.
    """
    height, width = picture.shape
    rows, columns = coefficient.shape
    cosine, sine = math.cos(phi), math.sin(phi)
    low_x, high_x, low_y, high_y = 1e9, -1e9, 1e9, -1e9
    for corner in range(4):
        u = table_x + (columns - 1) / oversampling * (corner % 2)
        v = table_y + (rows - 1) / oversampling * (corner // 2)
        x, y = pivot_x + cosine * u - sine * v, pivot_y + sine * u + cosine * v
        low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
    for iy in range(max(0, int(low_y) - bend), min(height, int(high_y) + 2 + bend)):
        for ix in range(max(0, int(low_x) - bend), min(width, int(high_x) + 2 + bend)):
            x, y = flat_x[iy, ix] - pivot_x, flat_y[iy, ix] - pivot_y
            u = (cosine * x + sine * y - table_x) * oversampling
            v = (cosine * y - sine * x - table_y) * oversampling
            if not (u >= 1.0 and v >= 1.0 and u < columns - 2 and v < rows - 2):
                continue
            iu, iv = int(u), int(v)
            fu, fv = np.float32(u - iu), np.float32(v - iv)
            one = np.float32(1.0)
            blend = (one - fv) * ((one - fu) * alpha[iv, iu] + fu * alpha[iv, iu + 1]) + fv * (
                (one - fu) * alpha[iv + 1, iu] + fu * alpha[iv + 1, iu + 1]
            )
            if blend <= 0.0:
                continue
            gu, gv = one - fu, one - fv
            sixth, four, six, three = np.float32(1.0 / 6.0), np.float32(4.0), np.float32(6.0), np.float32(3.0)
            u0, u3 = gu * gu * gu * sixth, fu * fu * fu * sixth
            u1 = (four - fu * fu * (six - three * fu)) * sixth
            u2 = one - u0 - u1 - u3
            v0, v3 = gv * gv * gv * sixth, fv * fv * fv * sixth
            v1 = (four - fv * fv * (six - three * fv)) * sixth
            v2 = one - v0 - v1 - v3
            r0, r1, r2, r3 = coefficient[iv - 1], coefficient[iv], coefficient[iv + 1], coefficient[iv + 2]
            grey = (
                v0 * (u0 * r0[iu - 1] + u1 * r0[iu] + u2 * r0[iu + 1] + u3 * r0[iu + 2])
                + v1 * (u0 * r1[iu - 1] + u1 * r1[iu] + u2 * r1[iu + 1] + u3 * r1[iu + 2])
                + v2 * (u0 * r2[iu - 1] + u1 * r2[iu] + u2 * r2[iu + 1] + u3 * r2[iu + 2])
                + v3 * (u0 * r3[iu - 1] + u1 * r3[iu] + u2 * r3[iu + 1] + u3 * r3[iu + 2])
            )
            picture[iy, ix] += blend * (grey - picture[iy, ix])
