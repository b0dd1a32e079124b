"""A film resampled to square pixels of the plane of motion: pixel aspect, fields of interlaced frames, calibration.

Resampling makes more pixels than there is information. The variance of a pose grows by the ratio of the two densities
(`RectifiedFilm.oversampling`): a pose is a weighted sum of grey values with weights that are smooth over a pixel, so
that its variance depends on the density of the independent values alone.

Conventions: *film* points are pixels (x, y) of the file, *rectified* points those of the resampled picture. Whatever
lies outside the film is given as saturated, so that the fit leaves it out. Grey values are float32.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.bodies.outlines import Body
from vision.camera.model import Projection
from vision.errors import VisionInputError
from vision.film.source import Corrected, FrameSource, saturated_grey
from vision.fitting.bspline import HALF_TAPS, coefficients

MARGIN_PX = HALF_TAPS + 3
"""Around the region that is sampled: what the prefilter and the four coefficients of a point reach."""
MOST_ASPECT = 5.0  # width over height of a pixel, or its inverse; video standards use 0.75 to 1.5
ASPECTS = (1.0 / MOST_ASPECT, MOST_ASPECT)


class RectifiedFilm(Corrected):
    """A film as a camera with square pixels, square to the plane of motion, would show it.

    Parameters
    ----------
    pixel_aspect : width of a pixel over its height
    projection : of a calibrated camera, for a film of ``pixel_aspect`` 1
    field : {0, 1} or None; keep the even (0) or the odd rows (1) only
    """

    def __init__(
        self,
        film: FrameSource,
        pixel_aspect: float = 1.0,
        projection: Projection | None = None,
        field: int | None = None,
    ) -> None:
        super().__init__(film)
        if not ASPECTS[0] <= pixel_aspect <= ASPECTS[1]:
            raise VisionInputError(
                f"{film.path}: pixel aspect {pixel_aspect:g}; allowed {ASPECTS[0]:g} to {ASPECTS[1]:g} (`pixel_aspect`)"
            )
        self.aspect, self.projection, self.field = pixel_aspect, projection, field
        self.pixel_aspect, self.is_interlaced = 1.0, False
        # never fewer pixels than the film has
        self.stretch = (max(pixel_aspect, 1.0), max(1.0 / pixel_aspect, 1.0))
        self.width, self.height = (
            round(size * factor) for size, factor in zip((film.width, film.height), self.stretch, strict=True)
        )
        self._top = np.float32(saturated_grey(film))
        self.oversampling = self.stretch[0] * self.stretch[1] * (1.0 if field is None else 2.0)

    def to_film(self, rectified_px: NDArray[np.float64]) -> NDArray[np.float64]:
        points = (np.asarray(rectified_px, dtype=float) + 0.5) / self.stretch - 0.5
        return points if self.projection is None else self.projection.to_picture(points)

    def rectify(self, film_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rectified points, shape (..., 2)."""
        points = np.asarray(film_px, dtype=float)
        if self.projection is not None:
            points = self.projection.to_plane(points)
        return np.asarray((points + 0.5) * self.stretch - 0.5)

    def rectified_bodies(self, bodies: Sequence[Body]) -> list[Body]:
        return [replace(body, polygon_px=self.rectify(body.polygon_px)) for body in bodies]

    def field_difference(self, index: int) -> NDArray[np.float32]:
        """What rows interpolated between those of the field differ by from the other field, (height, width)."""
        both = RectifiedFilm(self.film, self.aspect, self.projection)
        whole = (0, self.height, 0, self.width)
        return np.asarray(self.read_region(index, *whole) - both.read_region(index, *whole))

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rows ``y0..y1-1`` and columns ``x0..x1-1`` of a resampled frame, float32; the saturated grey where they lie
        outside the film or it is saturated."""
        self._check_region(y0, y1, x0, x1)
        x, y = np.meshgrid(np.arange(x0, x1, dtype=float), np.arange(y0, y1, dtype=float))
        at = self.to_film(np.stack([x, y], axis=-1))
        step, start = (1, 0) if self.field is None else (2, self.field)
        at_x, at_y = at[..., 0], (at[..., 1] - start) / step
        height, width = -(-(self.film.height - start) // step), self.film.width
        left, right = _source_range(at_x, width)
        top, bottom = _source_range(at_y, height)
        first = top * step + start
        grey = self.film.read_region(index, first, first + (bottom - top - 1) * step + 1, left, right)
        grey = np.ascontiguousarray(grey[::step], dtype=np.float32)
        out = np.empty(at_x.shape, dtype=np.float32)
        sample_spline(coefficients(grey), grey, (at_x - left), (at_y - top), self._top, out)
        return out


def _source_range(at: NDArray[np.float64], size: int) -> tuple[int, int]:
    """First and end of the film's rows or columns that points need, at least two coefficients' filters wide."""
    low = int(np.clip(math.floor(float(at.min())) - MARGIN_PX, 0, max(size - 2 * MARGIN_PX, 0)))
    high = int(np.clip(math.ceil(float(at.max())) + MARGIN_PX + 1, min(low + 2 * MARGIN_PX, size), size))
    return low, high


@njit(cache=True, nogil=True)
def sample_spline(  # type: ignore[no-untyped-def]
    coefficient,
    grey,
    at_x,
    at_y,
    top,
    out,
):
    """Fill ``out`` (h, w) with the values of the cubic B-spline ``coefficient`` at points (``at_x``, ``at_y``), each
    (h, w), and with ``top`` outside the picture and where the pixel of ``grey`` reaches it."""
    rows, columns = coefficient.shape
    weight_x, weight_y = np.empty(4), np.empty(4)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x, y = at_x[i, j], at_y[i, j]
            if not (-0.5 <= x <= columns - 0.5 and -0.5 <= y <= rows - 0.5):
                out[i, j] = top
                continue
            nearest = grey[min(max(int(round(y)), 0), rows - 1), min(max(int(round(x)), 0), columns - 1)]
            if nearest >= top:
                out[i, j] = top
                continue
            left, above = int(math.floor(x)), int(math.floor(y))
            for weight, f in ((weight_x, x - left), (weight_y, y - above)):
                g = 1.0 - f
                weight[0] = g * g * g / 6.0
                weight[1] = 2.0 / 3.0 - f * f * (2.0 - f) / 2.0
                weight[2] = 2.0 / 3.0 - g * g * (2.0 - g) / 2.0
                weight[3] = f * f * f / 6.0
            total = 0.0
            for k in range(4):
                # the picture is mirrored at its edges
                row = abs(above - 1 + k)
                row = 2 * (rows - 1) - row if row >= rows else row
                line = 0.0
                for m in range(4):
                    column = abs(left - 1 + m)
                    column = 2 * (columns - 1) - column if column >= columns else column
                    line += weight_x[m] * coefficient[row, column]
                total += weight_y[k] * line
            out[i, j] = min(total, top - np.float32(1e-3))
