"""A straight line through readings at reference values, and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rig.arrays import as_numbers
from rig.errors import RigInputError


@dataclass(frozen=True)
class LineFit:
    """Reading = ``zero`` + ``slope`` x reference; standard uncertainties from the scatter about the line.

    ``worst`` is the largest distance from the line, ``hysteresis`` the largest difference of readings at one reference
    value, both in units of the reading.
    """

    zero: float
    slope: float
    u_zero: float
    u_slope: float
    worst: float
    hysteresis: float


def fit_line(reference: ArrayLike, reading: ArrayLike, where: str) -> LineFit:
    """Fit a line by least squares.

    The scatter is that about the line (n - 2 degrees of freedom), so that nonlinearity and hysteresis are in the
    uncertainty.

    Raises
    ------
    RigInputError
        With fewer than four readings at three different references, or a slope of zero.
    """
    x, y = as_numbers(reference, where, 1), as_numbers(reading, where, 1)
    if x.size < 4 or np.unique(x).size < 3:
        raise RigInputError(f"{where}: {x.size} readings at {np.unique(x).size} values, allowed from 4 at 3 values")
    centred = x - x.mean()
    spread = float(centred @ centred)
    slope = float(centred @ y) / spread
    zero = float(y.mean() - slope * x.mean())
    off = y - zero - slope * x
    scatter = float(np.sqrt(off @ off / (x.size - 2)))
    u_slope = scatter / np.sqrt(spread)
    if slope == 0.0 or not np.isfinite(slope) or u_slope >= 0.2 * abs(slope):
        raise RigInputError(
            f"{where}: the readings do not follow the values ({slope:.4g}, u {u_slope:.2g}); look at the wiring"
        )
    u_zero = scatter * np.sqrt(1.0 / x.size + x.mean() ** 2 / spread)
    same = [np.ptp(y[x == value]) for value in np.unique(x)]
    return LineFit(zero, slope, float(u_zero), float(u_slope), float(np.abs(off).max()), float(max(same)))
