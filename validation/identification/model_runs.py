"""What the model says of all trials that a force drives, and how it changes with what may move.

Conventions: curves are changes since the model's own rest under the preload, (m, c) rad, of the channels a trial has;
derivatives are per prior standard uncertainty. Derivatives here are differences of runs; `Response` is what the fit
needs of a model, so that exact sensitivities can take their place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

import model
from model.errors import ModelError
from model.simulation.options import ForceDrivenOptions
from validation.conventions import Array
from validation.identification.blocks import MOVED_RAD
from validation.identification.observations import ObservedTrial
from validation.identification.unknowns.priors import (
    FORCE_DELAY,
    FORCE_GAIN,
    FORCE_LEVEL,
    KEY_SCALE,
    KEY_ZERO,
    Parameter,
)
from validation.prediction.elsewhere import lost

STEP = 0.015  # of a prior standard uncertainty: half a percent of a friction; after an impact larger steps bend
SMALL_STEP = 0.1  # of what is known well
TOLERANCE = 2e-7
SEGMENTS = 36  # of a trial, between which its force noise is taken to change linearly
EVENLY = 0.15  # share of them that is spread evenly over time
BEFORE_S = 2e-3  # before the force acts it is the preload, without noise; over so long the noise comes up
BUMP_N = 0.01
OFFSET_N = 0.01
LATE_S = 1e-4  # by which a film's clock is moved for its column


class Response(Protocol):
    """What the fit asks of a model."""

    def curves(self, points: Sequence[Array]) -> list[list[Array] | None]:
        """Curves of every trial at each point z (p,); None where the model cannot run."""

    def jacobian(self, z: Array, which: Sequence[int]) -> list[Array]:
        """Derivatives (m, c, len(which)) of every trial with respect to some of z."""

    def force_columns(self, z: Array) -> list[Array]:
        """Changes (m, c, k) under what a trial has of its own: force offset, parts of force noise, a film's clock."""


@dataclass(frozen=True)
class Case:
    """One member: values of the action that differ, and errors of the force.

    Attributes
    ----------
    changed : values of the action
    gain, level, delay : errors of the force that all trials share, in standard uncertainties
    key_scale, key_zero : errors of the key's encoder, likewise
    offset_n : of each trial's force once it acts, N
    bump : knot of the force noise that is moved, none below zero
    film_late_s : error of a film's clock
    """

    changed: dict[str, float] = field(default_factory=dict, hash=False)
    gain: float = 0.0
    level: float = 0.0
    delay: float = 0.0
    key_scale: float = 0.0
    key_zero: float = 0.0
    offset_n: float = 0.0
    bump: int = -1
    film_late_s: float = 0.0

    def felt_n(self, trial: ObservedTrial) -> Array:
        """Force on the key in this case at the times of the trial's table; held before and after what was recorded."""
        when, force = trial.force_time_s, trial.force_n * (1 + self.gain * trial.u_gain) + self._level_n(trial)
        if self.delay:
            force = np.interp(when, when + self.delay * trial.u_delay_s, force)
        if self.bump >= 0:
            force = force + np.interp(when, noise_knots(trial), BUMP_N * (np.arange(SEGMENTS + 1) == self.bump))
        return force

    def preload_n(self, trial: ObservedTrial) -> float:
        """Force under which the action rests."""
        return trial.preload_n * (1 + self.gain * trial.u_gain) + self._level_n(trial)

    def read(self, trial: ObservedTrial, turn_rad: Array) -> Array:
        """Channels (m, c) of a trial from the model's turns (k, 5): what its sensors read."""
        seen = trial.seen(turn_rad, self.film_late_s)
        if trial.key_moves and trial.channels[0] == 0:
            turned = seen[:, 0]
            zero = self.key_zero * trial.u_key_rad * -np.expm1(-np.abs(turned) / MOVED_RAD)
            seen[:, 0] = turned * (1.0 + self.key_scale * trial.u_key_scale) + zero
        return seen

    def _level_n(self, trial: ObservedTrial) -> float:
        return self.level * trial.u_preload_n + self.offset_n


class ModelRuns:
    """The project's model as a `Response`, by differences of runs.

    Parameters
    ----------
    action : model.Action
        Its values are z = 0.
    parameters : sequence of Parameter
        What z moves.
    trials : sequence of ObservedTrial
    tolerance : float
        Largest error of any angle of a run, rad.
    executor : Executor, optional
        Where to compute; by default threads of this process.
    """

    def __init__(
        self,
        action: model.Action,
        parameters: Sequence[Parameter],
        trials: Sequence[ObservedTrial],
        tolerance: float = TOLERANCE,
        executor: Executor | None = None,
    ) -> None:
        self.action, self.parameters, self.trials = action, tuple(parameters), tuple(trials)
        self.tolerance, self.executor = tolerance, executor
        self.runs = 0

    def at(self, z: Array) -> dict[str, float]:
        """Values of the action at ``z``."""
        out: dict[str, float] = {}
        for parameter, value in zip(self.parameters, z, strict=True):
            out |= parameter.values(self.action, float(value))
        return out

    def curves(self, points: Sequence[Array]) -> list[list[Array] | None]:
        """Curves at each point; see `Response`."""
        return self.run([self.case(z) for z in points])

    def case(self, z: Array) -> Case:
        """The member at z."""
        bench = {p.name: float(value) for p, value in zip(self.parameters, z, strict=True) if not p.paths}
        return Case(
            self.at(z),
            gain=bench.get(FORCE_GAIN, 0.0),
            level=bench.get(FORCE_LEVEL, 0.0),
            delay=bench.get(FORCE_DELAY, 0.0),
            key_scale=bench.get(KEY_SCALE, 0.0),
            key_zero=bench.get(KEY_ZERO, 0.0),
        )

    def jacobian(self, z: Array, which: Sequence[int]) -> list[Array]:
        """Derivatives with respect to z; see `Response`."""
        points = [self.case(z)]
        steps = np.array([STEP if self.parameters[j].factor else SMALL_STEP for j in which])
        for j, step in zip(which, steps, strict=True):
            moved = z.copy()
            moved[j] += step
            points.append(self.case(moved))
        return self._differences(self.run(points), steps, [self.parameters[j].name for j in which])

    def force_columns(self, z: Array) -> list[Array]:
        """Changes under errors of each trial's own force; see `Response`."""
        here = self.case(z)
        # the baseline is the preload: its knot has no noise
        points = [here, replace(here, offset_n=OFFSET_N)] + [replace(here, bump=i) for i in range(1, SEGMENTS + 1)]
        steps, names = [OFFSET_N] + SEGMENTS * [BUMP_N], ["force offset", *SEGMENTS * ["force noise"]]
        filmed = any(t.film_time_s is not None for t in self.trials)
        if filmed:
            points, steps, names = (
                [*points, replace(here, film_late_s=LATE_S)],
                [*steps, LATE_S],
                [*names, "film clock"],
            )
        unit = self._differences(self.run(points), np.array(steps), names)
        clock = [[t.u_film_time_s] if filmed else [] for t in self.trials]
        scale = [np.concatenate([[t.u_offset_n], slow_noise_n(t), c]) for t, c in zip(self.trials, clock, strict=True)]
        return [columns * by for columns, by in zip(unit, scale, strict=True)]

    def _differences(self, found: list[list[Array] | None], steps: Array, names: list[str]) -> list[Array]:
        base = found[0]
        if base is None:
            raise ModelError("identification: the model cannot run where the fit stands; start from other values")
        out = [np.zeros((*b.shape, len(steps))) for b in base]
        for j, moved in enumerate(found[1:]):
            if moved is None:
                raise ModelError(f"identification: the model cannot run with a small change of {names[j]}; --fix it")
            for k, curve in enumerate(moved):
                out[k][:, :, j] = (curve - base[k]) / steps[j]
        return out

    def run(self, cases: Sequence[Case]) -> list[list[Array] | None]:
        """Curves of every trial in each case; None where one of them cannot run."""
        jobs: list[model.batch.Job] = []
        rests: list[dict[float, model.RestState] | None] = []
        for case in cases:
            known: dict[float, model.RestState] = {}
            try:
                action = self.action.with_values(case.changed)
                for trial in self.trials:
                    preload = case.preload_n(trial)
                    if preload not in known:
                        known[preload] = model.rest_state(action, force_n=preload)
            except ModelError:
                rests.append(None)
                continue
            rests.append(known)
            for trial in self.trials:
                when = trial.model_time_s(case.film_late_s)
                chosen = ForceDrivenOptions(tolerance=self.tolerance, output_time_s=when)
                table = {trial.label: (trial.force_time_s, case.felt_n(trial))}
                jobs += model.batch.make_jobs(action, table, {"": {}}, chosen, known[case.preload_n(trial)])
        members = iter(model.batch.run_jobs(model.batch.lanes.choose(jobs, None), executor=self.executor))
        self.runs += len(jobs)
        made = zip(cases, rests, strict=True)
        return [None if known is None else self._curves(case, known, members) for case, known in made]

    def _curves(
        self, case: Case, known: dict[float, model.RestState], members: Iterator[model.batch.Member]
    ) -> list[Array] | None:
        """Curves of every trial from the next members; None where one has failed."""
        curves = []
        for trial in self.trials:
            member = next(members)
            if member.error is not None and not isinstance(member.error, ModelError):
                raise lost(member.error)  # a run that was lost is not a model that cannot run
            solution = member.solution
            if solution is not None:
                turn = np.asarray(solution.angle_rad)[:, :5] - known[case.preload_n(trial)].angle_rad[:5]
                curves.append(case.read(trial, turn))
        return curves if len(curves) == len(self.trials) else None


def noise_knots(trial: ObservedTrial) -> Array:
    """Times (SEGMENTS + 1,) between which the noise of the force is taken to change linearly.

    They begin where the force first differs from the preload: a soft stroke's first phase is later. Between two of them
    the action moves equally far, but for the share that is spread over time: where a stroke rises twice, noise
    of the second rise in long parts went into friction and felt.
    """
    end = float(trial.force_time_s[-1])
    acts = np.flatnonzero(trial.force_n != trial.force_n[0])
    first = min(float(trial.time_s[0]), float(trial.force_time_s[acts[0]] if acts.size else end))
    at = np.unique(np.concatenate([[first], trial.time_s[trial.time_s < end], [end]]))
    passed = (1.0 - EVENLY) * np.linspace(0.0, 1.0, at.size) + EVENLY * (at - first) / (end - first)
    return np.concatenate([[first - BEFORE_S], np.interp(np.linspace(0.0, 1.0, SEGMENTS), passed, at)])


def slow_noise_n(trial: ObservedTrial) -> Array:
    """Standard deviation of white force noise, averaged around each knot but the first, N."""
    step = float(np.median(np.diff(trial.force_time_s)))
    knots = noise_knots(trial)
    length = 0.5 * (np.append(knots[2:], knots[-1]) - knots[:-1])
    return np.asarray(trial.noise_n * np.sqrt(step / length))
