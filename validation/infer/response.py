"""The model's answer to trials, and how it changes with what may move.

Conventions: curves are changes since the model's own rest under the preload, (m, c) rad, of the channels a trial has;
derivatives are per prior standard uncertainty. A trial says what drives it: the recorded force, or the measured motion
of the key where it has one (`ObservedTrial.key`). Each trial is at a place of its own: a value of every parameter, what
z moves, and after that laws which are fixed, but may be others in single trials; and it has errors of its own drive.
Exact derivatives are integrated beside each stroke (`model.sensitivities`), those by the force at its knots among them;
a parameter that does nothing in the scene has a column of zeros. The noise of a force changes linearly between knots.
What the encoder leaves open of a key's motion (rounding, also of its zero, jitter, smoothing) is carried by whole
motions drawn from the posterior of its fit: each is a column, divided by the root of their number, so that the columns
together have the covariance of the predicted curves.

Runs are made on threads of this process or on the workers of an executor; answers come in the order of the jobs, so
that whatever is made of them is the same wherever they were computed, and what is lost there is said.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Protocol, TypeVar

import numpy as np
from scipy.linalg import solve_banded

import model
from model.errors import InputError, ModelError
from model.motion_driven.prescribed_key import run_prescribed
from model.motion_driven.spline_fit import DEGREE, KeyFit
from model.scene.string_terms import with_modes
from model.sensitivity.parameter_names import directions
from model.simulation.options import ForceDrivenOptions
from validation.conventions import BODIES, RECTANGULAR, WORKERS, Array
from validation.conventions import KEY as KEY_BODY
from validation.errors import ValidationInputError
from validation.infer.blocks import Block
from validation.infer.channels import (
    FORCE_DELAY,
    FORCE_GAIN,
    FORCE_LEVEL,
    KEY_SCALE,
    KEY_ZERO,
    ZERO,
    error_shape,
)
from validation.infer.observations import EVEN, FILM, ObservedTrial
from validation.infer.unknowns import POSITIONS, Parameter
from validation.measurement.position_sensors import PositionSensors

Job = TypeVar("Job")
Found = TypeVar("Found")


def lost_run_error(error: Exception) -> ValidationInputError:
    """What is said of a computation that did not come back."""
    what = " ".join(f"{type(error).__name__}: {error}".split())
    return ValidationInputError(
        f"identify: a run was lost where it was computed ({what}); nothing was written; run again"
    )


def map_jobs(executor: Executor | None, run: Callable[[Job], Found], jobs: Sequence[Job]) -> list[Found]:
    """Results of ``run(job)`` for every job, in their order, computed on the executor's workers or on threads of this
    process.

    Raises
    ------
    model.errors.ModelError
        What ``run`` raises.
    ValidationInputError
        A worker was lost, and with it the job.
    """
    if executor is None:
        with ThreadPoolExecutor(WORKERS) as pool:
            return list(pool.map(run, jobs))
    try:
        return list(executor.map(run, jobs))
    except ModelError:
        raise
    except Exception as error:
        raise lost_run_error(error) from error


@dataclass(frozen=True)
class Own:
    """Random effects of one trial."""

    # (p + h,) by how much what moves and what is fixed differs in this trial, in prior standard uncertainties
    laws: Array
    drive: Array  # (k,) of what drives the trial, in standard deviations

    def towards(self, other: Own, share: float) -> Own:
        """Random effects a ``share`` of the difference towards ``other``."""
        return Own(self.laws + share * (other.laws - self.laws), self.drive + share * (other.drive - self.drive))

    def apart(self, other: Own, scatter: Array) -> float:
        """Root mean square distance in standard deviations; ``scatter`` (p + h,) is that of the laws."""
        there = scatter > 0.0
        laws = (self.laws - other.laws)[there] / scatter[there]
        return float(np.sqrt(np.mean(np.concatenate([laws, self.drive - other.drive]) ** 2)))


def make_nothing_own(blocks: Sequence[Block]) -> list[Own]:
    """Of each trial: it is as all are."""
    return [Own(np.zeros(b.moved.shape[1] + b.held.shape[1]), np.zeros(b.driven)) for b in blocks]


def remove_own(blocks: Sequence[Block], residuals: Sequence[Array], own: Sequence[Own]) -> list[Array]:
    """Residuals of each trial with its random effects removed by the linear model."""
    return [
        r + np.hstack([b.moved, b.held]) @ o.laws + b.own[:, : b.driven] @ o.drive
        for r, b, o in zip(residuals, blocks, own, strict=True)
    ]


SEGMENTS = 36  # of a trial, between which its force noise is taken to change linearly
BEFORE_S = 2e-3  # before the force acts it is the preload, without noise; over so long the noise comes up


def noise_knots(trial: ObservedTrial) -> Array:
    """Times (SEGMENTS + 1,), s, of the knots between which the noise of the force is linear: the first just before the
    force acts, the others so that the action moves about equally far between them.

    They begin where the force first differs from the preload: a soft stroke's first phase is later. Between two of them
    the action moves equally far, but for the share that is spread over time: where a stroke rises twice, noise
    of the second rise in long parts went into friction and felt.
    """
    end = float(trial.force_time_s[-1])
    acts = np.flatnonzero(trial.force_n != trial.force_n[0])
    first = min(float(trial.time_s[0]), float(trial.force_time_s[acts[0]] if acts.size else end))
    at = np.unique(np.concatenate([[first], trial.time_s[trial.time_s < end], [end]]))
    passed = (1.0 - EVEN) * np.linspace(0.0, 1.0, at.size) + EVEN * (at - first) / (end - first)
    return np.concatenate([[first - BEFORE_S], np.interp(np.linspace(0.0, 1.0, SEGMENTS), passed, at)])


def slow_noise_n(trial: ObservedTrial) -> Array:
    """Standard deviation of white force noise, averaged around each knot but the first, N."""
    step = float(np.median(np.diff(trial.force_time_s)))
    knots = noise_knots(trial)
    length = 0.5 * (np.append(knots[2:], knots[-1]) - knots[:-1])
    return np.asarray(trial.noise_n * np.sqrt(step / length))


def own_units(trial: ObservedTrial) -> Array:
    """Standard deviations (2 + SEGMENTS,) of a trial's random effects: force (N), then its film's clock (s)."""
    return np.concatenate([[trial.u_offset_n], slow_noise_n(trial), [trial.u_film_time_s]])


DRAWS, DRAW_SEED = 24, 160  # of a key's motion: the same wherever the fit stands
TOLERANCE = 2e-7  # rad, of runs: a thousandth of an encoder's step
LOOSEST = 1e-5  # rad, of runs for events or position sensors: a thousandth of what these know of an angle
MODES_RAD = 3e-5  # error of an angle by which a fit chooses a string's modes: the runs' own asks for all there are
MOTION, TANGENT = 1e-7, 1e-4  # rad, of a run with tangents; of the tangents, relative
FINER = 0.1  # times the tolerance, of runs whose differences are derivatives: a run's error is divided by the step
KEPT = 200  # actions, with their rests and curves, that are kept from run to run
PROBE, PROBED_RAD = 0.01, 1e-5  # prior standard uncertainties, and angle: the step that checks the derivatives
MISSED = 0.2  # of the change: derivatives that miss it by more are not used
STEP = 0.015  # of a prior standard uncertainty: half a percent of a friction; after an impact larger steps bend
SMALL_STEP = 0.02  # of what is known well; strokes of several kinds tell the force's level to a hundredth of its prior
ERROR_STEP = 1e-3  # standard uncertainties: a difference of tables of forces, no run


@dataclass(frozen=True)
class Case:
    """Settings of one run: values of the action that differ, and errors of what drives the trial and of its sensors."""

    changed: dict[str, float] = field(default_factory=dict, hash=False)  # values of the action
    # gain, level, delay: errors of the force that all trials share, in standard uncertainties
    gain: float = 0.0
    level: float = 0.0
    delay: float = 0.0
    # key_scale, key_zero: errors of the key's encoder, likewise
    key_scale: float = 0.0
    key_zero: float = 0.0
    offset_n: float = 0.0  # of each trial's force once it acts, N
    noise_n: tuple[float, ...] = ()  # force noise at each knot of `noise_knots`, N; empty where there is none
    draws: tuple[tuple[int, float], ...] = ()  # whole motions of the key's posterior, by number and weight
    film_late_s: float = 0.0  # error of a film's clock
    sensors: tuple[float, ...] = ()  # errors of the position sensors, in standard uncertainties

    def felt_n(self, trial: ObservedTrial) -> Array:
        """Force (k,), N, that drives the model at ``trial.force_time_s``: the recorded one with this case's gain,
        level, offset and noise added, acting later by its delay; held beyond the record."""
        when, force = trial.force_time_s, trial.force_n * (1 + self.gain * trial.u_gain) + self._level_n(trial)
        if self.delay:
            force = np.interp(when, when + self.delay * trial.u_delay_s, force)
        if self.noise_n:
            force = force + np.interp(when, noise_knots(trial), self.noise_n)
        return force

    def motion(self, trial: ObservedTrial) -> model.KeyMotion:
        """Motion of the key since rest, rad, that drives the model: the trial's fitted one plus this case's draws of
        its posterior, less its errors of the encoder's zero and scale."""
        fit = trial.key
        assert isinstance(fit, KeyFit)
        # control points of knots at every sample stand next to the curve
        c, turned = fit.coefficients, fit.coefficients + fit.offset_rad
        moved = error_shape(ZERO, turned)
        for draw, weight in self.draws:
            random = np.random.default_rng([DRAW_SEED, trial.session, trial.number, draw])
            away = solve_banded((0, DEGREE), fit.factor, random.standard_normal(len(c)))
            rounded = fit.resolution_rad * RECTANGULAR * random.standard_normal()  # of the trial's zero
            c = c + weight * (away + rounded * moved)
        off = c + fit.offset_rad - self.key_zero * trial.u_key_rad * moved
        return fit.motion(off / (1.0 + self.key_scale * trial.u_key_scale) - fit.offset_rad)

    def preload_n(self, trial: ObservedTrial) -> float:
        """Force (N) on the key at rest, with this case's errors."""
        if trial.key is not None:
            return trial.preload_n
        return trial.preload_n * (1 + self.gain * trial.u_gain) + self._level_n(trial)

    def with_drive(self, trial: ObservedTrial, weights: Array) -> Case:
        """Copy with a trial's random effects ``weights`` (k,), in standard deviations: offset and noise at each knot
        but the first of its force, or draws of its key's motion; then the error of its film's clock. Itself where all
        are 0."""
        if not weights.any():
            return self
        n = DRAWS if trial.key is not None else 1 + SEGMENTS
        late = float(weights[n]) * trial.u_film_time_s if weights.size > n else 0.0
        if trial.key is not None:
            draws = tuple((i, float(w) / np.sqrt(DRAWS)) for i, w in enumerate(weights[:n]) if w)
            return replace(self, draws=draws, film_late_s=late)
        found = own_units(trial)[:n] * weights[:n]
        return replace(self, offset_n=float(found[0]), noise_n=(0.0, *map(float, found[1:])), film_late_s=late)

    def read(self, trial: ObservedTrial, turn_rad: Array) -> Array:
        """Readings (m, c), rad since rest, of a trial's channels for the model's turns since rest (k, 5), rad, of key,
        whippen, jack, repetition, hammer at `model_time_s`, with this case's errors of the key's encoder and of the
        film's clock."""
        seen = trial.seen(turn_rad, self.film_late_s)
        if trial.key_moves and trial.channels[0] == 0:
            turned = seen[:, 0]
            zero = self.key_zero * trial.u_key_rad * error_shape(ZERO, turned)
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

    def jacobian(
        self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None, driven: bool = False
    ) -> list[Array]:
        """Derivatives (m, c, len(which) + k) of every trial's curves at z, rad per standard uncertainty: by the
        parameters of index ``which`` (beyond z fixed laws), then, if ``driven``, by the k random effects of its own
        drive, else k = 0.

        ``driven``: followed by those with respect to the k numbers that a trial has of its own drive: force offset,
        parts of force noise, a film's clock. Else k is 0.
        """

    def of_trials(self, which: Sequence[int]) -> Response:
        """The response to some of the trials."""


FORCE_ERRORS = frozenset((FORCE_GAIN, FORCE_LEVEL, FORCE_DELAY, KEY_SCALE, KEY_ZERO))
KEY_ERRORS = frozenset((KEY_SCALE, KEY_ZERO))
POSITION_ERRORS = frozenset(p.name for p in POSITIONS)
"""Errors of what drives a trial, and of its sensors, by what drives it."""
_Run = tuple[Case, float, int]
"""Which run: of a case, to a tolerance, of a trial by its `id`."""


@dataclass(frozen=True)
class _Known:
    """An action, its rests by preload, and curves of its runs; None of one that could not run."""

    action: model.Action
    rests: dict[float, model.RestState]
    curves: dict[_Run, Array | None]


class ModelResponse:
    """The project's model as a `Response`.

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

    def __init__(
        self,
        action: model.Action,
        parameters: Sequence[Parameter],
        trials: Sequence[ObservedTrial],
        tolerance: float | None = None,
        executor: Executor | None = None,
    ) -> None:
        self.action = with_modes(action, MODES_RAD)
        self.parameters = tuple(parameters)
        self.trials: tuple[ObservedTrial, ...] = tuple(trials)
        self.tolerance, self.executor = TOLERANCE if tolerance is None else tolerance, executor
        self.refinement = 1.0  # of the tolerance
        self.is_filmed = any(t.film_time_s is not None for t in trials)
        self.acting = [j for j, p in enumerate(self.parameters) if is_acting(action, p)]
        self._known: dict[tuple[float, ...], _Known] = {}

    def of_trials(self, which: Sequence[int]) -> ModelResponse:
        """The response to some of the trials."""
        some = copy(self)
        some.trials = tuple(self.trials[k] for k in which)
        return some

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        """Curves at each point; see `Response`."""
        every = zip(points, len(points) * [None] if own is None else own, strict=True)
        return self.run([self.cases(self.places(z, o), o) for z, o in every])

    def places(self, z: Array, own: Sequence[Own] | None) -> Array:
        """Point of each trial (trials, n) in all parameters: z, zeros beyond it, plus its random effects of laws."""
        at = np.zeros((len(self.trials), len(self.parameters)))
        at[:, : z.size] = z
        for k, o in enumerate(own or ()):
            at[k, : o.laws.size] += o.laws
        return at

    def cases(self, points: Array, own: Sequence[Own] | None) -> list[Case]:
        """Settings of each trial's run, at its row of ``points`` (trials, n), with its random effects ``own``."""
        distinct = {point.tobytes(): self.case(point) for point in points}
        shared = [distinct[point.tobytes()] for point in points]
        if own is None:
            return shared
        return [case.with_drive(trial, o.drive) for case, trial, o in zip(shared, self.trials, own, strict=True)]

    def case(self, z: Array) -> Case:
        """Settings of a run at z (n,), amounts of all parameters in prior standard uncertainties: changed values of the
        action, and errors of the force and the sensors."""
        changed: dict[str, float] = {}
        bench: dict[str, float] = {}
        for parameter, value in zip(self.parameters, z, strict=True):
            changed |= parameter.values(self.action, float(value))
            if not parameter.paths:
                bench[parameter.name] = float(value)
        gain, level, delay, scale, zero = (
            bench.get(name, 0.0) for name in (FORCE_GAIN, FORCE_LEVEL, FORCE_DELAY, KEY_SCALE, KEY_ZERO)
        )
        sensors = tuple(bench.get(p.name, 0.0) for p in POSITIONS)
        return Case(changed, gain, level, delay, scale, zero, sensors=sensors)

    def jacobian(
        self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None, driven: bool = False
    ) -> list[Array]:
        """Derivatives (m, c, len(which) + k) of every trial's curves, rad per standard uncertainty, by parameters
        ``which``, then, if ``driven``, by the k random effects of its drive: by tangents, or by differences of runs
        where these fail a check."""
        out: list[Array] = [np.empty(0)] * len(self.trials)
        for places in self._group_by_drive():
            some, those = self.of_trials(places), None if own is None else [own[k] for k in places]
            for k, found in zip(places, some._jacobian(z, which, those, driven), strict=True):
                out[k] = found
        return out

    def _group_by_drive(self) -> list[list[int]]:
        """Trials of each kind of drive that there is: a force, a key's encoder, a position sensor."""
        kinds = (type(None), KeyFit, PositionSensors)
        found = [[k for k, t in enumerate(self.trials) if isinstance(t.key, kind)] for kind in kinds]
        return [places for places in found if places]

    @property
    def _is_by_position(self) -> bool:
        return isinstance(self.trials[0].key, PositionSensors)

    @property
    def _run_tolerance(self) -> float:
        """Largest error of any angle of a run, rad, of trials of one kind."""
        return self.refinement * (max(self.tolerance, LOOSEST) if self._is_by_position else self.tolerance)

    @property
    def _drive_steps(self) -> Array:
        """Steps (k,), in standard deviations, of differences by the k random effects of each trial's drive, for trials
        of one kind of drive; none for position sensors.

        Of a force its offset, and noise at each knot but the first, which is the preload; of a key whole motions.
        """
        if self._is_by_position:
            return np.empty(0)
        by_key = self.trials[0].key is not None
        steps = np.full(DRAWS, np.sqrt(DRAWS)) if by_key else np.ones(1 + SEGMENTS)
        return np.append(steps, np.ones(int(self.is_filmed)))

    def _jacobian(self, z: Array, which: Sequence[int], own: Sequence[Own] | None, driven: bool) -> list[Array]:
        """Derivatives (m, c, columns) of each trial's curves, rad per standard uncertainty, at z, by the parameters
        numbered ``which``, then, if ``driven``, by the drive's random effects; all trials of this response have one
        kind of drive."""
        if self._is_by_position:  # runs take milliseconds, and readings are held at the ruler's ends
            moving = [j for j in which if j in self.acting or self.parameters[j].name in POSITION_ERRORS]
            return self.differences(self.places(z, own), own, list(which), moving)
        by_key = self.trials[0].key is not None  # runs tell what its errors and its drive do
        at, n = self.places(z, own), len(self.parameters)
        columns = [*which, *(range(n, n + self._drive_steps.size) if driven else ())]
        laws = [j for j in columns if j in self.acting]
        rest = [j for j in columns if j >= n or self.parameters[j].name in (KEY_ERRORS if by_key else FORCE_ERRORS)]
        told = laws if by_key else [*laws, *rest]
        try:
            found = self.differences(at, own, columns, rest if by_key else [])
            if told:
                for out, here, column in zip(
                    found, at, self._differentiate_by_tangents(at, own, laws, told), strict=True
                ):
                    unit = [self.parameters[j].per_u(self.action, float(here[j])) for j in laws]
                    out[:, :, [columns.index(j) for j in told]] = column * np.append(
                        unit, np.ones(len(told) - len(laws))
                    )
        except ModelError:  # differences of runs go on where a tangent cannot
            return self.differences(at, own, columns, [*laws, *rest])
        wrong = self._find_wrong_tangents(at, own, columns, found)
        if wrong:
            some = self.of_trials(wrong)
            those = None if own is None else [own[k] for k in wrong]
            again = some.differences(at[np.array(wrong)], those, columns, [*laws, *rest])
            for k, redone in zip(wrong, again, strict=True):
                found[k] = redone
        return found

    def _differentiate_by_tangents(
        self, at: Array, own: Sequence[Own] | None, laws: Sequence[int], told: Sequence[int]
    ) -> list[Array]:
        """Derivatives (m, c, n) of each trial's curves at its row of ``at`` (trials, p), by tangents: by the ``laws``
        (indices; per SI unit or relative change), then by the others of ``told``, which begins with the laws."""
        names, n = tuple(self.parameters[j].name for j in laws), at.shape[1]
        ends = [
            [self.cases(at + step * (np.arange(n) == j), own) for step in (ERROR_STEP, -ERROR_STEP)]
            for j in told[len(laws) :]
            if j < n
        ]
        drives = [j - n for j in told if j >= n]
        tasks = [
            (self.action, names, case, trial, [(plus[k], minus[k]) for plus, minus in ends], drives)
            for k, (case, trial) in enumerate(zip(self.cases(at, own), self.trials, strict=True))
        ]
        return map_jobs(self.executor, driven_tangents if self.trials[0].key is not None else tangents, tasks)

    def shift_cases(self, at: Array, own: Sequence[Own] | None, step: Array) -> list[Case]:
        """Settings of each trial's run a ``step`` (trials, n + k) further, in parameters and drive."""
        further, drive = np.split(np.broadcast_to(step, (len(self.trials), step.shape[-1])), [at.shape[1]], axis=1)
        if drive.any():
            each = [Own(np.empty(0), np.empty(0)) for _ in self.trials] if own is None else own
            own = [replace(o, drive=(o.drive if o.drive.size else 0.0) + d) for o, d in zip(each, drive, strict=True)]
        return self.cases(at + further, own)

    def differences(
        self, at: Array, own: Sequence[Own] | None, columns: Sequence[int], asked: Sequence[int]
    ) -> list[Array]:
        """Derivatives (m, c, len(columns)) of each trial's curves at its row of ``at`` (trials, p), rad per standard
        uncertainty, by one-sided differences of runs; of ``columns`` not ``asked`` for 0. ModelError where the model
        cannot run.

        Raises
        ------
        ModelError
            The model cannot run here, or a step away.
        """
        out = [np.zeros((*t.change_rad.shape, len(columns))) for t in self.trials]
        if not asked:
            return out
        fine = copy(self)
        fine.refinement = FINER
        steps = np.append([STEP if p.factor else SMALL_STEP for p in self.parameters], self._drive_steps)
        members = [self.shift_cases(at, own, steps * (np.arange(steps.size) == j)) for j in asked]
        base, *ends = fine.run([self.cases(at, own), *members])
        if base is None:
            raise ModelError("identification: the model cannot run where the fit stands; start from other values")
        for j, curves in zip(asked, ends, strict=True):
            if curves is None:
                what = self.parameters[j].name if j < at.shape[1] else "what drives a trial"
                raise ModelError(
                    f"identification: the model cannot run with a small change of {what}; hold it (`fixed`)"
                )
            for derivative, curve, here in zip(out, curves, base, strict=True):
                derivative[:, :, columns.index(j)] = (curve - here) / steps[j]
        return out

    def _find_wrong_tangents(
        self, at: Array, own: Sequence[Own] | None, columns: list[int], jacobian: Sequence[Array]
    ) -> list[int]:
        """Indices of trials whose derivatives ``jacobian`` (m, c, len(columns)) miss the change by a small step in all
        ``columns`` by over a fifth of it, found by runs; all trials where these fail. ``at`` (trials, p): their points.

        A tangent that steps over a layer in which friction turns round may grow without bound; a difference shows it.
        """
        step = np.zeros(at.shape[1] + self._drive_steps.size)
        step[columns] = PROBE * np.where(np.arange(len(columns)) % 2, 1.0, -1.0)
        said = [derivative @ step[columns] for derivative in jacobian]
        # many columns at once bend a stroke: what moves it further than this is no small step
        share = [min(1.0, PROBED_RAD / max(float(np.sqrt(np.mean(d**2))), np.finfo(float).tiny)) for d in said]
        here, moved = self.run([self.cases(at, own), self.shift_cases(at, own, np.outer(share, step))])
        if here is None or moved is None:
            return list(range(len(self.trials)))
        missed = []
        for k, (a, b, d) in enumerate(zip(here, moved, said, strict=True)):
            if np.sqrt(np.mean((b - a - share[k] * d) ** 2)) > MISSED * np.sqrt(np.mean((b - a) ** 2)) + self.tolerance:
                missed.append(k)
        return missed

    def run(self, members: Sequence[Sequence[Case]]) -> list[list[Array] | None]:
        """Curves (m, c), rad, of every trial for each of ``members``, which has one case a trial; None in place of a
        member in which any trial cannot run."""
        out: list[list[Array | None]] = [[None] * len(self.trials) for _ in members]
        for places in self._group_by_drive():
            some = self.of_trials(places)
            found = (some._run_by_force if some.trials[0].key is None else some._run_by_key)(
                [[cases[k] for k in places] for cases in members]
            )
            for row, curves in zip(out, found, strict=True):
                for k, curve in zip(places, curves or [None] * len(places), strict=True):
                    row[k] = curve
        return [None if any(c is None for c in row) else [c for c in row if c is not None] for row in out]

    def _run_by_key(self, members: Sequence[Sequence[Case]]) -> list[list[Array | None] | None]:
        """Curves (m, c), rad, of every trial for each list of cases (one a trial), driven by its key's encoder or
        position sensor; None in place of each run that fails."""
        jobs = [
            (self.action, case, trial, self._run_tolerance)
            for cases in members
            for case, trial in zip(cases, self.trials, strict=True)
        ]
        curve = positions_curve if self._is_by_position else driven_curve
        found, n = map_jobs(self.executor, curve, jobs), len(self.trials)
        return [found[i * n : (i + 1) * n] for i in range(len(members))]

    def _run_by_force(self, members: Sequence[Sequence[Case]]) -> list[list[Array | None] | None]:
        """Curves (m, c), rad, of every trial for each list of cases (one a trial), driven by its force and kept in
        memory; None in place of each run that fails, and of a list in which an action has no rest."""
        if len(self._known) > KEPT:
            self._known.clear()
        jobs: list[model.batch.Job] = []
        waiting: dict[_Run, tuple[_Known, ObservedTrial, model.RestState]] = {}
        places: list[list[tuple[_Known, _Run]] | None] = []
        for cases in members:
            rests = self._rests(cases)
            if rests is None:
                places.append(None)
                continue
            keys = [(case, self._run_tolerance, id(trial)) for case, trial in zip(cases, self.trials, strict=True)]
            places.append([(known, key) for (known, _), key in zip(rests, keys, strict=True)])
            for (known, rest), key, trial in zip(rests, keys, self.trials, strict=True):
                if key not in known.curves and key not in waiting:
                    waiting[key] = known, trial, rest
                    when = trial.model_time_s(key[0].film_late_s)
                    chosen = ForceDrivenOptions(tolerance=self._run_tolerance, output_time_s=when)
                    table = {trial.label: (trial.force_time_s, key[0].felt_n(trial))}
                    jobs += model.batch.make_jobs(known.action, table, {"": {}}, chosen, rest)
        done = model.batch.run_jobs(model.batch.lanes.select_lane_jobs(jobs, None), executor=self.executor)
        for (key, (known, trial, rest)), member in zip(waiting.items(), done, strict=True):
            if member.error is not None and not isinstance(member.error, ModelError):
                raise lost_run_error(member.error)  # a run that was lost is not a model that cannot run
            known.curves[key] = None
            if member.solution is not None:
                turn = np.asarray(member.solution.angle_rad)[:, :5] - rest.angle_rad[:5]
                known.curves[key] = key[0].read(trial, turn)
        return [None if row is None else [known.curves[key] for known, key in row] for row in places]

    def _rests(self, cases: Sequence[Case]) -> list[tuple[_Known, model.RestState]] | None:
        """Cached action and rest state of each case, one for each of this response's trials in order; None where one of
        them has no rest."""
        out = []
        try:
            for case, trial in zip(cases, self.trials, strict=True):
                values, preload = tuple(case.changed.values()), case.preload_n(trial)
                known = self._known.get(values)
                if known is None:
                    known = self._known[values] = _Known(self.action.with_values(case.changed), {}, {})
                if preload not in known.rests:
                    known.rests[preload] = model.rest_state(known.action, force_n=preload)
                out.append((known, known.rests[preload]))
        except ModelError:
            return None
        return out


def is_acting(action: model.Action, parameter: Parameter) -> bool:
    """Whether a parameter changes any number of the scene."""
    if not parameter.paths:
        return False
    try:
        found = model.sensitivity.find_parameters(action, [parameter.name])
        directions(action, model.choice_of(action), found)
    except InputError:
        return False
    return True


def tangents(
    task: tuple[model.Action, tuple[str, ...], Case, ObservedTrial, Sequence[tuple[Case, Case]], Sequence[int]],
) -> Array:
    """Derivatives (m, c, n), rad, of the channels of a force-driven trial by tangents; ``task``: action, names of
    parameters, case, trial, pairs of cases (plus, minus), places in `own_units`. They come by names, pairs and places
    in this order.

    Per SI unit or per relative change; a pair lies `ERROR_STEP` to both sides of the case, in the force or in what
    sensors read, and its derivative is per unit; of the trial's own drive some of `own_units` are told, by their place.

    Raises
    ------
    model.errors.ModelError
        The derivatives cannot be carried on.
    """
    action, names, case, trial, pairs, drives = task
    width, late, when = 2.0 * ERROR_STEP, case.film_late_s, trial.force_time_s
    knots, unit = noise_knots(trial), own_units(trial)
    of_force = [i for i in drives if i <= SEGMENTS]
    force = [(a.felt_n(trial) - b.felt_n(trial)) / width for a, b in pairs]
    force += [
        unit[i] * np.interp(when, knots, np.arange(SEGMENTS + 1) == i) if i else unit[0] + 0 * when for i in of_force
    ]
    rest = [(a.preload_n(trial) - b.preload_n(trial)) / width for a, b in pairs]
    rest += [0.0 if i else unit[0] for i in of_force]
    found = model.sensitivities(
        action.with_values(case.changed),
        (when, case.felt_n(trial)),
        names,
        options=tangent_options(trial, case.preload_n(trial), trial.model_time_s(late)),
        inputs=(np.column_stack(force), np.array(rest)) if force else None,
    )
    turn, speed = (found.angles_rad - found.rest_rad)[:, : len(BODIES)], found.speeds[:, : len(BODIES)]
    moves = np.moveaxis((found.d_angles - found.d_rest)[:, : len(BODIES)], -1, 0)
    out = [trial.seen(d, late) for d in moves]
    for k, ends in enumerate(pairs, len(names)):
        a, b = (end.read(trial, turn) for end in ends)
        out[k] += (a - b) / width
    if len(of_force) < len(drives):  # the film's clock: its frames see the motion later
        film = np.isin(trial.channels, FILM)
        out.append(unit[1 + SEGMENTS] * film * trial.seen(speed, late))
    return np.stack(out, axis=-1)


def tangent_options(trial: ObservedTrial, preload_n: float, time_s: Array) -> model.SensitivityOptions:
    """Options of `model.sensitivities` for a trial's angles: from rest under ``preload_n``, N, with derivatives at the
    times ``time_s`` (k,), s."""
    return model.SensitivityOptions(
        tolerance=MOTION,
        relative_tolerance=TANGENT,
        output_time_s=time_s,
        rest_input=preload_n,
        events=False,
        allow_idle=True,
    )


def driven_tangents(
    task: tuple[model.Action, tuple[str, ...], Case, ObservedTrial, *tuple[Sequence[object], ...]],
) -> Array:
    """Derivatives (m, c, n) of the channels of a trial that its key drives, by the named parameters, rad per SI unit or
    per relative change; ``task``: action, names, case, trial, the rest ignored. ModelError where it cannot go on.

    Raises
    ------
    model.errors.ModelError
        The derivatives cannot be carried on.
    """
    action, names, case, trial, *_ = task
    late = case.film_late_s
    options = tangent_options(trial, trial.preload_n, trial.model_time_s(late))
    found = model.motion_sensitivities(action.with_values(case.changed), case.motion(trial), names, options=options)
    order = [found.angle_names.index(body) for body in BODIES]
    turn = (found.d_angles - found.d_rest[None])[:, order]
    return np.stack([trial.seen(turn[:, :, i], late) for i in range(len(names))], axis=-1)


def driven_curve(job: tuple[model.Action, Case, ObservedTrial, float]) -> Array | None:
    """Angles since rest (m, c), rad, of a trial's channels under its key's motion; ``job``: action, case, trial,
    tolerance (rad). None where the model cannot run."""
    action, case, trial, tolerance = job
    when = trial.model_time_s(case.film_late_s)
    try:
        own = action.with_values(case.changed)
        rest = np.asarray(model.rest_state(own, force_n=trial.preload_n).angle_rad)
        run = run_prescribed(own, case.motion(trial).shift_angle(float(rest[0])), when, tolerance=tolerance)
    except ModelError:
        return None
    order = [run.bodies.index(body) for body in BODIES]
    return trial.seen(run.angle_rad[:, order] - rest[: len(BODIES)], case.film_late_s)


def positions_curve(job: tuple[model.Action, Case, ObservedTrial, float]) -> Array | None:
    """Reading (m, 1), as a hammer angle since rest, rad, of a trial's position sensor under its key's motion; ``job``:
    action, case, trial, tolerance (rad). None where the model cannot run."""
    action, case, trial, tolerance = job
    assert isinstance(trial.key, PositionSensors)
    away = np.array(case.sensors)
    try:
        own = action.with_values(case.changed)
        rest = float(model.rest_state(own, force_n=trial.preload_n).angle_rad[KEY_BODY])
        motion = trial.key.key_motion(rest, away)
        run = run_prescribed(own, motion, np.concatenate([motion.break_s[:1], trial.time_s]), tolerance=tolerance)
    except ModelError:
        return None
    hammer = run.angle_rad[:, run.bodies.index("hammer")]
    return trial.key.read_hammer(hammer[1:] - hammer[0], away)[:, None]
