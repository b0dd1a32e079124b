"""Paired differences of a session as found, and as they would be if the model were right, on one coarse time base.

Conventions: model − trial, rad; (…, n_trials, n_samples, n_channels); channels as in `joint_draws.CHANNELS`; NaN
where a trial is lost, marked, not filmed or wired wrong. Draws are run for at most five trials, taken by lot
(`joint_draws.chosen_trials`), and the difference found is that of the same trials.
"""

from __future__ import annotations

import base64
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import model
from validation.cache.content_hash import sha256_of
from validation.conventions import CHANNEL_GROUPS, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.joint_draws import (
    CHANNELS,
    JointDraw,
    chosen_trials,
    drawn_actions,
    drawn_readings,
    drawn_run,
    joint_draws,
    session_seed,
)
from validation.prediction.many_runs import run_many
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
    chosen = chosen_trials(trials, without)
    base = traces.base_s
    time = base[:: max(1, base.size // MOST_SAMPLES)]
    numbers = tuple(m.number for m in chosen)
    measured, predicted = (_stack(traces, numbers, time, tail, without) for tail in ("measured", "predicted"))
    found = predicted - measured

    drawn = joint_draws(tested.action, session_seed(trials), n_draws, parameters=True)
    known = tested.identity, sha256_of(drawn)
    stored = tested.store.values(
        "difference draws",
        [(known, m.number, m.force, m.u_rad, m.resolution_rad, m.scale_relative_u, m.film, time) for m in chosen],
        lambda missing: _read(tested, [chosen[i] for i in missing], drawn, time),
    )
    readings = [_decoded(one, (n_draws, time.size, len(CHANNELS))) for one in stored]
    every = np.stack(readings, axis=1).astype(float)
    ran = np.isfinite(every).any(axis=(2, 3)).all(axis=1)
    draws = np.where(np.isfinite(found), predicted - every[ran], np.nan)
    counts = np.array([float(np.mean([abs(m.resolution_rad[i]) for m in chosen])) for i in range(3)])
    floor = np.concatenate([counts / np.sqrt(12.0), np.zeros(len(CHANNELS) - 3)])
    return DifferenceDraws(time, numbers, found, draws, floor, int(n_draws - ran.sum()))


def _read(
    tested: ModelUnderTest, trials: Sequence[MeasuredTrial], draws: Sequence[JointDraw], time: Array
) -> list[dict[str, str]]:
    """Readings of each trial in every draw, (N, n_samples, 5) as text by channel; a draw that cannot be run is NaN."""
    actions = drawn_actions(tested, trials, draws)
    pairs = [(m, drawn) for m, of_trial in zip(trials, actions, strict=True) for drawn in of_trial]
    runs = [None if drawn is None else drawn_run(tested, m, drawn, time) for m, drawn in pairs]

    def reading(i: int, solution: model.Solution) -> NDArray[np.float32]:
        m, drawn = pairs[i]
        assert drawn is not None
        return drawn_readings(m, drawn, time, solution).astype(np.float32)

    nothing = np.full((time.size, len(CHANNELS)), np.nan, dtype=np.float32)
    found = [nothing if one is None else one for one in run_many(tested, runs, reading)]
    return [_encoded(np.stack(found[k : k + len(draws)])) for k in range(0, len(found), len(draws))]


def _encoded(every: NDArray[np.float32]) -> dict[str, str]:
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
