"""A body with a texture, a picture of it, and what a disturbance may change: for the films of the stress benchmark.

Shares no code with `vision`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

FINE = 6
HEIGHT, WIDTH = 190, 240
HALF_X, HALF_Y = 58.0, 36.0
PIVOT = (100.0, 95.0)
OUTLINE = [(-HALF_X, -HALF_Y), (HALF_X, -HALF_Y), (HALF_X, HALF_Y), (-HALF_X, HALF_Y)]
N, STILL = 60, 14
TEXTURES = ("speckle", "wood", "fine")
F64 = NDArray[np.float64]


def filtered_noise(rng: np.random.Generator, half: tuple[float, float], width: tuple[float, float]) -> F64:
    """Unit-variance Gaussian field over a box of half size ``half``, correlated over ``width`` px along x and y."""
    rows, columns = (int(2 * FINE * (size + 6.0)) for size in (half[1], half[0]))
    field_ = ndimage.gaussian_filter(rng.normal(size=(rows, columns)), (width[1] * FINE, width[0] * FINE))
    return np.asarray(field_ / field_.std())


def texture(kind: str, half: tuple[float, float], rng: np.random.Generator) -> F64:
    """Grey values of a surface on the fine grid: sprayed dots, bare wood along x, or fine felt of low contrast."""
    if kind == "speckle":
        return 110.0 + 45.0 * np.tanh(1.5 * filtered_noise(rng, half, (1.8, 1.8)))
    if kind == "wood":
        grain, fibre = filtered_noise(rng, half, (25.0, 2.2)), filtered_noise(rng, half, (6.0, 1.2))
        return 120.0 + 10.0 * grain + 5.0 * fibre
    return 100.0 + 9.0 * filtered_noise(rng, half, (1.1, 1.1))


@dataclass
class Plate:
    """A textured rectangle of half size ``half``, sampled by a cubic spline."""

    grid: F64
    half: tuple[float, float]
    coefficient: F64 = field(init=False)

    def __post_init__(self) -> None:
        self.coefficient = ndimage.spline_filter(self.grid, 3, mode="mirror")

    def over(self, picture: F64, pose: F64, scale: float = 1.0, squeeze: float = 1.0) -> F64:
        """Draw the plate at (turn ccw, x, y) over a picture, its edge blended over one pixel; ``squeeze`` is a further
        scale along its length."""
        y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
        c, s = np.cos(pose[0]), -np.sin(pose[0])
        dx, dy = (x - pose[1]) / scale, (y - pose[2]) / scale
        u, v = (c * dx + s * dy) / squeeze, c * dy - s * dx
        inside = np.clip(np.minimum(self.half[0] - abs(u), self.half[1] - abs(v)) + 0.5, 0.0, 1.0)
        where = inside > 0.0
        rows, columns = ((axis[where] + size + 6.0) * FINE for axis, size in ((v, self.half[1]), (u, self.half[0])))
        drawn = picture.copy()
        grey = ndimage.map_coordinates(self.coefficient, [rows, columns], order=3, mode="mirror", prefilter=False)
        drawn[where] += inside[where] * (grey - picture[where])
        return drawn


@dataclass
class Shot:
    """What a disturbance may change before the film is exposed; ``light`` and ``grey`` map a frame's number and picture
    before and after the noise."""

    rng: np.random.Generator
    pose: F64
    gain: F64 = field(default_factory=lambda: np.ones(N))
    scale: F64 = field(default_factory=lambda: np.ones(N))
    squeeze: F64 = field(default_factory=lambda: np.ones(N))  # along the body's length
    open_share: float = 0.0  # of a frame during which the shutter is open
    read_noise: float = 2.0
    noise: Callable[[F64], F64] | None = None
    light: Callable[[int, F64], F64] = lambda _, picture: picture
    grey: Callable[[int, F64], F64] = lambda _, picture: picture
    finished: Callable[[NDArray[np.uint8]], NDArray[np.uint8]] = lambda frames: frames


def progress() -> F64:
    s = np.clip((np.arange(N) - STILL - 1) / (N - STILL - 6), 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)
