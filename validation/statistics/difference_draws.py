"""Paired differences of a session as found, and as they would be if the model were right, on one coarse time base.

Conventions: model − trial, rad; (…, n_trials, n_samples, n_channels); channels as in `joint_draws.CHANNELS`; NaN
where a trial is lost, marked, not filmed or wired wrong. Draws are run for at most five trials, spread evenly over the
peak force (`joint_draws.chosen_trials`), and the difference found is that of the same trials.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from validation.conventions import CHANNEL_GROUPS, WORKERS, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.joint_draws import (
    CHANNELS,
    DrawnAction,
    chosen_trials,
    drawn_action,
    drawn_readings,
    joint_draws,
    session_seed,
)
from validation.prediction.model_under_test import ModelUnderTest
from validation.scores.traces import SessionTraces
from validation.statistics.common_base import on_common_base

DRAWS = 59  # rank 57 of 60 is the 95 % point exactly
MOST_SAMPLES = 500


@dataclass(frozen=True)
class DifferenceDraws:
    """Differences found and drawn.

    Attributes
    ----------
    time_s : (n_samples,)
    trials : numbers of the trials used
    found : (n_trials, n_samples, 5)
    draws : (N, n_trials, n_samples, 5)
    floor : (5,) smallest standard uncertainty of a mean, one count or the film's
    failed : draws that could not be run
    """

    time_s: Array
    trials: tuple[int, ...]
    found: Array
    draws: Array
    floor: Array
    failed: int


def difference_draws(
    trials: Sequence[MeasuredTrial],
    traces: SessionTraces,
    tested: ModelUnderTest,
    without: Collection[tuple[int, str]] = (),
    n_draws: int = DRAWS,
) -> DifferenceDraws:
    """Run the draws of a session.

    Parameters
    ----------
    trials : sequence of MeasuredTrial
        All usable trials.
    without : collection of (trial, channel)
        What is not pooled.
    """
    chosen = chosen_trials(trials)
    base = traces.base_s
    time = base[:: max(1, base.size // MOST_SAMPLES)]
    numbers = tuple(m.number for m in chosen)
    measured, predicted = (_stack(traces, numbers, time, tail, without) for tail in ("measured", "predicted"))
    found = predicted - measured

    def one(drawn: DrawnAction) -> Array | None:
        readings = [drawn_readings(tested, m, drawn, time) for m in chosen]
        known = [r for r in readings if r is not None]
        return np.stack(known) if len(known) == len(readings) else None

    drawn = [
        drawn_action(tested, chosen[0], draw)
        for draw in joint_draws(tested.action, session_seed(trials), n_draws, parameters=True)
    ]
    with ThreadPoolExecutor(WORKERS) as pool:
        runs = list(pool.map(one, [d for d in drawn if d is not None]))
    read = [r for r in runs if r is not None]
    draws = np.where(np.isfinite(found), predicted - np.stack(read), np.nan) if read else np.empty((0, *found.shape))
    counts = np.array([float(np.mean([abs(m.resolution_rad[i]) for m in chosen])) for i in range(3)])
    floor = np.concatenate([counts / np.sqrt(12.0), np.zeros(len(CHANNELS) - 3)])
    return DifferenceDraws(time, numbers, found, draws, floor, n_draws - len(read))


def _stack(
    traces: SessionTraces, numbers: tuple[int, ...], time: Array, tail: str, without: Collection[tuple[int, str]]
) -> Array:
    """One kind of curve of every trial and channel, (n_trials, n_samples, 5)."""
    out = np.full((len(numbers), time.size, len(CHANNELS)), np.nan)
    for names, source in CHANNEL_GROUPS:
        every = traces.of(source)
        for name in names:
            for j, number in enumerate(numbers):
                if number in every and (number, name) not in without:
                    column = on_common_base(time, {number: every[number]}, f"{name}_{tail}_rad")
                    out[j, :, CHANNELS.index(name)] = column[:, 0]
    return out
