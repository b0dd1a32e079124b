"""The template of a body: the pixels of the averaged still picture that are fitted, with their sensitivities.

Conventions: picture axes (y down), the body's centre is the centroid of its mask. Column order of the normal
matrix: turn (rad), x, y (px), gain, offset (grey). The reference grey values are centred, so that gain and
offset hardly correlate.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vision.errors import BodyError
from vision.fitting.bspline import gradient, slope_noise_gain

PATCH_PX = 8  # of the picture kept around a body: what a blur of a few pixels reaches
MOST_CONDITION = 1e9  # of a normal matrix of columns of length one: beyond it they are not told apart
TUKEY = 4.685  # Tukey's constant of robust weights: 95 % efficiency on normal noise
TILE_PX = 8
"""Side of the squares in which the pixels are kept together, so that loops over them find their neighbours near."""
T = TypeVar("T")


@dataclass(frozen=True)
class Template:
    """Pixels and sensitivities of one body."""

    name: str
    centre_px: tuple[float, float]
    """Centroid of the mask (x, y)."""
    offset_px: NDArray[np.float32]
    """(2, n): pixel positions (x, y) relative to the centre; squares of `TILE_PX` one after the other."""
    columns: NDArray[np.float32]
    """(4, n): derivative of the grey value by turn (grey per rad), by shift in x and y (grey per px), and the reference
    grey value less ``mean_grey``, which is the derivative by gain."""
    mean_grey: float
    normal: NDArray[np.float64]
    """(5, 5): sum of products of the five columns over the pixels."""
    radius_px: float
    """Largest distance of a pixel from the centre."""
    noise_normal: NDArray[np.float64]
    """(5, 5): part of ``normal`` that is expected from the noise left in the averaged picture, not from the body."""
    n_averaged: int
    """Frames in the averaged picture."""
    box_px: tuple[float, float, float, float]
    """Smallest and largest x and y offset: left, right, top, bottom."""
    noise_grey: float = 0.0
    """Standard deviation of one frame's noise, as found in the still frames; 0 when not known."""
    patch: NDArray[np.float32] | None = None
    """(height, width): the averaged picture around the body, whose first pixel is ``patch_corner_px`` (x, y)."""
    patch_corner_px: tuple[int, int] = (0, 0)
    _made: dict[Callable[[Template], Any], Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def get_or_make(self, make: Callable[[Template], T]) -> T:
        """What ``make`` makes of this template: made when first asked for, the same for every fitter."""
        if make not in self._made:
            self._made[make] = make(self)
        found: T = self._made[make]
        return found

    @property
    def n_pixels(self) -> int:
        return int(self.offset_px.shape[1])


def design_columns(
    picture: NDArray[Any], mask: NDArray[np.bool_], centre_px: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Sensitivities (n, 5) of the masked pixels of a picture, row by row: grey per rad of turn about ``centre_px`` (x,
    y), per px along x and along y, grey less its mean, one; and offsets dx, dy (n,), px, from the centre."""
    slope_x, slope_y = gradient(picture)
    rows, cols = np.nonzero(mask)
    dx, dy = cols.astype(float) - centre_px[0], rows.astype(float) - centre_px[1]
    gx, gy = slope_x[rows, cols].astype(float), slope_y[rows, cols].astype(float)
    grey = np.asarray(picture, dtype=float)[rows, cols]
    columns: NDArray[np.float64] = np.column_stack([gy * dx - gx * dy, gx, gy, grey - grey.mean(), np.ones_like(grey)])
    return columns, dx, dy


def build_template(
    name: str,
    picture: NDArray[Any],
    mask: NDArray[np.bool_],
    n_averaged: int,
    max_pixels: int | None = None,
    noise_grey: float = 0.0,
) -> Template:
    """Prepare a body for tracking: the pixels of a ``mask`` in the averaged still ``picture``, of them at most
    ``max_pixels`` that tell most about the angle; ``noise_grey``: of one frame. `BodyError` without texture."""
    rows, cols = np.nonzero(mask)
    centre = (float(cols.mean()), float(rows.mean()))
    left, top = (max(0, int(where.min()) - PATCH_PX) for where in (cols, rows))
    columns, dx, dy = design_columns(picture, mask, centre)
    inverse = invert_normal(columns.T @ columns)
    if inverse is None:
        raise BodyError(f"body {name}: its region has no texture to follow; draw it over a textured surface")
    if max_pixels is not None and max_pixels < dx.size:
        best = _select_best_pixels(columns, inverse, max_pixels)
        columns, dx, dy = columns[best], dx[best], dy[best]
        inverse = invert_normal(columns.T @ columns)
        if inverse is None:
            raise BodyError(f"body {name}: {max_pixels} pixels do not fix its pose; allow more")
    order = np.lexsort((np.floor((dx - dx.min()) / TILE_PX), np.floor((dy - dy.min()) / TILE_PX)))
    columns, dx, dy = columns[order], dx[order], dy[order]
    mean_grey = float(np.asarray(picture, dtype=float)[mask].mean())
    return Template(
        name=name,
        centre_px=centre,
        offset_px=np.stack([dx, dy]).astype(np.float32),
        columns=np.ascontiguousarray(columns[:, :4].T, dtype=np.float32),
        mean_grey=mean_grey,
        normal=columns.T @ columns,
        radius_px=float(np.hypot(dx, dy).max()),
        noise_normal=noise_normal_matrix(dx, dy, noise_grey**2 / n_averaged),
        n_averaged=n_averaged,
        box_px=(float(dx.min()), float(dx.max()), float(dy.min()), float(dy.max())),
        noise_grey=noise_grey,
        patch=np.array(picture[top : rows.max() + PATCH_PX + 1, left : cols.max() + PATCH_PX + 1], dtype=np.float32),
        patch_corner_px=(left, top),
    )


def thin_template(template: Template, max_pixels: int) -> Template:
    """Template of the ``max_pixels`` pixels that tell most about angle and position, its centre unchanged; the template
    itself where it has no more."""
    design = np.vstack([template.columns, np.ones(template.n_pixels)]).T.astype(float)
    inverse = invert_normal(template.normal)
    if inverse is None or max_pixels >= template.n_pixels:
        return template
    best = _select_best_pixels(design, inverse, max_pixels)
    (dx, dy), columns = template.offset_px[:, best].astype(float), design[best]
    return replace(
        template,
        offset_px=np.ascontiguousarray(template.offset_px[:, best]),
        columns=np.ascontiguousarray(template.columns[:, best]),
        normal=columns.T @ columns,
        noise_normal=noise_normal_matrix(dx, dy, template.noise_grey**2 / template.n_averaged),
        radius_px=float(np.hypot(dx, dy).max()),
        box_px=(float(dx.min()), float(dx.max()), float(dy.min()), float(dy.max())),
    )


def invert_normal(normal: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Inverse of a normal matrix, or None when the columns do not fix all five parameters."""
    diagonal = normal.diagonal()
    # a single number that is not finite makes the sum non-finite
    if not (diagonal.min() > 0.0 and math.isfinite(normal.sum())):
        return None
    scale = 1.0 / np.sqrt(diagonal)
    both = scale[:, None] * scale
    try:
        inverse = np.linalg.inv(normal * both)
    except np.linalg.LinAlgError:
        return None
    # the columns are scaled to length one, so the inverse is as large as the condition number
    if not np.abs(inverse).max() < MOST_CONDITION or inverse.diagonal().min() <= 0.0:
        return None
    return inverse * both


def noise_normal_matrix(dx: NDArray[np.float64], dy: NDArray[np.float64], variance: float) -> NDArray[np.float64]:
    """Expected normal matrix (5, 5) of white noise of a variance alone, of pixels at offsets (n,): its slopes look like
    texture, as much in x as in y."""
    noise = np.diag([np.sum(dx * dx + dy * dy), dx.size, dx.size, 0.0, 0.0])
    noise[0, 1] = noise[1, 0] = -np.sum(dy)
    noise[0, 2] = noise[2, 0] = np.sum(dx)
    noise *= slope_noise_gain()
    noise[3, 3] = dx.size
    return noise * variance


def _select_best_pixels(columns: NDArray[np.float64], inverse: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Indices, in raster order, of the ``count`` pixels with the largest influence on angle and position; ``columns``
    (n, 5), ``inverse`` (5, 5)."""
    influence = columns @ inverse
    angle = influence[:, 0] ** 2 / inverse[0, 0]
    position = influence[:, 1] ** 2 / inverse[1, 1] + influence[:, 2] ** 2 / inverse[2, 2]
    # the angle is what is wanted, but a fit whose position is loose loses it too
    score = angle + 0.1 * position
    return np.sort(np.argpartition(score, -count)[-count:])
