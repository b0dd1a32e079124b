"""The model's response to trials of any kind, in their order: those that a force drives, those that the key drives.

The key's motion is measured by an encoder or by a position sensor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import solve_banded

import model
from model.errors import ModelError
from model.motion_driven.prescribed_key import run_prescribed
from model.motion_driven.spline_fit import DEGREE, KeyFit
from validation.conventions import BODIES, Array
from validation.conventions import KEY as KEY_BODY
from validation.infer.blocks import MOVED_RAD
from validation.infer.force_runs import (
    ForceRuns,
    Own,
    PlacedRuns,
    Response,
    spread,
    tangent_options,
)
from validation.infer.observations import ObservedTrial
from validation.infer.unknowns import KEY_SCALE, KEY_ZERO, POSITIONS, Parameter
from validation.measurement.position_sensors import PositionSensors

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
        assert isinstance(fit, KeyFit)
        # control points of knots at every sample stand next to the curve
        c, turned = fit.coefficients, fit.coefficients + fit.offset_rad
        moved = -np.expm1(-np.abs(turned) / MOVED_RAD)
        for draw, weight in self.draws:
            random = np.random.default_rng([DRAW_SEED, trial.session, trial.number, draw])
            away = solve_banded((0, DEGREE), fit.factor, random.standard_normal(len(c)))
            rounded = fit.resolution_rad / np.sqrt(12.0) * random.standard_normal()  # of the trial's zero
            c = c + weight * (away + rounded * moved)
        off = c + fit.offset_rad - self.zero * trial.u_key_rad * moved
        return fit.motion(off / (1.0 + self.scale * trial.u_key_scale) - fit.offset_rad)


def driven_tangents(
    task: tuple[model.Action, tuple[str, ...], Drive, ObservedTrial, *tuple[Sequence[object], ...]],
) -> Array:
    """Derivatives (m, c, n) of a trial's channels, per SI unit or per relative change.

    Raises
    ------
    model.errors.ModelError
        The derivatives cannot be carried on.
    """
    action, names, drive, trial, *_ = task
    late = drive.film_late_s
    options = tangent_options(trial, trial.preload_n, trial.model_time_s(late))
    found = model.motion_sensitivities(action.with_values(drive.changed), drive.motion(trial), names, options=options)
    order = [found.angle_names.index(body) for body in BODIES]
    turn = (found.d_angles - found.d_rest[None])[:, order]
    return np.stack([trial.seen(turn[:, :, i], late) for i in range(len(names))], axis=-1)


def driven_curve(job: tuple[model.Action, Drive, ObservedTrial, float]) -> Array | None:
    """Channels (m, c) of a trial under its key's motion, to a tolerance in rad; None where the model cannot run."""
    action, drive, trial, tolerance = job
    when = trial.model_time_s(drive.film_late_s)
    try:
        own = action.with_values(drive.changed)
        rest = np.asarray(model.rest_state(own, force_n=trial.preload_n).angle_rad)
        run = run_prescribed(own, drive.motion(trial).shift_angle(float(rest[0])), when, tolerance=tolerance)
    except ModelError:
        return None
    order = [run.bodies.index(body) for body in BODIES]
    return trial.seen(run.angle_rad[:, order] - rest[: len(BODIES)], drive.film_late_s)


class MotionRuns(PlacedRuns[Drive]):
    """The project's model under measured motions of the key; see `PlacedRuns` for the parameters.

    What the encoder leaves open of a motion (rounding, also of its zero, jitter, smoothing) is carried by whole motions
    drawn from the posterior of its fit: each is a column, divided by the root of their number, so that the columns
    together have the covariance of the predicted curves.
    """

    errors = frozenset((KEY_SCALE, KEY_ZERO))
    tangents = staticmethod(driven_tangents)
    by_runs = True
    drive_steps = np.full(DRAWS, np.sqrt(DRAWS))  # one whole motion each

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
            return [self.drive(place) for place in at]
        out = []
        for place, trial, o in zip(at, self.trials, own, strict=True):
            draws = tuple((i, float(w) / np.sqrt(DRAWS)) for i, w in enumerate(o.drive[:DRAWS]) if w)
            late = float(o.drive[DRAWS]) * trial.u_film_time_s if o.drive.size > DRAWS else 0.0
            out.append(replace(self.drive(place), draws=draws, film_late_s=late))
        return out

    def run(self, members: Sequence[Sequence[Drive]]) -> list[list[Array] | None]:
        """Curves of every trial in each of several cases of all trials; None where one of them cannot run."""
        return run_cases(self, members, driven_curve)


def run_cases(
    runs: PlacedRuns[Any],
    members: Sequence[Sequence[Any]],
    curve: Callable[[tuple[model.Action, Any, ObservedTrial, float]], Array | None],
) -> list[list[Array] | None]:
    """Curves of every trial in each of several cases of all trials; None where one of them cannot run."""
    jobs = [
        (runs.action, drive, trial, runs.tolerance)
        for drives in members
        for drive, trial in zip(drives, runs.trials, strict=True)
    ]
    found, n = spread(runs.executor, curve, jobs), len(runs.trials)
    by_case = [found[i * n : (i + 1) * n] for i in range(len(members))]
    return [None if any(c is None for c in some) else [c for c in some if c is not None] for some in by_case]


LOOSEST = 1e-5
"""Tolerance of runs that are compared with position sensors, rad: a thousandth of what they know of an angle."""


@dataclass(frozen=True)
class PositionDrive:
    """What one run does: values of the action, and errors of the position sensors in u, (10,)."""

    changed: dict[str, float] = field(hash=False)
    errors: tuple[float, ...] = (0.0,) * len(POSITIONS)


def positions_curve(job: tuple[model.Action, PositionDrive, ObservedTrial, float]) -> Array | None:
    """Readings (m, 1) of a trial's position sensors under its key's motion; None where the model cannot run."""
    action, drive, trial, tolerance = job
    assert isinstance(trial.key, PositionSensors)
    away = np.array(drive.errors)
    try:
        own = action.with_values(drive.changed)
        rest = float(model.rest_state(own, force_n=trial.preload_n).angle_rad[KEY_BODY])
        motion = trial.key.key_motion(rest, away)
        run = run_prescribed(own, motion, np.concatenate([motion.break_s[:1], trial.time_s]), tolerance=tolerance)
    except ModelError:
        return None
    hammer = run.angle_rad[:, run.bodies.index("hammer")]
    return trial.key.read_hammer(hammer[1:] - hammer[0], away)[:, None]


class PositionRuns(PlacedRuns[PositionDrive]):
    """The project's model under motions of the key that position sensors measured; see `PlacedRuns`.

    Derivatives are differences of runs: one run takes milliseconds, and readings are held at the ruler's ends.
    """

    errors = frozenset(p.name for p in POSITIONS)
    by_runs = True
    drive_steps = np.empty(0)

    def __init__(
        self,
        action: model.Action,
        parameters: Sequence[Parameter],
        trials: Sequence[ObservedTrial],
        tolerance: float | None = None,
        executor: Executor | None = None,
    ) -> None:
        super().__init__(action, parameters, trials, max(tolerance or 0.0, LOOSEST), executor)

    def cases(self, at: Array, own: Sequence[Own] | None) -> list[PositionDrive]:
        """What the run of each trial does where it is."""
        return [self.drive(place) for place in at]

    def drive(self, z: Array) -> PositionDrive:
        """What the runs at z, of all parameters, do."""
        changed: dict[str, float] = {}
        errors = {p.name: 0.0 for p in POSITIONS}
        for p, value in zip(self.parameters, z, strict=True):
            changed |= p.values(self.action, float(value))
            if p.name in errors:
                errors[p.name] = float(value)
        return PositionDrive(changed, tuple(errors.values()))

    def run(self, members: Sequence[Sequence[PositionDrive]]) -> list[list[Array] | None]:
        """Curves of every trial in each of several cases of all trials; None where one of them cannot run."""
        return run_cases(self, members, positions_curve)

    def jacobian(
        self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None, driven: bool = False
    ) -> list[Array]:
        """Derivatives, see `Response`."""
        moving = [j for j in which if j in self.acting or self.parameters[j].name in self.errors]
        return self.differences(self.places(z, own), own, list(which), moving)


class MixedRuns:
    """Responses of several kinds of trials as one; see `force_runs.Response`."""

    def __init__(self, parts: Sequence[tuple[Sequence[int], Response]]) -> None:
        self.parts = [(list(places), response) for places, response in parts]
        self.size = sum(len(places) for places, _ in self.parts)

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        """Curves of every trial at each point; None where a trial of either kind cannot run."""
        found = [
            response.curves(points, None if own is None else [[o[k] for k in places] for o in own])
            for places, response in self.parts
        ]
        return [
            None if any(part[i] is None for part in found) else self._joined([part[i] for part in found])
            for i in range(len(points))
        ]

    def jacobian(
        self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None, driven: bool = False
    ) -> list[Array]:
        """Derivatives of every trial, see `Response`."""
        each = [response.jacobian(z, which, _those(places, own), driven) for places, response in self.parts]
        return self._joined(each)

    def of_trials(self, which: Sequence[int]) -> MixedRuns:
        """The response to some of the trials."""
        parts = [
            (
                [which.index(k) for k in places if k in which],
                response.of_trials([i for i, k in enumerate(places) if k in which]),
            )
            for places, response in self.parts
        ]
        return MixedRuns([(places, response) for places, response in parts if places])

    def _joined(self, parts: Sequence[list[Array] | None]) -> list[Array]:
        out: list[Array] = [np.empty(0)] * self.size
        for (places, _), curves in zip(self.parts, parts, strict=True):
            assert curves is not None
            for place, curve in zip(places, curves, strict=True):
                out[place] = curve
        return out


def _those(places: Sequence[int], own: Sequence[Own] | None) -> list[Own] | None:
    return None if own is None else [own[k] for k in places]


def response_to(
    action: model.Action,
    parameters: Sequence[Parameter],
    trials: Sequence[ObservedTrial],
    tolerance: float | None = None,
    executor: Executor | None = None,
) -> Response:
    """The project's model as it answers to these trials.

    Parameters
    ----------
    action : its values are z = 0
    parameters : what z moves, and after that laws which are fixed, but may be others in single trials
    trials : of either kind
    tolerance : largest error of any angle of a run, rad
    executor : where to compute; by default threads of this process
    """
    kinds: tuple[tuple[type[PlacedRuns[Any]], type], ...] = (
        (ForceRuns, type(None)),
        (MotionRuns, KeyFit),
        (PositionRuns, PositionSensors),
    )
    parts: list[tuple[list[int], Response]] = []
    for runs, driven_by in kinds:
        places = [k for k, t in enumerate(trials) if isinstance(t.key, driven_by)]
        if places:
            parts.append((places, runs(action, parameters, [trials[k] for k in places], tolerance, executor)))
    if len(parts) == 1:
        return parts[0][1]
    return MixedRuns(parts) if parts else ForceRuns(action, parameters, (), tolerance, executor)
