"""Repeatability of curves and events over the trials of one session (thesis Section 3.2.2, in numbers).

Conventions: curves are (n_samples, n_trials); NaN is lost and left out sample by sample. One trial gives NaN and a
note, never zero. Where a session has several kinds of stroke, scatter is that within each kind, pooled.
Source: ISO 5725-2 for s_r and for the limit r = t√2·s_r below which 95 % of differences of two trials should
fall; with few trials Student's t replaces 1.96 (3.93 instead of 2.8 at n = 5); the interval of s is that of
the chi-square distribution.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import chdtri, stdtrit

from validation.conventions import CONFIDENCE, LEVEL, Array
from validation.curves.table import interpolate_to_base_times
from validation.events.definitions import EVENTS, Event
from validation.scores.traces import select_scored_angles


def interpolate_to_base(time_s: Array, frames: dict[int, pd.DataFrame], column: str) -> Array:
    """Column of several trials' tables (``frames`` by trial number) interpolated linearly to common times ``time_s``
    (n_samples,), (n_samples, n_trials) in the order of ``frames``; NaN outside a trial and, of a measured angle, where
    it is not scored.

    Sample times that agree are taken as they are; others are interpolated by straight lines.
    """
    out = np.full((time_s.size, len(frames)), np.nan)
    for j, frame in enumerate(frames.values()):
        time = frame["time_s"].to_numpy()
        channel = column.removesuffix("_measured_rad")
        values = frame[column].to_numpy() if channel == column else select_scored_angles(frame, channel)
        out[:, j] = interpolate_to_base_times(time_s, time, values)
    return out


RECOMMENDED_TRIALS = 10  # a standard deviation of so many is known to a quarter
FEWEST_TRIALS = 1 + math.ceil(-math.log2(LEVEL))  # with which a test of signs can reach its level, 2^(1 − n)
FEWEST_TO_STAND_OUT = 4  # of three, no one is told from the other two
STANDS_OUT = 4.0  # fewer than 3 % of good sessions of six trials (simulated in the tests)


@dataclass(frozen=True)
class CurveRepeatability:
    """s_r(t) of one channel and its summary over the evaluation window, in the unit of the curves.

    ``mean`` is NaN where there are several kinds of stroke.
    """

    s_r: Array
    mean: Array
    pooled: float
    largest: float
    n_trials: int
    n_kinds: int = 1

    @property
    def limit(self) -> float:
        """ISO 5725 repeatability limit of the pooled s_r with the factor for few trials."""
        return self.pooled * limit_factor(self.n_trials - self.n_kinds + 1)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the pooled s_r from the number of trials (samples of a curve are dependent)."""
        low, high = s_interval_factors(self.n_trials - self.n_kinds + 1)
        return self.pooled * low, self.pooled * high


def limit_factor(n: int) -> float:
    """Factor, t_{.975, n−1}·√2, of the ISO 5725 repeatability limit on a standard deviation of ``n`` trials; NaN below
    two trials.

    >>> round(limit_factor(5), 2)
    3.93
    """
    if n < 2:
        return float("nan")
    return float(stdtrit(n - 1, 0.5 + CONFIDENCE / 2) * np.sqrt(2))


def s_interval_factors(n: int) -> tuple[float, float]:
    """Factors, below and above 1, on a standard deviation of ``n`` trials that bound the true one with 95 % confidence;
    NaN below two trials."""
    if n < 2:
        return float("nan"), float("nan")
    freedom = n - 1
    tail = (1 - CONFIDENCE) / 2
    low = np.sqrt(freedom / chdtri(freedom, tail))
    high = np.sqrt(freedom / chdtri(freedom, 1 - tail))
    return float(low), float(high)


def curve_repeatability(curves: Array, kinds: Sequence[int] | None = None) -> CurveRepeatability:
    """Repeatability of one channel from ``curves`` (n_samples, n_trials), NaN where lost: standard deviation over time
    within each kind of stroke, pooled; ``kinds`` (n_trials,): number of each trial's kind, all of one where None.

    Parameters
    ----------
    curves : (n_samples, n_trials), all on one time base, inside the evaluation window; NaN where lost
    kinds : number of the kind of stroke of each trial; all alike when left out

    Returns
    -------
    CurveRepeatability
        ``pooled`` is the root mean square of s_r(t) over the samples at which at least two trials are
        present.
    """
    values = np.atleast_2d(np.asarray(curves, dtype=float))
    n = values.shape[1]
    label = np.zeros(n, dtype=int) if kinds is None else np.asarray(kinds)
    mean, squares, freedom = np.full(len(values), np.nan), np.zeros(len(values)), np.zeros(len(values))
    every = np.unique(label)
    for kind in every:
        mine = values[:, label == kind]
        present = np.isfinite(mine).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            own = np.where(present > 0, np.where(np.isfinite(mine), mine, 0.0).sum(axis=1) / present, np.nan)
        squares += np.square(np.where(np.isfinite(mine), mine - own[:, None], 0.0)).sum(axis=1)
        freedom += np.maximum(present - 1, 0)
        mean = own if every.size == 1 else mean
    with np.errstate(invalid="ignore", divide="ignore"):
        s_r = np.where(freedom > 0, np.sqrt(squares / freedom), np.nan)
    usable = s_r[np.isfinite(s_r)]
    pooled = float(np.sqrt(np.mean(usable**2))) if usable.size else float("nan")
    largest = float(usable.max()) if usable.size else float("nan")
    return CurveRepeatability(s_r, mean, pooled, largest, n, every.size)


def compute_distance_ratios(curves: Array) -> Array:
    """Root mean square distance of each column of ``curves`` (n_samples, n_trials) from the median of the others, over
    the median of these distances, (n_trials,); NaN with fewer than four trials or where that median is 0.

    With fewer than four trials one trial cannot be told from the others.
    """
    values = np.asarray(curves, dtype=float)
    n = values.shape[1]
    if n < FEWEST_TO_STAND_OUT:
        return np.full(n, np.nan)
    known = values[np.isfinite(values).all(axis=1)]
    distance = np.sqrt(np.mean((known - _medians_of_others(known)) ** 2, axis=0))
    usual = float(np.median(distance))
    return distance / usual if usual > 0 else np.full(n, np.nan)


def _medians_of_others(values: Array) -> Array:
    """Median of each row without each of its values, (m, n), by one sort instead of n medians."""
    n = values.shape[1]
    order = np.argsort(values, axis=1)
    rank = np.empty_like(order)
    np.put_along_axis(rank, order, np.arange(n)[None, :], axis=1)
    ordered = np.take_along_axis(values, order, axis=1)
    # of the n - 1 that are left; from the place of the missing one on, each moves down by one
    low, high = (np.take_along_axis(ordered, k + (rank <= k), axis=1) for k in ((n - 2) // 2, (n - 1) // 2))
    return np.asarray(0.5 * (low + high))


def event_repeatability(events: dict[int, dict[str, Event]], kinds: Sequence[Collection[int]] = ()) -> pd.DataFrame:
    """Table with a row for each event: mean, s, 95 % interval of s and ISO 5725 limit over the trials in which it was
    found, pooled within the ``kinds`` of stroke (trial numbers of each); ``events``: trial number → name → event.

    Parameters
    ----------
    events : Trial number → events of that trial; one that is left out does not count
    kinds : numbers of the trials of each kind of stroke; all alike when left out

    Returns
    -------
    pandas.DataFrame
        One row per event: event, unit, n_found, n_ambiguous, n_absent, mean, s, s_low, s_high, limit, range.
    """
    rows = []
    for name, kind in EVENTS.items():
        counting = {number: trial[name] for number, trial in events.items() if name in trial}
        status = [event.status for event in counting.values()]
        found = {number: event.value for number, event in counting.items() if event.status == "found"}
        value = np.array(list(found.values()))
        n = value.size
        parts = [np.array([v for i, v in found.items() if i in of_kind]) for of_kind in kinds or [found]]
        parts = [part for part in parts if part.size]
        freedom = sum(part.size - 1 for part in parts)
        squares = sum(float(np.sum((part - part.mean()) ** 2)) for part in parts)
        s = float(np.sqrt(squares / freedom)) if freedom > 0 else float("nan")
        low, high = s_interval_factors(freedom + 1)
        rows.append(
            {
                "event": name,
                "unit": kind.unit,
                "n_found": n,
                "n_ambiguous": status.count("ambiguous"),
                "n_absent": status.count("absent"),
                "mean": float(value.mean()) if n else float("nan"),
                "s": s,
                "s_low": s * low,
                "s_high": s * high,
                "limit": s * limit_factor(freedom + 1),
                "range": max(float(np.ptp(part)) for part in parts) if freedom > 0 else float("nan"),
            }
        )
    return pd.DataFrame(rows)


def few_trials_warning(n: int) -> str:
    """Warning for the report when there are fewer than six trials; an empty string otherwise."""
    if n >= FEWEST_TRIALS:
        return ""
    if n < 2:
        return "One trial: repeatability is not known, and no difference from the model can be judged by it."
    low, high = s_interval_factors(n)
    return (
        f"{n} trials: sᵣ is known only to within a factor of {low:.2f} to {high:.2f} (95 %); "
        f"record at least {FEWEST_TRIALS}, better {RECOMMENDED_TRIALS}."
    )
