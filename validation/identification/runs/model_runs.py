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
from validation.identification.runs.force_noise import SEGMENTS, noise_knots, own_units
from validation.identification.runs.own import Own
from validation.identification.runs.placed import TOLERANCE, PlacedRuns
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
SMALL_STEP = 0.02  # of what is known well; strokes of several kinds tell the force's level to a hundredth of its prior
BUMP_N = 0.01
OFFSET_N = 0.01
LATE_S = 1e-4  # by which a film's clock is moved for its column


class Response(Protocol):
    """What the fit asks of a model.

    ``own`` is what each trial has of its own, nothing by default; of `curves` it is one such sequence for each point.
    """

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        """Curves of every trial at each point z (p,); None where the model cannot run."""

    def jacobian(self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None) -> list[Array]:
        """Derivatives (m, c, len(which)) of every trial with respect to some of z, and of fixed laws after them."""

    def force_columns(self, z: Array, own: Sequence[Own] | None = None) -> list[Array]:
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
    noise_n : force noise at each knot of `noise_knots`, N; empty where there is none
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
    noise_n: tuple[float, ...] = ()
    bump: int = -1
    film_late_s: float = 0.0

    def felt_n(self, trial: ObservedTrial) -> Array:
        """Force on the key in this case at the times of the trial's table; held before and after what was recorded."""
        when, force = trial.force_time_s, trial.force_n * (1 + self.gain * trial.u_gain) + self._level_n(trial)
        if self.delay:
            force = np.interp(when, when + self.delay * trial.u_delay_s, force)
        if self.noise_n:
            force = force + np.interp(when, noise_knots(trial), self.noise_n)
        if self.bump >= 0:
            force = force + np.interp(when, noise_knots(trial), BUMP_N * (np.arange(SEGMENTS + 1) == self.bump))
        return force

    def preload_n(self, trial: ObservedTrial) -> float:
        """Force under which the action rests."""
        return trial.preload_n * (1 + self.gain * trial.u_gain) + self._level_n(trial)

    def with_noise(self, trial: ObservedTrial, weights: Array) -> Case:
        """The same with the trial's own force and clock, weights of `Response.force_columns`."""
        if weights.size == 0:
            return self
        found = own_units(trial)[: weights.size] * weights
        late = float(found[1 + SEGMENTS]) if weights.size > 1 + SEGMENTS else 0.0
        noise = (0.0, *(float(v) for v in found[1 : 1 + SEGMENTS]))
        return replace(self, offset_n=float(found[0]), noise_n=noise, film_late_s=late)

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


class ModelRuns(PlacedRuns[Case]):
    """The project's model as a `Response`, by differences of runs.

    Parameters
    ----------
    action : model.Action
        Its values are z = 0.
    parameters : sequence of Parameter
        What z moves, and after that laws which are fixed, but may be others in single trials.
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
        super().__init__(action, parameters, trials, tolerance, executor)
        self.runs = 0

    def at(self, z: Array) -> dict[str, float]:
        """Values of the action at ``z``."""
        out: dict[str, float] = {}
        for parameter, value in zip(self.parameters, z, strict=True):
            out |= parameter.values(self.action, float(value))
        return out

    def cases(self, at: Array, own: Sequence[Own] | None) -> list[Case]:
        """The member of each trial where it is."""
        if own is None:
            return len(self.trials) * [self.case(at[0])]
        return [
            self.case(place).with_noise(trial, o.drive) for place, trial, o in zip(at, self.trials, own, strict=True)
        ]

    def case(self, z: Array) -> Case:
        """The member at z, of all parameters."""
        bench = {p.name: float(value) for p, value in zip(self.parameters, z, strict=True) if not p.paths}
        return Case(
            self.at(z),
            gain=bench.get(FORCE_GAIN, 0.0),
            level=bench.get(FORCE_LEVEL, 0.0),
            delay=bench.get(FORCE_DELAY, 0.0),
            key_scale=bench.get(KEY_SCALE, 0.0),
            key_zero=bench.get(KEY_ZERO, 0.0),
        )

    def jacobian(self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None) -> list[Array]:
        """Derivatives with respect to z; see `Response`."""
        at = self.places(z, own)
        points = [at]
        steps = np.array([STEP if self.parameters[j].factor else SMALL_STEP for j in which])
        for j, step in zip(which, steps, strict=True):
            moved = at.copy()
            moved[:, j] += step
            points.append(moved)
        return self._differences(self.there(points, own), steps, [self.parameters[j].name for j in which])

    def force_columns(self, z: Array, own: Sequence[Own] | None = None) -> list[Array]:
        """Changes under errors of each trial's own force; see `Response`."""
        here = self.cases(self.places(z, own), own)
        # the baseline is the preload: its knot has no noise
        points = [here, [replace(c, offset_n=c.offset_n + OFFSET_N) for c in here]]
        points += [[replace(c, bump=i) for c in here] for i in range(1, SEGMENTS + 1)]
        steps, names = [OFFSET_N] + SEGMENTS * [BUMP_N], ["force offset", *SEGMENTS * ["force noise"]]
        if any(t.film_time_s is not None for t in self.trials):
            points.append([replace(c, film_late_s=c.film_late_s + LATE_S) for c in here])
            steps, names = [*steps, LATE_S], [*names, "film clock"]
        unit = self._differences(self.run(points), np.array(steps), names)
        return [columns * own_units(t)[: columns.shape[2]] for columns, t in zip(unit, self.trials, strict=True)]

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

    def run(self, members: Sequence[Sequence[Case]]) -> list[list[Array] | None]:
        """Curves of every trial in each of several cases of all trials; None where one of them cannot run."""
        jobs: list[model.batch.Job] = []
        rests: list[list[tuple[model.Action, model.RestState]] | None] = []
        for cases in members:
            found = self._rests(cases)
            rests.append(found)
            if found is None:
                continue
            for case, trial, (action, rest) in zip(cases, self.trials, found, strict=True):
                when = trial.model_time_s(case.film_late_s)
                chosen = ForceDrivenOptions(tolerance=self.tolerance, output_time_s=when)
                table = {trial.label: (trial.force_time_s, case.felt_n(trial))}
                jobs += model.batch.make_jobs(action, table, {"": {}}, chosen, rest)
        done = iter(model.batch.run_jobs(model.batch.lanes.choose(jobs, None), executor=self.executor))
        self.runs += len(jobs)
        made = zip(members, rests, strict=True)
        return [None if found is None else self._curves(cases, found, done) for cases, found in made]

    def _rests(self, cases: Sequence[Case]) -> list[tuple[model.Action, model.RestState]] | None:
        """Action and rest of each trial; None where one of them has no rest. What trials share is found once."""
        actions: dict[int, model.Action] = {}
        known: dict[tuple[int, float], model.RestState] = {}
        out = []
        try:
            for case, trial in zip(cases, self.trials, strict=True):
                one, preload = id(case.changed), case.preload_n(trial)
                if one not in actions:
                    actions[one] = self.action.with_values(case.changed)
                if (one, preload) not in known:
                    known[one, preload] = model.rest_state(actions[one], force_n=preload)
                out.append((actions[one], known[one, preload]))
        except ModelError:
            return None
        return out

    def _curves(
        self,
        cases: Sequence[Case],
        rests: Sequence[tuple[model.Action, model.RestState]],
        members: Iterator[model.batch.Member],
    ) -> list[Array] | None:
        """Curves of every trial from the next members; None where one has failed."""
        curves = []
        for case, trial, (_, rest) in zip(cases, self.trials, rests, strict=True):
            member = next(members)
            if member.error is not None and not isinstance(member.error, ModelError):
                raise lost(member.error)  # a run that was lost is not a model that cannot run
            solution = member.solution
            if solution is not None:
                turn = np.asarray(solution.angle_rad)[:, :5] - rest.angle_rad[:5]
                curves.append(case.read(trial, turn))
        return curves if len(curves) == len(self.trials) else None
