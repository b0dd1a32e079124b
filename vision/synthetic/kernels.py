"""The compiled loop that draws synthetic films (numba).

`Scene.light` calls `composite` once per body and exposure step. It calls no other compiled function: numba's disk cache
would not notice a change of one in another file.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.kernel_cache import cached_njit

FAST = {"reassoc", "contract", "arcp", "nsz"}


class TextureTable(NamedTuple):
    """Spline coefficients of a body's texture and its opacity ``alpha``, tabulated in the body's axes with
    ``oversampling`` points per pixel; the first point lies at (``x``, ``y``)."""

    coefficient: NDArray[np.float32]
    alpha: NDArray[np.float32]
    oversampling: float
    x: float
    y: float


class PlanePoints(NamedTuple):
    """Point (``x``, ``y``) of the plane of motion that each pixel shows, each (height, width), at most ``bend`` px from
    the pixel itself."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    bend: int


class PlanarPose(NamedTuple):
    """Place of the body's origin, px, and its turn in picture axes, rad."""

    x: float
    y: float
    phi: float


@cached_njit(nogil=True, fastmath=FAST)
def composite(picture: NDArray[np.float32], table: TextureTable, shown: PlanePoints, pose: PlanarPose) -> None:
    """Draw a textured body over ``picture``, in place: its table is sampled by cubic splines, its edge blended by
    ``alpha``."""
    coefficient, alpha, oversampling = table.coefficient, table.alpha, table.oversampling
    table_x, table_y = table.x, table.y
    pivot_x, pivot_y, phi = pose.x, pose.y, pose.phi
    flat_x, flat_y, bend = shown.x, shown.y, shown.bend
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
            sixth, half, most = np.float32(1.0 / 6.0), np.float32(0.5), np.float32(2.0 / 3.0)
            u0, u3 = gu * gu * gu * sixth, fu * fu * fu * sixth
            u1 = most - fu * fu * (one - half * fu)
            u2 = one - u0 - u1 - u3
            v0, v3 = gv * gv * gv * sixth, fv * fv * fv * sixth
            v1 = most - fv * fv * (one - half * fv)
            v2 = one - v0 - v1 - v3
            r0, r1, r2, r3 = coefficient[iv - 1], coefficient[iv], coefficient[iv + 1], coefficient[iv + 2]
            grey = (
                v0 * (u0 * r0[iu - 1] + u1 * r0[iu] + u2 * r0[iu + 1] + u3 * r0[iu + 2])
                + v1 * (u0 * r1[iu - 1] + u1 * r1[iu] + u2 * r1[iu + 1] + u3 * r1[iu + 2])
                + v2 * (u0 * r2[iu - 1] + u1 * r2[iu] + u2 * r2[iu + 1] + u3 * r2[iu + 2])
                + v3 * (u0 * r3[iu - 1] + u1 * r3[iu] + u2 * r3[iu + 1] + u3 * r3[iu + 2])
            )
            picture[iy, ix] += blend * (grey - picture[iy, ix])
