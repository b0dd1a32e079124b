"""When a joint would have to pull: for the key's, intervals in which the key would leave its balance rail.

The model holds the key by a revolute joint; the real key only lies on the rail (thesis Sections 3.2.2, 4.1). Where the
joint's force on the key points down, the key is predicted to lift. How far, a scene with a one-sided rail says
(effect ``balance_rail``): there the key does lift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tension:
    """An interval in which the rail would have to pull: its ends (s), largest pull (N) and when, impulse (N s)."""

    start_s: float
    end_s: float
    largest_n: float
    largest_at_s: float
    impulse_ns: float


def tensions(time_s: Array, upwards_n: Array) -> list[Tension]:
    """Intervals in which the force of the rail on the key (m,) points down; straight lines between the times (m,)."""
    turn = np.flatnonzero((upwards_n[:-1] < 0.0) != (upwards_n[1:] < 0.0))
    share = upwards_n[turn] / (upwards_n[turn] - upwards_n[turn + 1])
    crossing = time_s[turn] + share * (time_s[turn + 1] - time_s[turn])
    edges = np.concatenate([[time_s[0]], crossing, [time_s[-1]]]) if len(time_s) else np.empty(0)
    out = []
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        inside = (time_s > a) & (time_s < b)
        if b <= a or not np.any(upwards_n[inside] < 0.0):
            continue
        at = np.concatenate([[a], time_s[inside], [b]])
        pull = -np.concatenate(
            [[np.interp(a, time_s, upwards_n)], upwards_n[inside], [np.interp(b, time_s, upwards_n)]]
        )
        k = int(np.argmax(pull))
        impulse = float(np.trapezoid(pull, at))
        out.append(Tension(float(a), float(b), float(pull[k]), float(at[k]), impulse))
    return out


@dataclass(frozen=True)
class Lift:
    """An interval in which the key is off its rail: its ends (s), greatest height (m) and when."""

    start_s: float
    end_s: float
    largest_m: float
    largest_at_s: float


def lifts(time_s: Array, depth_m: Array) -> list[Lift]:
    """Intervals in which the felt of the rail is not touched; its depth (m,) is negative there."""
    return [Lift(one.start_s, one.end_s, one.largest_n, one.largest_at_s) for one in tensions(time_s, depth_m)]
