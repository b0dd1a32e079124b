"""A line through readings over reference values, with its uncertainties."""

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


LARGEST_U_SLOPE = 0.2  # of the slope: five standard uncertainties from none


def fit_line(reference: ArrayLike, reading: ArrayLike, where: str) -> LineFit:
    """Fit readings (n,) = zero + slope x reference (n,) by least squares, with standard uncertainties; refuse fewer
    than 4 at 3 values, and readings that do not follow, naming ``where``.

    The scatter is that about the line (n - 2 degrees of freedom), so that nonlinearity and hysteresis are in the
    uncertainty.
    """
    from scipy.stats import linregress  # start-up: half a second that only a calibration needs

    x, y = as_numbers(reference, where, 1), as_numbers(reading, where, 1)
    if x.size < 4 or np.unique(x).size < 3:  # two unknowns, and at least one more value that can contradict
        raise RigInputError(f"{where}: {x.size} readings at {np.unique(x).size} values, allowed from 4 at 3 values")
    line = linregress(x, y)
    off = y - line.intercept - line.slope * x
    if line.slope == 0.0 or not np.isfinite(line.slope) or line.stderr >= LARGEST_U_SLOPE * abs(line.slope):
        raise RigInputError(
            f"{where}: the readings do not follow the values ({line.slope:.4g}, u {line.stderr:.2g}); look at the "
            "wiring"
        )
    hysteresis = max(np.ptp(y[x == value]) for value in np.unique(x))
    stated = (line.intercept, line.slope, line.intercept_stderr, line.stderr, np.abs(off).max(), hysteresis)
    return LineFit(*map(float, stated))


LARGEST_CORRECTION = 0.1  # of a gain: a larger one is a wrong scale, wire or sign, no error of the sensor
