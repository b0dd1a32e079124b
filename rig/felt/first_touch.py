"""Where the felt is first touched: the arm rests on it with a preload, so the zero of compression lies before the rest.

Fitted together are the felt's cubic (eq. 2.5), its loop as a share of the cubic, and the way from first touch to rest;
the force at rest is the preload.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError

Array = NDArray[np.float64]
DEEPEST_REST = 0.5
"""Share of the way that the preload may have taken up at most."""


@dataclass(frozen=True)
class FirstTouch:
    """Compression at rest, m, with the standard uncertainty that the scatter of the readings gives it."""

    rest_m: float
    u_rest_m: float


def first_touch(moved_m: Array, force_n: Array, loading: NDArray[np.bool_], u_n: Array, preload_n: float) -> FirstTouch:
    """Fit the compression at rest.

    Parameters
    ----------
    moved_m, force_n : (n,) compression since rest, force of the felt
    u_n : (n,) standard uncertainty of a reading as a force
    preload_n : force at rest

    Raises
    ------
    RigInputError
        The readings do not rise from the preload.
    """
    from scipy.optimize import least_squares  # start-up: 0.2 s that only the press of a felt needs

    span, top = float(moved_m.max()), float(force_n.max())
    sense = np.where(loading, 1.0, -1.0)
    u_preload = 0.1 * float(np.median(u_n))  # the preload's own error is one of the errors common to all points

    def residual(p: Array) -> Array:
        a, b, c, rest, share = p
        x = moved_m / span + rest
        at_rest = (((a * rest + b) * rest + c) * rest - preload_n / top) * top / u_preload
        fit = (((a * x + b) * x + c) * x) * (1.0 + share * sense)
        return np.append((fit - force_n / top) * top / u_n, at_rest)

    start = np.polyfit(moved_m / span, force_n / top, 3)
    slope = max(start[2], 0.05)
    guess = np.array([start[0], start[1], slope, min(preload_n / top / slope, 0.9 * DEEPEST_REST), 0.01])
    fit = least_squares(
        residual,
        guess,
        bounds=([-np.inf, -np.inf, 0.0, 0.0, -0.5], [np.inf, np.inf, np.inf, DEEPEST_REST, 0.5]),
        x_scale=[1.0, 1.0, 1.0, 0.01, 0.01],
    )
    rest = float(fit.x[3])
    if not fit.success or not 0.0 <= rest < 0.98 * DEEPEST_REST:
        raise RigInputError(
            f"felt: first touch not found: at rest the felt would be compressed by {1e3 * rest * span:.3g} mm of "
            f"{1e3 * span:.3g} mm; look at force.preload_n, or lighten the preload"
        )
    freedom = max(moved_m.size + 1 - 5, 1)
    widened = max(2.0 * float(fit.cost) / freedom, 1.0)
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * widened
    return FirstTouch(rest * span, float(np.sqrt(covariance[3, 3])) * span)
