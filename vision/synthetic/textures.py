"""Textures with a closed form: speckle and wood grain, sums of Gaussian blobs that can be evaluated anywhere.

Conventions: coordinates in pixels on the body (its own axes), grey values of 8 bit. A texture is reproducible
from its seed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

DOT_HEIGHTS = (0.8, 1.2)  # of sprayed dots, over their mean: choice
FIBRES, RINGS = (0.05, 1.5), (0.015, 1.0)  # scatter of the direction, rad, and crowding: choice
LENGTHS, HEIGHTS, WIDTHS = (0.7, 1.3), (0.6, 1.4), (0.85, 1.3)  # of fibres and rings, over their mean: choice
REACH = 5.0  # a blob is taken as zero beyond this many of its widths (4e-6 of its height)


@dataclass(frozen=True)
class BlobTexture:
    """Sum of Gaussian blobs, each with its own place, height, widths and direction, on a mean grey."""

    mean_grey: float
    # x, y: (n,), centres
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    height: NDArray[np.float64]  # (n,), grey, either sign
    # along, across: (n,), standard deviations along and across the blob's direction, px
    along: NDArray[np.float64]
    across: NDArray[np.float64]
    direction: NDArray[np.float64]  # (n,), angle of the long axis from x towards y, rad

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Grey value at scattered points, straight from the formula."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        grey = np.full(np.broadcast(x, y).shape, self.mean_grey)
        for i in range(self.x.size):
            grey += self._blob(i, x - self.x[i], y - self.y[i])
        return grey

    def evaluate_grid(self, x0: float, y0: float, step: float, rows: int, columns: int) -> NDArray[np.float32]:
        """Grey values (rows, columns) on a grid of spacing ``step``, px, whose first point is at (x0, y0), px, in the
        body's axes."""
        grey = np.full((rows, columns), self.mean_grey)
        grid_x = x0 + step * np.arange(columns)
        grid_y = y0 + step * np.arange(rows)
        for i in range(self.x.size):
            c, s = abs(np.cos(self.direction[i])), abs(np.sin(self.direction[i]))
            reach_x = REACH * np.hypot(self.along[i] * c, self.across[i] * s)
            reach_y = REACH * np.hypot(self.along[i] * s, self.across[i] * c)
            left, right = np.searchsorted(grid_x, (self.x[i] - reach_x, self.x[i] + reach_x))
            top, bottom = np.searchsorted(grid_y, (self.y[i] - reach_y, self.y[i] + reach_y))
            if left == right or top == bottom:
                continue
            dx, dy = grid_x[left:right] - self.x[i], grid_y[top:bottom, None] - self.y[i]
            grey[top:bottom, left:right] += self._blob(i, dx, dy)
        return grey.astype(np.float32)

    def _blob(self, i: int, dx: NDArray[np.float64], dy: NDArray[np.float64]) -> NDArray[np.float64]:
        c, s = np.cos(self.direction[i]), np.sin(self.direction[i])
        u, v = (c * dx + s * dy) / self.along[i], (c * dy - s * dx) / self.across[i]
        return self.height[i] * np.exp(-0.5 * (u * u + v * v))


def speckle(
    extent: tuple[float, float, float, float],
    seed: int,
    *,
    sigma_px: float = 1.6,  # choice: dots of four pixels
    contrast_grey: float = 38.0,  # choice: not saturated
    mean_grey: float = 128.0,  # the middle of 8 bit
) -> BlobTexture:
    """Texture of sprayed dots of both signs, each of standard deviation ``sigma_px``, that fills ``extent`` (x0, y0,
    x1, y1), px, with mean and standard deviation of the grey values ``mean_grey`` and ``contrast_grey``.

    Parameters
    ----------
    extent : (x0, y0, x1, y1), region to fill, px
    sigma_px : width of a dot (standard deviation); its visible diameter is about 2.4 times that
    contrast_grey : standard deviation of the grey value
    """
    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = extent
    area = (x1 - x0) * (y1 - y0)
    n = max(1, round(area / (4.0 * sigma_px) ** 2 * 2.0))
    sign = rng.choice([-1.0, 1.0], n)
    # variance of a shot noise of Gaussians: density * height^2 * pi * sigma^2
    height = contrast_grey / np.sqrt(n / area * np.pi * sigma_px**2)
    width = np.full(n, sigma_px)
    return BlobTexture(
        mean_grey, rng.uniform(x0, x1, n), rng.uniform(y0, y1, n), sign * height * rng.uniform(*DOT_HEIGHTS, n),
        width, width, np.zeros(n),
    )  # fmt: skip


def wood_grain(
    extent: tuple[float, float, float, float],
    seed: int,
    *,
    direction_rad: float = 0.0,
    fibre_px: tuple[float, float] = (9.0, 1.7),  # choice: maple at 3 px/mm
    ring_px: tuple[float, float] = (60.0, 4.5),  # as above
    contrast_grey: float = 16.0,  # choice: bare wood
    mean_grey: float = 140.0,  # as above
) -> BlobTexture:
    """Texture of bare wood that fills ``extent`` (x0, y0, x1, y1), px: thin fibres and broader rings along one
    direction, with little texture along the grain.

    Parameters
    ----------
    extent : (x0, y0, x1, y1), region to fill, px
    direction_rad : grain direction from x towards y
    fibre_px, ring_px : (along, across), widths (standard deviations) of fibres and rings
    contrast_grey : standard deviation of the grey value, of which fibres and rings have equal shares of the variance
    """
    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = extent
    margin = 2.0 * ring_px[0]
    parts = []
    for (along, across), spread, crowd in ((fibre_px, *FIBRES), (ring_px, *RINGS)):
        left, right, top, bottom = x0 - margin, x1 + margin, y0 - margin, y1 + margin
        area = (right - left) * (bottom - top)
        n = max(1, round(crowd * area / (4.0 * np.pi * along * across)))
        height = contrast_grey * np.sqrt(0.5) / np.sqrt(n / area * np.pi * along * across)
        length = along * rng.uniform(*LENGTHS, n)
        parts.append(
            (
                rng.uniform(left, right, n),
                rng.uniform(top, bottom, n),
                height * rng.choice([-1.0, 1.0], n) * rng.uniform(*HEIGHTS, n),
                length,
                across * rng.uniform(*WIDTHS, n),
                direction_rad + spread * rng.standard_normal(n),
            )
        )
    x, y, height_all, along_all, across_all, direction = (np.concatenate(part) for part in zip(*parts, strict=True))
    near = (x > x0 - REACH * along_all) & (x < x1 + REACH * along_all)
    near &= (y > y0 - REACH * along_all) & (y < y1 + REACH * along_all)
    return BlobTexture(
        mean_grey, x[near], y[near], height_all[near], along_all[near], across_all[near], direction[near]
    )
