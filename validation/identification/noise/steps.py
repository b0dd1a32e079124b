"""Where a fit goes next: the least of the linear model in a box, damped as Marquardt does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array
from validation.identification.noise.marginal import Marginal

LEAST_DAMPING = 0.03
MOST_BOUNDS = 8  # rounds in which values are held at the ends of what is allowed


def box_step(marginal: Marginal, here: Sequence[Array], z: Array, box: tuple[Array, Array], damping: float) -> Array:
    """Step (p,) to the minimum of the linear model in a box, shortened by Marquardt's damping.

    Parameters
    ----------
    marginal : Marginal
        The linear model at z.
    here : residuals at z, of each trial
    z : (p,)
    box : lowest and highest z
    damping : of the diagonal of the curvature, that is added to it
    """
    low, high = box
    slope, curvature = marginal.slope(here, z), marginal.curvature
    damped = curvature + damping * np.diag(np.diag(curvature))
    free, step = np.ones(z.size, dtype=bool), np.zeros(z.size)
    for _ in range(MOST_BOUNDS):
        rest = slope[free] - damped[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(damped[np.ix_(free, free)], rest)
        out = free & ((z + step < low) | (z + step > high))
        if not out.any():
            break
        step[out] = np.clip(z + step, low, high)[out] - z[out]
        free &= ~out
    return np.clip(z + step, low, high) - z


def largest_step(
    marginal: Marginal, here: Sequence[Array], z: Array, box: tuple[Array, Array], watched: NDArray[np.intp]
) -> float:
    """Largest change of what is watched in the whole step from z, in its posterior standard uncertainties."""
    width = np.sqrt(np.diag(marginal.covariance)[: marginal.p])
    return float(np.max((np.abs(box_step(marginal, here, z, box, 0.0)) / width)[watched]))


def dampings(last: float) -> list[float]:
    """Dampings to try in turn."""
    first = max(last, LEAST_DAMPING)
    return [last] + [first * 10.0**k for k in range(0 if last < LEAST_DAMPING else 1, 5)]
