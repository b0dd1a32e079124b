"""What the compiled loops of the pose fit take and give, as named tuples, which numba reads and Python may name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]


class Region(NamedTuple):
    """Part of a frame as B-spline coefficients; its first pixel lies at (``origin_x``, ``origin_y``) of the frame."""

    coefficient: F32
    origin_x: float
    origin_y: float


class Subset(NamedTuple):
    """Pixels of the template: ``offset`` (2, n), ``columns`` (4, n) their sensitivities to turn, x, y and gain, and
    ``covered`` (n), 1 for those another body hides; the centre of the body in the reference, and the largest offset."""

    offset: F32
    columns: F32
    covered: NDArray[np.uint8]
    centre_x: float
    centre_y: float
    radius: float


class State(NamedTuple):
    """What a fit starts from and leaves behind: ``pose`` (turn, x, y), ``weight`` (n) and the residuals' robust
    ``scale``; ``work`` (5, n): grey values, visible pixels (1 or 0), residuals, and with ``at`` (n) the `Places`."""

    pose: F64
    weight: F32
    work: F32
    at: I32
    scale: float


class Places(NamedTuple):
    """Where template pixels lie in a region: fractions (n) of a pixel past the coefficient that is one row and one
    column after that of index ``at`` (n)."""

    fx: F32
    fy: F32
    at: I32


class Settings(NamedTuple):
    """How the fit weights and when it stops: ``stop_u`` in standard uncertainties; ``gain_table`` is
    `bspline.noise_gain`."""

    gain_table: F64
    scale_floor: float
    tolerance_px: float
    stop_u: float
    max_iterations: int


class ResidualSums(NamedTuple):
    """Sums over the visible pixels, with their Tukey weights w: of w, w r^2, w v and w v^2 (residual r, grey value v);
    the pixels within three times the robust ``scale``, and the visible ones."""

    scale: float
    weight: float
    squares: float
    inlier: float
    seen: float
    value: float
    value2: float


class RigidFit(NamedTuple):
    """``iterations``, negative where the fit broke down; gain; weighted normal matrix (5, 5); mean noise gain."""

    iterations: int
    gain: float
    normal: F64
    sums: ResidualSums
    noise_gain: float
