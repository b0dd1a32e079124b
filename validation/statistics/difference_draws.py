"""Paired differences of a session as found, and as they would be if the model were right, on one coarse time base.

Conventions: model − trial, rad; (…, n_trials, n_samples, n_channels); channels as in `joint_draws.CHANNELS`; NaN
where a trial is lost, marked, not filmed or wired wrong. Draws are run for at most five trials, spread evenly over the
peak force (`joint_draws.chosen_trials`), and the difference found is that of the same trials.
"""

from __future__ import annotations

import base64
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from validation.conventions import CHANNEL_GROUPS, WORKERS, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.joint_draws import (
    CHANNELS,
    DrawnAction,
    JointDraw,
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
MOST_SAMPLES = 400


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

    drawn = joint_draws(tested.action, session_seed(trials), n_draws, parameters=True)
    actions = _Actions(tested, chosen[0], drawn)
    readings = []
    for m in chosen:
        inputs = (tested.identity, drawn, m.force, m.u_rad, m.resolution_rad, m.scale_relative_u, m.film, time)
        stored = tested.store.value("difference draws", inputs, partial(_read, tested, m, actions, time))
        readings.append(_decoded(stored, (n_draws, time.size, len(CHANNELS))))
    every = np.stack(readings, axis=1).astype(float)
    ran = np.isfinite(every).any(axis=(2, 3)).all(axis=1)
    draws = np.where(np.isfinite(found), predicted - every[ran], np.nan)
    counts = np.array([float(np.mean([abs(m.resolution_rad[i]) for m in chosen])) for i in range(3)])
    floor = np.concatenate([counts / np.sqrt(12.0), np.zeros(len(CHANNELS) - 3)])
    return DifferenceDraws(time, numbers, found, draws, floor, int(n_draws - ran.sum()))


class _Actions:
    """Actions of the draws at rest, found when the first trial needs them and shared by the others."""

    def __init__(self, tested: ModelUnderTest, m: MeasuredTrial, draws: Sequence[JointDraw]) -> None:
        self._make = tested, m, draws

    @cached_property
    def drawn(self) -> list[DrawnAction | None]:
        """One for each draw; None where the action has no rest."""
        tested, m, draws = self._make
        with ThreadPoolExecutor(WORKERS) as pool:
            return list(pool.map(lambda draw: drawn_action(tested, m, draw), draws))


def _read(tested: ModelUnderTest, m: MeasuredTrial, actions: _Actions, time: Array) -> dict[str, str]:
    """Readings of one trial in every draw, (N, n_samples, 5) as text by channel; a draw that cannot be run is NaN."""
    nothing = np.full((time.size, len(CHANNELS)), np.nan)

    def one(drawn: DrawnAction | None) -> Array:
        found = None if drawn is None else drawn_readings(tested, m, drawn, time)
        return nothing if found is None else found

    with ThreadPoolExecutor(WORKERS) as pool:
        every = np.stack(list(pool.map(one, actions.drawn))).astype(np.float32)
    known = [name for i, name in enumerate(CHANNELS) if np.isfinite(every[..., i]).any()]
    return {n: base64.b64encode(every[..., CHANNELS.index(n)].tobytes()).decode("ascii") for n in known}


def _decoded(stored: dict[str, str], shape: tuple[int, int, int]) -> NDArray[np.float32]:
    out = np.full(shape, np.nan, dtype=np.float32)
    for name, text in stored.items():
        out[..., CHANNELS.index(name)] = np.frombuffer(base64.b64decode(text), np.float32).reshape(shape[:2])
    return out


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
