"""When a gentle push begins: the edge of the force fitted, with its ringing, to some hundredths of a sample.

The arm rings on load cell and key, so that no level crossing tells when the torque changed: a crossing comes some 0.3
ms late, by another amount on each bench. Fitted is a damped oscillation towards a plateau, ``p (1 - exp(-a t) (cos w t
+ a/w sin w t))``, whose phase gives the beginning; mains hum is taken off first, as it is the same in every push.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.selftest.step_response import LEAD_S, PAUSE_S, PUSH_S, PUSHES

FITTED_S = 0.012
"""How much of a push is fitted."""
EARLIEST_S, LATEST_S = -2e-3, 15e-3
"""Where the edge is looked for, beside the time at which it should be."""
RINGING_HZ = (80.0, 2400.0)
HARMONICS = 3
SHAPE_SAMPLES = 0.1
"""Standard uncertainty for a bench that does not ring like the fitted curve, samples."""
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Edge:
    """A fitted edge: how late it is, its standard uncertainty, s, and the frequency at which the arm rings, Hz."""

    late_s: float
    u_s: float
    ringing_hz: float


def without_hum(force_n: Array, rate_hz: float, mains_hz: float, delay: int) -> Array:
    """Return the force less mains hum, fitted where nothing pushes: before the pushes and late in each pause."""
    lead, push, pause = (int(s * rate_hz) for s in (LEAD_S, PUSH_S, PAUSE_S))
    quiet = np.zeros(force_n.size, dtype=bool)
    quiet[:lead] = True
    for k in range(PUSHES):
        end = lead + (k + 1) * (push + pause) + delay
        quiet[end - pause // 2 : end] = True
    t = np.arange(force_n.size) / rate_hz
    waves = [f(2 * np.pi * order * mains_hz * t) for order in range(1, HARMONICS + 1) for f in (np.sin, np.cos)]
    terms = np.column_stack([np.ones(t.size), t, *waves])
    found, *_ = np.linalg.lstsq(terms[quiet], force_n[quiet], rcond=None)
    return force_n - terms @ found


def fit_edge(response_n: Array, rate_hz: float, at_sample: float) -> Edge | None:
    """Fit the beginning of the mean response to a push (n,), due at ``at_sample``; None where there is no push."""
    from scipy.optimize import least_squares  # start-up: 0.2 s that only a self-test needs

    t = (np.arange(response_n.size) - at_sample) / rate_hz
    plateau = float(response_n[int(2 * LATEST_S * rate_hz) : int(0.8 * PUSH_S * rate_hz)].mean())
    crossed = np.flatnonzero((response_n > 0.5 * plateau) & (t > EARLIEST_S) & (t < LATEST_S))
    if not np.isfinite(response_n).all() or plateau <= 0 or not crossed.size:
        return None
    crossing_s = float(t[crossed[0]])
    n = int(np.searchsorted(t, crossing_s + FITTED_S))
    t = t[:n]

    def curve(p: Array) -> Array:
        late, level, decay, w, rest = p
        after = np.maximum(t - late, 0.0)
        ringing = np.exp(-decay * after) * (np.cos(w * after) + decay / w * np.sin(w * after))
        return np.asarray(rest + level * (1.0 - ringing))

    bounds = (
        [EARLIEST_S, 0.2 * plateau, 1.0, 2 * np.pi * RINGING_HZ[0], -plateau],
        [LATEST_S, 3.0 * plateau, 3e4, 2 * np.pi * RINGING_HZ[1], plateau],
    )
    fits = [
        least_squares(
            lambda p: curve(p) - response_n[:n],
            [late, plateau, 200.0, 2 * np.pi * hz, 0.0],
            bounds=bounds,
            x_scale=[1e-4, plateau, 200.0, 1e3, 0.1 * plateau],
        )
        for late in np.clip(crossing_s - np.array([0.1e-3, 0.6e-3]), 0.99 * EARLIEST_S, 0.99 * LATEST_S)
        for hz in (150.0, 350.0, 600.0, 1000.0, 1800.0)
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    variance = 2 * best.cost / max(n - best.x.size, 1)
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * variance
    return Edge(
        float(best.x[0]),
        float(np.hypot(np.sqrt(covariance[0, 0]), SHAPE_SAMPLES / rate_hz)),
        float(best.x[3] / (2 * np.pi)),
    )
