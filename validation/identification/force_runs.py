"""What the model says of all trials that a force drives, and how it changes with what may move: a `Response`.

Conventions: curves are changes since the model's own rest under the preload, (m, c) rad, of the channels a trial has;
derivatives are per prior standard uncertainty. Each trial is at a place of its own: a value of every parameter, what z
moves, and after that laws which are fixed, but may be others in single trials. A soft stroke near a fork of its motion
does not answer a scatter of 2 % linearly, so each trial is computed where its own laws and its own force most probably
were, and is linear around that (Lindstrom and Bates 1990). Exact derivatives are integrated beside each stroke
(`model.sensitivities`): one costs about as much as a third of a run, and has no step to choose; a parameter that does
nothing in the scene has a column of zeros. The noise of a force changes linearly between knots.

Runs are made on threads of this process or on the workers of an executor; answers come in the order of the jobs, so
that whatever is made of them is the same wherever they were computed, and what is lost there is said.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np

import model
from model.errors import InputError, ModelError
from model.parameters.effects import STRING_EFFECT
from model.scene.string_terms import with_modes
from model.sensitivity.parameter_names import directions
from model.simulation.options import ForceDrivenOptions
from validation.conventions import BODIES, WORKERS, Array
from validation.errors import ValidationInputError
from validation.identification.blocks import MOVED_RAD, Block
from validation.identification.observations import ObservedTrial
from validation.identification.unknowns import (
    FORCE_DELAY,
    FORCE_GAIN,
    FORCE_LEVEL,
    KEY_SCALE,
    KEY_ZERO,
    Parameter,
)

Job = TypeVar("Job")
Found = TypeVar("Found")


def lost(error: Exception) -> ValidationInputError:
    """What is said of a computation that did not come back."""
    what = " ".join(f"{type(error).__name__}: {error}".split())
    return ValidationInputError(
        f"identify: a run was lost where it was computed ({what}); nothing was written; run again"
    )


def spread(executor: Executor | None, one: Callable[[Job], Found], jobs: Sequence[Job]) -> list[Found]:
    """``one`` of every job, in their order, on the executor's workers or threads of this process.

    Raises
    ------
    model.errors.ModelError
        What ``one`` raises.
    ValidationInputError
        A worker was lost, and with it the job.
    """
    if executor is None:
        with ThreadPoolExecutor(WORKERS) as pool:
            return list(pool.map(one, jobs))
    try:
        return list(executor.map(one, jobs))
    except ModelError:
        raise
    except Exception as error:
        raise lost(error) from error


@dataclass(frozen=True)
class Own:
    """What one trial has of its own.

    Attributes
    ----------
    laws : (p + h,) by how much what moves and what is fixed differs in this trial, in prior standard uncertainties
    drive : (k,) of what drives the trial, in standard deviations: weights of `Response.force_columns`
    """

    laws: Array
    drive: Array

    def towards(self, other: Own, share: float) -> Own:
        """A share of the way to another."""
        return Own(self.laws + share * (other.laws - self.laws), self.drive + share * (other.drive - self.drive))

    def apart(self, other: Own, scatter: Array) -> float:
        """Root mean square distance in standard deviations; ``scatter`` (p + h,) is that of the laws."""
        there = scatter > 0.0
        laws = (self.laws - other.laws)[there] / scatter[there]
        return float(np.sqrt(np.mean(np.concatenate([laws, self.drive - other.drive]) ** 2)))


def nothing_own(blocks: Sequence[Block]) -> list[Own]:
    """Of each trial: it is as all are."""
    return [Own(np.zeros(b.moved.shape[1] + b.held.shape[1]), np.zeros(b.driven)) for b in blocks]


def without_own(blocks: Sequence[Block], residuals: Sequence[Array], own: Sequence[Own]) -> list[Array]:
    """Residuals that the linear model would have if no trial had anything of its own."""
    return [
        r + np.hstack([b.moved, b.held]) @ o.laws + b.own[:, : b.driven] @ o.drive
        for r, b, o in zip(residuals, blocks, own, strict=True)
    ]


SEGMENTS = 36  # of a trial, between which its force noise is taken to change linearly
EVENLY = 0.15  # share of them that is spread evenly over time
BEFORE_S = 2e-3  # before the force acts it is the preload, without noise; over so long the noise comes up


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


def own_units(trial: ObservedTrial) -> Array:
    """Standard deviations (2 + SEGMENTS,) of what a trial has of its own: N of its force, s of its film's clock."""
    return np.concatenate([[trial.u_offset_n], slow_noise_n(trial), [trial.u_film_time_s]])


TOLERANCE = 2e-7
MODES_RAD = 3e-5  # error of an angle by which a fit chooses a string's modes: the runs' own asks for all there are
MOTION, TANGENT = 1e-7, 1e-4
FINER = 0.1  # times the tolerance, of runs whose differences are derivatives: a run's error is divided by the step
KEPT = 200  # actions, with their rests under each preload, that are kept from run to run
PROBE = 0.01  # of a prior standard uncertainty: the step that checks the derivatives
MISSED = 0.2  # of the change: derivatives that miss it by more are not used
STEP = 0.015  # of a prior standard uncertainty: half a percent of a friction; after an impact larger steps bend
SMALL_STEP = 0.02  # of what is known well; strokes of several kinds tell the force's level to a hundredth of its prior
BUMP_N = 0.01
OFFSET_N = 0.01
LATE_S = 1e-4  # by which a film's clock is moved for its column


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


Member = TypeVar("Member")


class PlacedRuns(ABC, Generic[Member]):
    """The project's model as a `Response`, whatever drives it; a member is what the run of one trial does.

    Parameters
    ----------
    action : model.Action
        Its values are z = 0.
    parameters : sequence of Parameter
        What z moves, and after that laws which are fixed, but may be others in single trials.
    trials : sequence of ObservedTrial
    tolerance : float, optional
        Largest error of any angle of a run, rad.
    executor : Executor, optional
        Where to compute; by default threads of this process.
    """

    errors: ClassVar[frozenset[str]]
    """Names of the errors of what drives, or reads, which runs tell."""
    tangents: ClassVar[Any]
    """Derivatives (m, c, n) of one trial by an action, names, a member and the trial, SI or per relative change."""

    def __init__(
        self,
        action: model.Action,
        parameters: Sequence[Parameter],
        trials: Sequence[ObservedTrial],
        tolerance: float | None = None,
        executor: Executor | None = None,
    ) -> None:
        strung = STRING_EFFECT in model.choice_of(action).effects
        self.action = with_modes(action, MODES_RAD) if strung else action
        self.parameters = tuple(parameters)
        self.trials: tuple[ObservedTrial, ...] = tuple(trials)
        self.tolerance, self.executor = TOLERANCE if tolerance is None else tolerance, executor
        self.acting = [j for j, p in enumerate(self.parameters) if acting(action, p)]
        self._known: dict[tuple[float, ...], tuple[model.Action, dict[float, model.RestState]]] = {}

    @abstractmethod
    def cases(self, at: Array, own: Sequence[Own] | None) -> list[Member]:
        """The member of each trial where it is, (trials, n)."""

    @abstractmethod
    def run(self, members: Sequence[Sequence[Member]]) -> list[list[Array] | None]:
        """Curves of every trial in each of several cases of all trials; None where one of them cannot run."""

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        """Curves at each point; see `Response`."""
        every = zip(points, len(points) * [None] if own is None else own, strict=True)
        return self.run([self.cases(self.places(z, o), o) for z, o in every])

    def places(self, z: Array, own: Sequence[Own] | None) -> Array:
        """Where each trial is, (trials, n) of all parameters; those z does not reach are as the action has them."""
        at = np.zeros((len(self.trials), len(self.parameters)))
        at[:, : z.size] = z
        for k, o in enumerate(own or ()):
            at[k, : o.laws.size] += o.laws
        return at

    def jacobian(self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None) -> list[Array]:
        """Derivatives with respect to z, see `Response`; differences of runs where tangents do not hold."""
        at, which = self.places(z, own), list(which)
        by_runs = [j for j in which if self.parameters[j].name in self.errors]
        by_tangent = [j for j in which if j in self.acting]
        try:
            found = self.differences(at, own, which, by_runs)
            if by_tangent:
                names, place = tuple(self.parameters[j].name for j in by_tangent), [which.index(j) for j in by_tangent]
                tasks = [(self.action, names, c, t) for c, t in zip(self.cases(at, own), self.trials, strict=True)]
                columns = spread(self.executor, type(self).tangents, tasks)
                for out, here, column in zip(found, at, columns, strict=True):
                    unit = [self.parameters[j].per_u(self.action, float(here[j])) for j in by_tangent]
                    out[:, :, place] = column * np.array(unit)
        except ModelError:  # differences of runs go on where a tangent cannot
            return self.differences(at, own, which, [*by_tangent, *by_runs])
        wrong = self._wrong(at, own, which, found)
        if wrong:
            some = copy(self)
            some.trials = tuple(self.trials[k] for k in wrong)
            those = None if own is None else [own[k] for k in wrong]
            again = some.differences(at[np.array(wrong)], those, which, [*by_tangent, *by_runs])
            for k, redone in zip(wrong, again, strict=True):
                found[k] = redone
        return found

    def differences(
        self, at: Array, own: Sequence[Own] | None, which: Sequence[int], asked: Sequence[int]
    ) -> list[Array]:
        """Derivatives (m, c, len(which)) of every trial; those asked for by differences of runs, of the others 0.

        Raises
        ------
        ModelError
            The model cannot run here, or a step away.
        """
        out = [np.zeros((*t.change_rad.shape, len(which))) for t in self.trials]
        if asked:
            steps = np.array([STEP if self.parameters[j].factor else SMALL_STEP for j in asked])
            moved = [at + step * (np.arange(at.shape[1]) == j) for j, step in zip(asked, steps, strict=True)]
            members = [self.cases(place, own) for place in [at, *moved]]
            fine = copy(self)
            fine.tolerance = FINER * self.tolerance
            names, place = [self.parameters[j].name for j in asked], [list(which).index(j) for j in asked]
            for columns, change in zip(out, fine.changes(members, names), strict=True):
                columns[:, :, place] = change / steps
        return out

    def changes(self, members: Sequence[Sequence[Member]], names: Sequence[str]) -> list[Array]:
        """Changes (m, c, k) of every trial from the first of some members to each of the others, which are named.

        Raises
        ------
        ModelError
            The model cannot run in one of them.
        """
        base, *moved = self.run(members)
        if base is None:
            raise ModelError("identification: the model cannot run where the fit stands; start from other values")
        out = [np.zeros((*b.shape, len(names))) for b in base]
        for i, (name, curves) in enumerate(zip(names, moved, strict=True)):
            if curves is None:
                raise ModelError(f"identification: the model cannot run with a small change of {name}; --fix it")
            for column, curve, here in zip(out, curves, base, strict=True):
                column[:, :, i] = curve - here
        return out

    def _wrong(self, at: Array, own: Sequence[Own] | None, which: list[int], jacobian: Sequence[Array]) -> list[int]:
        """Trials in which a small step in all parameters at once does not do what the derivatives say.

        A tangent that steps over a layer in which friction turns round may grow without bound; a difference shows it.
        """
        step = np.zeros(at.shape[1])
        step[which] = PROBE * np.where(np.arange(len(which)) % 2, 1.0, -1.0)
        here, there = self.run([self.cases(place, own) for place in (at, at + step)])
        if here is None or there is None:
            return list(range(len(self.trials)))
        missed = []
        for k, (a, b, derivative) in enumerate(zip(here, there, jacobian, strict=True)):
            moved, said = b - a, derivative @ step[which]
            if np.sqrt(np.mean((moved - said) ** 2)) > MISSED * np.sqrt(np.mean(moved**2)) + self.tolerance:
                missed.append(k)
        return missed


def acting(action: model.Action, parameter: Parameter) -> bool:
    """Whether a parameter changes any number of the scene."""
    if not parameter.paths:
        return False
    try:
        found = model.sensitivity.find_parameters(action, [parameter.name])
        directions(action, model.choice_of(action), found)
    except InputError:
        return False
    return True


def tangents(task: tuple[model.Action, tuple[str, ...], Case, ObservedTrial]) -> Array:
    """Derivatives (m, c, n) of a trial's channels, per SI unit or per relative change.

    Raises
    ------
    model.errors.ModelError
        The derivatives cannot be carried on.
    """
    action, names, case, trial = task
    blow = trial.force_time_s, case.felt_n(trial)
    options = tangent_options(trial, case.preload_n(trial))
    found = model.sensitivities(action.with_values(case.changed), blow, names, options=options)
    turn = found.d_angles - found.d_rest[None]
    return np.stack([trial.seen(d[:, : len(BODIES)]) for d in np.moveaxis(turn, -1, 0)], axis=-1)


def tangent_options(trial: ObservedTrial, preload_n: float) -> model.SensitivityOptions:
    """How the derivatives of a trial's angles are integrated, from rest under a preload, N."""
    return model.SensitivityOptions(
        tolerance=MOTION,
        relative_tolerance=TANGENT,
        output_time_s=trial.model_time_s(),
        rest_input=preload_n,
        events=False,
        allow_idle=True,
    )


class ForceRuns(PlacedRuns[Case]):
    """The project's model under the force of each trial; see `PlacedRuns` for the parameters."""

    errors = frozenset((FORCE_GAIN, FORCE_LEVEL, FORCE_DELAY, KEY_SCALE, KEY_ZERO))
    tangents = staticmethod(tangents)

    def cases(self, at: Array, own: Sequence[Own] | None) -> list[Case]:
        """The member of each trial where it is."""
        if own is None:
            return len(self.trials) * [self.case(at[0])]
        every = zip(at, self.trials, own, strict=True)
        return [self.case(place).with_noise(trial, o.drive) for place, trial, o in every]

    def case(self, z: Array) -> Case:
        """The member at z, of all parameters."""
        changed: dict[str, float] = {}
        bench: dict[str, float] = {}
        for parameter, value in zip(self.parameters, z, strict=True):
            changed |= parameter.values(self.action, float(value))
            if not parameter.paths:
                bench[parameter.name] = float(value)
        gain, level, delay, scale, zero = (
            bench.get(name, 0.0) for name in (FORCE_GAIN, FORCE_LEVEL, FORCE_DELAY, KEY_SCALE, KEY_ZERO)
        )
        return Case(changed, gain, level, delay, scale, zero)

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
        unit = [change / np.array(steps) for change in self.changes(points, names)]
        return [columns * own_units(t)[: columns.shape[2]] for columns, t in zip(unit, self.trials, strict=True)]

    def run(self, members: Sequence[Sequence[Case]]) -> list[list[Array] | None]:
        """Curves of every trial in each of several cases of all trials; None where one of them cannot run."""
        jobs: list[model.batch.Job] = []
        rests: list[list[tuple[model.Action, model.RestState]] | None] = []
        if len(self._known) > KEPT:
            self._known.clear()
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
        made = zip(members, rests, strict=True)
        return [None if found is None else self._curves(cases, found, done) for cases, found in made]

    def _rests(self, cases: Sequence[Case]) -> list[tuple[model.Action, model.RestState]] | None:
        """Action and rest of each trial; None where one of them has no rest. What is known from before is kept."""
        out = []
        try:
            for case, trial in zip(cases, self.trials, strict=True):
                values, preload = tuple(case.changed.values()), case.preload_n(trial)
                rests = self._known.get(values)
                if rests is None:
                    rests = self._known[values] = self.action.with_values(case.changed), {}
                action, by_preload = rests
                if preload not in by_preload:
                    by_preload[preload] = model.rest_state(action, force_n=preload)
                out.append((action, by_preload[preload]))
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
