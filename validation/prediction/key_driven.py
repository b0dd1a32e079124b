"""A trial whose measured key drives the model: the other bodies are the answer, of the model and of the null model.

Conventions: changes of angle since rest, rad, (n, 5) of all bodies on the trial's sample times; the hammer is as its
sensor reads it (`validation.measurement.position_sensors`), of an encoder as it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

import model
from model.errors import ModelError
from model.motion_driven.prescribed_key import PrescribedMotion, run_prescribed, run_prescribed_lanes
from model.motion_driven.spline_fit import KeyFit, fit_key_motion
from validation.conventions import BODIES, HAMMER, KEY, WHIPPEN, Array
from validation.measurement.trial import MeasuredTrial

TOLERANCE_RAD = 2e-4
"""Largest requested error of an angle that is asked for: after a release errors grow, at 1e-3 a bounce was 0.13 rad
off, and the smoothing of a measured key leaves more than this."""


@dataclass(frozen=True)
class KeyErrors:
    """Errors of the sensors of one bench in standard uncertainties: of a key encoder, or of position sensors (10,)."""

    scale: float = 0.0
    zero: float = 0.0
    positions: Array | None = None


EXACT = KeyErrors()


@lru_cache(maxsize=16)
def fitted_key(m: MeasuredTrial) -> KeyFit:
    """The motion of a trial's key by its encoder, since rest."""
    return fit_key_motion(m.time_s, m.change_rad[:, KEY], resolution_rad=float(m.resolution_rad[0]))


def key_motion(m: MeasuredTrial, rest_rad: float, errors: KeyErrors = EXACT) -> model.KeyMotion:
    """Angle of the key over time, rad, from ``rest_rad`` on, less ``errors`` of its sensor."""
    if m.sensors is not None:
        return m.sensors.key_motion(rest_rad, errors.positions)
    fit = fitted_key(m)
    scale = 1.0 + errors.scale * float(m.scale_relative_u[0])
    turned = (fit.coefficients + fit.offset_rad - errors.zero * float(m.u_rad[0])) / scale - fit.offset_rad
    return fit.motion(turned).raised(rest_rad)


def run_key_driven(
    action: model.Action, m: MeasuredTrial, rest_rad: Array, tolerance: float, errors: KeyErrors = EXACT
) -> tuple[Array, Array, dict[str, float]]:
    """Changes since rest (n, 5), rad, of key, whippen, jack, repetition, hammer as the sensors read them, speeds (n,
    5), rad/s, and counters of a run under the trial's key; ``rest_rad`` (5,): the action's rest; ``errors``: of the
    sensors, in u."""
    motion, at = _motion_and_times(m, rest_rad, errors)
    run = run_prescribed(action, motion, at, tolerance=min(tolerance, TOLERANCE_RAD))
    counters = {name: float(value) for name, value in run.counters.items()}
    order = [run.bodies.index(body) for body in BODIES]
    return _read_changes(m, run, rest_rad, errors), run.speed_rad_per_s[:, order], counters


def run_many_key_driven(
    runs: Sequence[tuple[model.Action, Array, KeyErrors]], m: MeasuredTrial, tolerance: float
) -> list[Array | None]:
    """Changes since rest (n, 5), rad, of key, whippen, jack, repetition, hammer as the sensors read them, at a trial's
    samples under its key, for each run: action, its rest (5,), rad, errors of the sensors; None where a run fails.

    None of a run that cannot be carried out. Side by side in lanes: no run's numbers depend on the other runs.
    """
    planned = [(action, *_motion_and_times(m, rest_rad, errors)) for action, rest_rad, errors in runs]
    found = run_prescribed_lanes(planned, tolerance=min(tolerance, TOLERANCE_RAD))
    return [
        None if isinstance(run, ModelError) else _read_changes(m, run, rest_rad, errors)
        for run, (_, rest_rad, errors) in zip(found, runs, strict=True)
    ]


def _motion_and_times(m: MeasuredTrial, rest_rad: Array, errors: KeyErrors) -> tuple[model.KeyMotion, Array]:
    """The motion of a trial's key, and the sample times within it: the fit ends where they do, to rounding."""
    motion = key_motion(m, float(rest_rad[KEY]), errors)
    at = np.clip(m.time_s, motion.break_s[0], motion.break_s[-1])
    at[1:] = np.maximum(at[1:], np.nextafter(at[:-1], np.inf))
    return motion, at


def _read_changes(m: MeasuredTrial, run: PrescribedMotion, rest_rad: Array, errors: KeyErrors) -> Array:
    order = [run.bodies.index(body) for body in BODIES]
    turn = run.angle_rad[:, order] - run.angle_rad[0, order]
    turn[:, KEY] += run.angle_rad[0, order[KEY]] - rest_rad[KEY]
    return read_by_sensors(m, turn, errors)


def read_by_sensors(m: MeasuredTrial, turn_rad: Array, errors: KeyErrors = EXACT) -> Array:
    """Changes of angle (n, 5) as the sensors of a trial read them."""
    if m.sensors is None:
        return turn_rad
    read = turn_rad.copy()
    read[:, HAMMER] = m.sensors.read_hammer(turn_rad[:, HAMMER], errors.positions)
    return read


STEP_S = 2.5e-4  # of the null model: choice, a contact with the string takes some ten


@dataclass(frozen=True)
class NullAction:
    """Quantities of an action that the null model needs."""

    reduced: model.null_model.Reduced
    weight_nm_at: tuple[float, float]
    damping: float
    reach_m: float

    @classmethod
    @lru_cache(maxsize=4)  # found once for all trials
    def from_action(cls, action: model.Action) -> NullAction:
        weight = action["hammer.mass"] * action["gravity.g"]
        centre = (weight * action["hammer.center_of_mass.x"], weight * action["hammer.center_of_mass.y"])
        reach = math.hypot(action["contact12.first.x"], action["contact12.first.y"])
        return cls(model.null_model.reduce_action(action), centre, action["contact12.normal.D"], reach)

    def fall(self, phi: float) -> float:
        """Angular acceleration of a free hammer towards the string, rad/s^2, at ``phi`` above its rest."""
        r = self.reduced
        angle = float(r.rest_rad[HAMMER]) + r.up * phi
        x, y = self.weight_nm_at
        return -r.up * (math.cos(angle) * x - math.sin(angle) * y) / r.hammer_inertia


def run_null_key_driven(action: model.Action, m: MeasuredTrial) -> Array:
    """Changes since rest (n, 5), rad, of key, whippen, jack, repetition, hammer that the null model predicts at a
    trial's samples under its measured key, as its sensors read them; jack and repetition NaN.

    The rules are those of `model.null_model` with the key's motion given instead of the force: the hammer rides with
    the joined path up to let-off or until it would have to be pulled, flies under gravity alone, rebounds from the
    string by the restitution of its felt, is caught where the back check or the repetition lever meets it, and rides
    again once the jack is back under it. Nothing in it is fitted to the action; sensors are tied to it as to the full
    model.
    """
    null, motion = NullAction.from_action(action), key_motion(m, 0.0)
    time_s = np.arange(m.time_s[0], m.time_s[-1], STEP_S)
    state = motion.at(np.clip(time_s, motion.break_s[0], motion.break_s[-1]))
    pressed, r = -state[:, 0], null.reduced
    phi = _integrate_hammer(null, pressed, -state[:, 1])
    whippen = np.interp(pressed, r.sigma, r.joined.angle_rad[:, WHIPPEN]) - float(r.rest_rad[WHIPPEN])
    turn = np.full((m.time_s.size, len(BODIES)), np.nan)
    for body, change in ((KEY, -pressed), (WHIPPEN, whippen), (HAMMER, r.up * phi)):
        turn[:, body] = np.interp(m.time_s, time_s, change)
    return read_by_sensors(m, turn)


def _integrate_hammer(null: NullAction, s: Array, w: Array) -> Array:
    """Hammer angle from rest towards the string (m,), rad, of the null model, for the key's turn ``s`` (m,), rad,
    positive when pressed, and its rate ``w`` (m,), rad/s, at steps of `STEP_S`."""
    r = null.reduced
    joined = r.up * (np.interp(s, r.sigma, r.joined.angle_rad[:, HAMMER]) - float(r.rest_rad[HAMMER]))
    speed = r.up * np.interp(s, r.sigma, r.joined.ratio[:, HAMMER]) * w
    open_at = np.where(np.isfinite(r.check_rad), r.check_rad, -1e9)
    caught_at = open_at[np.clip(np.searchsorted(r.sigma, s), 0, r.sigma.size - 1)]
    out = np.empty(s.size)
    phi, omega, riding, held, jack_out = float(joined[0]), 0.0, True, False, False
    for k in range(s.size):
        path, along = float(joined[k]), float(speed[k])
        if s[k] >= r.let_off:
            jack_out, riding = True, False
        elif jack_out:
            jack_out, held = False, False
        if riding and (along - omega) / STEP_S >= null.fall(phi):
            phi, omega = path, along
        elif not held:
            riding = False
            turn, above = null.fall(phi), phi
            phi += STEP_S * (omega + 0.5 * STEP_S * turn)
            omega += STEP_S * turn
            if jack_out and omega < 0.0 and phi <= caught_at[k] <= above:
                phi, omega, held = float(caught_at[k]), 0.0, True
        if not riding and phi <= path:
            phi = path
            if jack_out:
                omega, held = max(omega, 0.0), omega <= 0.0
            elif omega <= along:
                omega, riding, held = along, True, False
        if phi >= r.string_rad and omega > 0.0:
            omega *= -model.null_model.restitution(omega * null.reach_m, null.damping)
            phi, riding = r.string_rad, False
        out[k] = phi
    return out
