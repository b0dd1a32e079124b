"""Intervals in which the balance rail cannot hold the key: predicted tension of a joint, lift of a key that is free.

The model holds the key by a revolute joint; the real key only lies on the rail (thesis Sections 3.2.2, 4.1). Where the
joint's force on the key points down, the key is predicted to lift. By how much needs a scene with a one-sided rail
(effect ``balance_rail``), in which the key does lift.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.files.time_table import two_columns

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RailTension:
    """An interval in which the rail would have to pull: its ends (s), largest pull (N) and when, impulse (N s)."""

    start_s: float
    end_s: float
    largest_n: float
    largest_at_s: float
    impulse_ns: float


@dataclass(frozen=True)
class RailLift:
    """An interval in which the key is off its rail: its ends (s), greatest height (m) and when."""

    start_s: float
    end_s: float
    largest_m: float
    largest_at_s: float


class _Negative(NamedTuple):
    """An interval in which a signal is negative: its ends, largest size below zero and when, integral of that size."""

    start_s: float
    end_s: float
    largest: float
    largest_at_s: float
    integral: float


def _negative_intervals(time_s: ArrayLike, signal: ArrayLike) -> Iterator[_Negative]:
    """Intervals of a sampled signal (m,), straight lines between the samples."""
    time_s, signal = two_columns(time_s, signal, "signal of the rail")
    turn = np.flatnonzero((signal[:-1] < 0.0) != (signal[1:] < 0.0))
    share = signal[turn] / (signal[turn] - signal[turn + 1])
    crossing = time_s[turn] + share * (time_s[turn + 1] - time_s[turn])
    edges = np.concatenate([[time_s[0]], crossing, [time_s[-1]]]) if len(time_s) else np.empty(0)
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        inner = (time_s > start) & (time_s < end)
        if end <= start or not np.any(signal[inner] < 0.0):
            continue
        at = np.concatenate([[start], time_s[inner], [end]])
        ends = np.interp([start, end], time_s, signal)
        size = -np.concatenate([ends[:1], signal[inner], ends[1:]])
        k = int(np.argmax(size))
        yield _Negative(float(start), float(end), float(size[k]), float(at[k]), float(np.trapezoid(size, at)))


def tensions(time_s: ArrayLike, upwards_n: ArrayLike) -> list[RailTension]:
    """Intervals in which the force of the rail on the key points down: there the rail would have to pull.

    Parameters
    ----------
    time_s : (m,) increasing, s
    upwards_n : (m,) force of the rail on the key, N, positive upwards

    Returns
    -------
    list of RailTension
        Ends, s, largest pull, N, and when, impulse, N s.

    Examples
    --------
    >>> import numpy as np
    >>> import model
    >>> pull, = model.inside.tensions(np.array([0.0, 1.0, 2.0]), np.array([4.0, -4.0, 4.0]))
    >>> pull.largest_n, pull.impulse_ns
    (4.0, 2.0)
    """
    return [RailTension(*interval) for interval in _negative_intervals(time_s, upwards_n)]


def lifts(time_s: ArrayLike, depth_m: ArrayLike) -> list[RailLift]:
    """Intervals in which the felt of the rail is not touched.

    Parameters
    ----------
    time_s : (m,) increasing, s
    depth_m : (m,) depth of the felt, m, negative where the key is off it

    Returns
    -------
    list of RailLift
        Ends, s, greatest height, m, and when.

    Examples
    --------
    >>> import numpy as np
    >>> import model
    >>> lift, = model.inside.lifts(np.array([0.0, 1.0, 2.0]), np.array([1e-3, -1e-3, 1e-3]))
    >>> lift.start_s, lift.end_s, lift.largest_m
    (0.5, 1.5, 0.001)
    """
    return [RailLift(*interval[:4]) for interval in _negative_intervals(time_s, depth_m)]


Tension = RailTension  # former names
Lift = RailLift
