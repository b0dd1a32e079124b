"""Times at which a signal crosses a level, with their uncertainty: NaN samples are never part of a crossing.

Every time is a sub-sample crossing by straight lines between two samples (without it a time would carry dt/√12), whose
standard uncertainty comes from moving the level by its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array


def find_runs(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """First sample and end of each stretch in which a mask (n,) holds, (k, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))).reshape(-1, 2)


def find_equal_runs(values: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last samples (k,) of the stretches of equal values that make up a signal (n,)."""
    edges = np.flatnonzero(np.diff(values) != 0)
    return np.concatenate([[0], edges + 1]), np.concatenate([edges, [values.size - 1]])


def up_crossings(time_s: Array, signal: Array, level: float, hysteresis: float = 0.0) -> list[float]:
    """Times, s, increasing, by linear interpolation, at which a ``signal`` (n,) at times ``time_s`` (n,) rises through
    ``level``; the next one counts only after it has fallen below ``level - hysteresis``. NaN samples have no crossing.

    Parameters
    ----------
    time_s, signal : (n,)
    hysteresis : after a crossing the signal must fall below ``level - hysteresis`` before the next one counts, so that
        noise around the level makes one crossing, not many
    """
    above = signal >= level
    if hysteresis == 0.0:
        turns = 1 + np.flatnonzero(above[1:] & (signal[:-1] < level))
    else:
        state = np.zeros(len(signal), dtype=np.int8)  # NaN stays 0: the state before goes on
        state[above] = 1
        state[signal < level - hysteresis] = -1
        known = np.flatnonzero(state)
        turns = known[1:][np.diff(state[known]) == 2]
    times = []
    for i in turns:
        if not signal[i - 1] < level:  # the sample before was lost
            continue
        share = (level - signal[i - 1]) / (signal[i] - signal[i - 1])
        times.append(float(time_s[i - 1] + share * (time_s[i] - time_s[i - 1])))
    return times


def down_crossings(time_s: Array, signal: Array, level: float, hysteresis: float = 0.0) -> list[float]:
    """Times at which a signal falls through a level, s; the mirror image of `up_crossings`."""
    return up_crossings(time_s, -np.asarray(signal), -level, hysteresis)


def bend_uncertainty_s(time_s: Array, signal: Array, at_s: float) -> float:
    """Standard uncertainty, s, that the curvature of a ``signal`` (n,) at times ``time_s`` (n,) adds to a level
    crossing interpolated linearly at ``at_s``, s; 0 where the signal does not change there.

    The line is off by up to a·dt²/8 for a second derivative a, in root mean square by √(8/15) of that.
    """
    i = int(np.clip(np.searchsorted(time_s, at_s), 2, len(time_s) - 2))
    near = np.asarray(signal, dtype=float)[i - 2 : i + 2]
    slope = abs(near[2] - near[1]) / (time_s[i] - time_s[i - 1])
    bend = float(np.abs(np.diff(near, 2)).max()) / 8
    return math.sqrt(8 / 15) * bend / slope if slope > 0 else 0.0


def find_last_fall(time_s: Array, signal: Array, level: float) -> float | None:
    """Last time, s, at which a ``signal`` (n,) falls through ``level``, by linear interpolation; None when it was never
    above, is above in the last sample, or its next sample is NaN."""
    above = np.flatnonzero(signal > level)
    if above.size == 0 or above[-1] + 1 >= signal.size or not np.isfinite(signal[above[-1] + 1]):
        return None
    i = int(above[-1])
    share = (signal[i] - level) / (signal[i] - signal[i + 1])
    return float(time_s[i] + share * (time_s[i + 1] - time_s[i]))


def select_first_after(times: list[float], after_s: float) -> float | None:
    return next((t for t in times if t >= after_s), None)


def read_level_with_uncertainty(
    find: Callable[[float], float | None], level: float, u_level: float
) -> tuple[float | None, float]:
    """Result of ``find(level)``, and its standard uncertainty from finding again at levels ``u_level`` (and thrice
    that) above and below; (None, NaN) where nothing is found, an uncertainty of NaN where nothing is at one of the
    nearer two.

    A finder that jumps to another oscillation when the level moves gets the large uncertainty it deserves.
    """
    value = find(level)
    if value is None:
        return None, float("nan")
    if u_level <= 0:
        return value, 0.0
    sides = [find(level - u_level), find(level + u_level)]
    if any(other is None for other in sides):
        return value, float("nan")
    # a slow signal is a staircase of counts: three times the shift tells its slope where one may stay on a step
    wide = [find(level - 3 * u_level), find(level + 3 * u_level)]
    spread = max(abs(other - value) for other in sides if other is not None)
    spread = max([spread, *(abs(other - value) / 3 for other in wide if other is not None)])
    return value, float(spread)


LevelReading = Callable[[Callable[[float], float | None], float, float], tuple[float | None, float]]


def read_level(find: Callable[[float], float | None], level: float, u_level: float) -> tuple[float | None, float]:
    """Value of ``find(level)`` and u 0: a stand-in for `read_level_with_uncertainty` in half the time."""
    return find(level), 0.0
