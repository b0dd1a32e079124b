"""Robust linear least squares: pixels that are occluded, duplicated or glossy are outliers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

ROUNDS = 2
"""Of fits: one to find what lies far off, one without it."""
LEAST_SPREAD_GREY = 1e-3
"""Standard deviation of residuals that is taken at least, grey: a drawn picture without noise leaves none."""


def fit_robustly(
    design: F64,
    difference: F64,
    usable: NDArray[np.bool_],
    *,
    outlying: float,
    pixels_per_column: int,
    most_condition: float,
) -> tuple[F64, F64] | None:
    """Amplitudes (p,) of the columns of ``design`` (p, n) in a difference of grey values (n,), and their covariance.

    Residuals beyond ``outlying`` standard deviations, by their median, are left out. None with fewer usable pixels than
    ``pixels_per_column`` for each column, or where the condition number of the normal matrix is above
    ``most_condition``.
    """
    kept = usable
    for _ in range(ROUNDS):
        if np.count_nonzero(kept) < pixels_per_column * len(design):
            return None
        some = design[:, kept]
        normal = some @ some.T
        if np.linalg.cond(normal) > most_condition:
            return None
        inverse = np.linalg.inv(normal)
        amplitude: F64 = inverse @ (some @ difference[kept])
        rest = difference - amplitude @ design
        spread = max(1.4826 * float(np.median(np.abs(rest[kept]))), LEAST_SPREAD_GREY)
        kept = usable & (np.abs(rest) <= outlying * spread)
    return np.asarray(amplitude, dtype=np.float64), np.asarray(inverse * spread**2, dtype=np.float64)
