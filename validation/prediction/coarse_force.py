"""A force table with fewer points that moves an action as the full one does, for draws of the uncertain inputs.

Conventions: straight lines between points, s and N. A sampled force bends at each of its samples, and no step of an
integrator may cross a bend; an action does not follow what happens within a millisecond. The coarse force is the
piecewise linear one that differs least from the samples (least squares), so that impulses over a few points are kept.
Its angles differ from those of the full table by some hundredths of what the draws scatter
(docs/explanation/uncertainty.md).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from validation.conventions import Array

SPACING_S = 6e-4


def coarse_force(time_s: Array, force_n: Array, spacing_s: float = SPACING_S) -> tuple[Array, Array]:
    """Least-squares piecewise linear force on every k-th sample time, at most ``spacing_s`` apart, and on the last.

    Parameters
    ----------
    time_s : (n,) array
        Increasing.
    force_n : (n,) array
    spacing_s : float

    Returns
    -------
    (times, forces)
        (m,) each; the table itself where its samples are too far apart to be thinned.
    """
    every = int(spacing_s / float(np.median(np.diff(time_s))) * (1 + 1e-9)) if time_s.size > 1 else 1
    if every < 2 or time_s.size < 2 * every:
        return time_s, force_n
    knots = np.append(time_s[:-1:every], time_s[-1])
    count = knots.size
    left = np.clip(np.searchsorted(knots, time_s, side="right") - 1, 0, count - 2)
    right_share = (time_s - knots[left]) / (knots[left + 1] - knots[left])
    left_share = 1.0 - right_share

    def total(at_left: Array, at_right: Array) -> Array:
        return np.asarray(np.bincount(left, at_left, count) + np.bincount(left + 1, at_right, count), dtype=float)

    normal = np.zeros((2, count))  # upper diagonal and diagonal of the hat functions' normal equations
    normal[0, 1:] = np.bincount(left, left_share * right_share, count)[:-1]
    normal[1] = total(left_share**2, right_share**2)
    return knots, np.asarray(solveh_banded(normal, total(left_share * force_n, right_share * force_n)))
