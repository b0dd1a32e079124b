"""The model's response to trials of any kind, in their order: those that a force drives, those that the key drives."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import solve_banded

import model
from model.errors import ModelError
from model.motion_driven.prescribed_key import run_prescribed
from model.motion_driven.spline_fit import DEGREE
from validation.conventions import BODIES, Array
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
from validation.infer.unknowns import KEY_SCALE, KEY_ZERO, Parameter

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
        run = run_prescribed(own, drive.motion(trial).raised(float(rest[0])), when, tolerance=tolerance)
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
        jobs = [
            (self.action, drive, trial, self.tolerance)
            for drives in members
            for drive, trial in zip(drives, self.trials, strict=True)
        ]
        found, n = spread(self.executor, driven_curve, jobs), len(self.trials)
        by_case = [found[i * n : (i + 1) * n] for i in range(len(members))]
        return [None if any(c is None for c in some) else [c for c in some if c is not None] for some in by_case]


class MixedRuns:
    """Responses of two kinds of trials as one; see `force_runs.Response`."""

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
    by_force = [k for k, t in enumerate(trials) if t.key is None]
    by_key = [k for k, t in enumerate(trials) if t.key is not None]
    if not by_key:
        return ForceRuns(action, parameters, trials, tolerance, executor)
    driven = MotionRuns(action, parameters, [trials[k] for k in by_key], tolerance, executor)
    if not by_force:
        return driven
    forced = ForceRuns(action, parameters, [trials[k] for k in by_force], tolerance, executor)
    return MixedRuns([(by_force, forced), (by_key, driven)])
