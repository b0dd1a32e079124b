"""The model under measured motions of the key, as a `Response`: curves, derivatives, what the encoder leaves open.

What the encoder leaves open of a motion (rounding, jitter, smoothing) is carried by whole motions drawn from the
posterior of its fit: each is a column, divided by the root of their number, so that the columns together have the
covariance of the predicted curves.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import solve_banded

import model
from model.errors import ModelError
from model.motion_driven.prescribed_key import run_prescribed
from model.motion_driven.spline_fit import DEGREE
from validation.conventions import BODIES, Array
from validation.identification.blocks import MOVED_RAD
from validation.identification.observations import ObservedTrial
from validation.identification.runs.exact_runs import MOTION, TANGENT, acting, derivatives_hold
from validation.identification.runs.model_runs import LATE_S, SMALL_STEP, STEP
from validation.identification.runs.own import Own
from validation.identification.runs.placed import TOLERANCE, PlacedRuns
from validation.identification.unknowns.priors import KEY_SCALE, KEY_ZERO, Parameter
from validation.prediction.elsewhere import spread

DRAWS = 24
DRAW_SEED = 160
"""Draws are the same wherever the fit stands: only what the action makes of them changes."""


@dataclass(frozen=True)
class Drive:
    """What one run does: values of the action, errors of the key's encoder in u, error of a film's clock.

    ``draws`` are whole motions of the posterior, by number and weight.
    """

    changed: dict[str, float] = field(hash=False)
    scale: float = 0.0
    zero: float = 0.0
    draws: tuple[tuple[int, float], ...] = ()
    film_late_s: float = 0.0

    def motion(self, trial: ObservedTrial) -> model.KeyMotion:
        """Motion of the key since rest, with the errors of its encoder taken off."""
        fit = trial.key
        assert fit is not None
        c = fit.coefficients
        for draw, weight in self.draws:
            random = np.random.default_rng([DRAW_SEED, trial.session, trial.number, draw])
            c = c + weight * solve_banded((0, DEGREE), fit.factor, random.standard_normal(len(c)))
        if self.scale or self.zero:
            # control points of knots at every sample stand next to the curve
            turned = c + fit.offset_rad
            zero = self.zero * trial.u_key_rad * -np.expm1(-np.abs(turned) / MOVED_RAD)
            c = (turned - zero) / (1.0 + self.scale * trial.u_key_scale) - fit.offset_rad
        return fit.motion(c)


class MotionRuns(PlacedRuns[Drive]):
    """The project's model under measured motions of the key; see `model_runs.ModelRuns` for the parameters."""

    def __init__(
        self,
        action: model.Action,
        parameters: Sequence[Parameter],
        trials: Sequence[ObservedTrial],
        tolerance: float = TOLERANCE,
        executor: Executor | None = None,
    ) -> None:
        super().__init__(action, parameters, trials, tolerance, executor)
        self.acting = [j for j, p in enumerate(self.parameters) if acting(action, p)]

    def drive(self, z: Array) -> Drive:
        """What the runs at z, of all parameters, do."""
        changed: dict[str, float] = {}
        errors = {KEY_SCALE: 0.0, KEY_ZERO: 0.0}
        for p, value in zip(self.parameters, z, strict=True):
            changed |= p.values(self.action, float(value))
            if p.name in errors:
                errors[p.name] = float(value)
        return Drive(changed, errors[KEY_SCALE], errors[KEY_ZERO])

    def cases(self, at: Array, own: Sequence[Own] | None) -> list[Drive]:
        """What the run of each trial does where it is."""
        if own is None:
            return len(self.trials) * [self.drive(at[0])]
        out = []
        for place, trial, o in zip(at, self.trials, own, strict=True):
            draws = tuple((i, float(w) / np.sqrt(DRAWS)) for i, w in enumerate(o.drive[:DRAWS]))
            late = float(o.drive[DRAWS]) * trial.u_film_time_s if o.drive.size > DRAWS else 0.0
            out.append(replace(self.drive(place), draws=draws, film_late_s=late))
        return out

    def jacobian(self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None) -> list[Array]:
        """Derivatives with respect to z; see `Response`."""
        errors = [j for j in which if self.parameters[j].name in (KEY_SCALE, KEY_ZERO)]
        at = self.places(z, own)
        try:
            found = [np.zeros((*t.change_rad.shape, len(which))) for t in self.trials]
            asked = [j for j in which if j in self.acting]
            if asked:
                names = tuple(self.parameters[j].name for j in asked)
                place, drives = [list(which).index(j) for j in asked], self.cases(at, own)
                tasks = [
                    (self.action.with_values(d.changed), names, d, t) for d, t in zip(drives, self.trials, strict=True)
                ]
                for out, here, columns in zip(found, at, spread(self.executor, driven_tangents, tasks), strict=True):
                    out[:, :, place] = columns * self.units(asked, here)
            self._by_differences(found, at, own, which, errors)
        except ModelError:  # differences of runs go on where a tangent cannot
            found = []
        if found and derivatives_hold(self, at, own, list(which), found):
            return found
        found = [np.zeros((*t.change_rad.shape, len(which))) for t in self.trials]
        self._by_differences(found, at, own, which, [j for j in which if j in self.acting or j in errors])
        return found

    def force_columns(self, z: Array, own: Sequence[Own] | None = None) -> list[Array]:
        """Columns of what the encoder leaves open of the key's motion, and of a film's clock; see `Response`."""
        here = self.cases(self.places(z, own), own)
        members = [here, *([replace(d, draws=(*d.draws, (draw, 1.0))) for d in here] for draw in range(DRAWS))]
        if any(t.film_time_s is not None for t in self.trials):
            members.append([replace(d, film_late_s=d.film_late_s + LATE_S) for d in here])
        base, *moved = self.run(members)
        _refuse(base)
        out = []
        for k, trial in enumerate(self.trials):
            columns = []
            for i, curves in enumerate(moved):
                _refuse(curves)
                unit = 1.0 / np.sqrt(DRAWS) if i < DRAWS else trial.u_film_time_s / LATE_S
                columns.append(unit * (curves[k] - base[k]))  # type: ignore[index]
            out.append(np.stack(columns, axis=-1))
        return out

    def _by_differences(
        self, out: Sequence[Array], at: Array, own: Sequence[Own] | None, which: Sequence[int], asked: Sequence[int]
    ) -> None:
        """Fill columns by differences of runs.

        Raises
        ------
        ModelError
            The model cannot run here, or a step away.
        """
        if not asked:
            return
        steps = [STEP if self.parameters[j].factor else SMALL_STEP for j in asked]
        places = [at, *(at + step * (np.arange(at.shape[1]) == j) for j, step in zip(asked, steps, strict=True))]
        base, *moved = self.there(places, own)
        _refuse(base)
        for j, step, curves in zip(asked, steps, moved, strict=True):
            _refuse(curves)
            for k in range(len(self.trials)):
                out[k][:, :, list(which).index(j)] = (curves[k] - base[k]) / step  # type: ignore[index]

    def run(self, members: Sequence[Sequence[Drive]]) -> list[list[Array] | None]:
        """Curves of every trial in each of several cases of all trials; None where one of them cannot run."""
        jobs = [
            Run(self.action, drive, trial, self.tolerance)
            for drives in members
            for drive, trial in zip(drives, self.trials, strict=True)
        ]
        found = spread(self.executor, curve_of, jobs)
        n = len(self.trials)
        by_case = [found[i * n : (i + 1) * n] for i in range(len(members))]
        return [None if any(c is None for c in some) else [c for c in some if c is not None] for some in by_case]


@dataclass(frozen=True)
class Run:
    """One run as plain data."""

    action: model.Action
    drive: Drive
    trial: ObservedTrial
    tolerance: float


def curve_of(job: Run) -> Array | None:
    """Channels (m, c) of one run; None where the model cannot run."""
    try:
        return driven_curve(job.action, job.drive, job.trial, job.tolerance)
    except ModelError:
        return None


def driven_curve(action: model.Action, drive: Drive, trial: ObservedTrial, tolerance: float) -> Array:
    """Channels (m, c) of a trial under its key's motion.

    Raises
    ------
    model.errors.ModelError
        The action has no rest, or cannot follow.
    """
    own = action.with_values(drive.changed)
    rest = np.asarray(model.rest_state(own, force_n=trial.preload_n).angle_rad)
    when = trial.model_time_s(drive.film_late_s)
    run = run_prescribed(own, drive.motion(trial).raised(float(rest[0])), when, tolerance=tolerance)
    order = [run.bodies.index(body) for body in BODIES]
    return trial.seen(run.angle_rad[:, order] - rest[: len(BODIES)], drive.film_late_s)


def driven_tangents(task: tuple[model.Action, tuple[str, ...], Drive, ObservedTrial]) -> Array:
    """Derivatives (m, c, n) of a trial's channels, per SI unit or per relative change.

    Raises
    ------
    model.errors.ModelError
        The derivatives cannot be carried on.
    """
    action, names, drive, trial = task
    options = model.SensitivityOptions(
        tolerance=MOTION,
        relative_tolerance=TANGENT,
        output_time_s=trial.model_time_s(),
        rest_input=trial.preload_n,
        events=False,
        allow_idle=True,
    )
    found = model.motion_sensitivities(action, drive.motion(trial), names, options=options)
    order = [found.angle_names.index(body) for body in BODIES]
    turn = (found.d_angles - found.d_rest[None])[:, order]
    return np.stack([trial.seen(turn[:, :, i]) for i in range(len(names))], axis=-1)


def _refuse(curves: Any) -> None:
    if curves is None:
        raise ModelError("identification: the model cannot run where the fit stands; start from other values")
