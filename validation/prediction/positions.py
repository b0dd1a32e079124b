"""The hammer under the measured key, by the full model and by the null model, as predictions of a few parameters.

The parameters: sensors, regulation, a few properties of the action. Each has a nominal value (that of the action, or of
a sensor as its ruler says) and a wide prior. A vector ``z`` counts standard deviations of the priors, zero is nominal.
Screws add to a place, m; everything else is a factor exp(.).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d

import model
from model.motion_driven.prescribed_key import run_prescribed
from validation.conventions import HAMMER, Array
from validation.errors import ValidationInputError
from validation.measurement.positions import Stroke

DIP_M = 0.010
"""Dip of a regulated key at its front, m (thesis Section 2.3)."""


@dataclass(frozen=True)
class Free:
    """A free parameter."""

    name: str
    meaning: str  # for the report
    paths: tuple[str, ...]  # parameters of the action it changes; empty for one of a sensor
    # standard deviation of the prior: m for a screw (``adds``), 1 for the logarithm of a factor or a sensor's shape
    width: float
    adds: bool = False  # it is added, not a factor


CURVE_AT = (0.04, 0.1, 0.2, 0.4, 0.7)
"""Shares of the hammer's ruler at which its sensor may show more or less than is there (rulers)."""
SENSORS = (
    Free("key_scale", "key: turn per displacement of the calibrated point (key ratio)", (), 0.13),
    Free("key_zero", "key: place of the rest", (), 3e-4, adds=True),
    Free("key_shape", "key: bow of the calibration curve", (), 0.2, adds=True),
    Free("hammer_scale", "hammer: displacement of the calibrated point per turn (hammer lever)", (), 0.15),
    Free("hammer_zero", "hammer: place of the rest", (), 5e-5, adds=True),
    *(
        Free(
            f"hammer_curve_{100 * at:02.0f}", f"hammer: shown too high at {100 * at:.0f} % of its ruler", (), 0.05, True
        )
        for at in CURVE_AT
    ),
)
ACTION = (
    Free("let_off", "regulation: button", ("contact08.second.y",), 2e-3, adds=True),
    Free("drop", "regulation: drop screw", ("contact11.first.y",), 2e-3, adds=True),
    Free("check", "regulation: back-check wire", ("contact04.second.x",), 4e-3, adds=True),
    Free("jack_pad", "regulation: jack rest pad", ("contact05.second.x",), 5e-4, adds=True),
    Free("repetition_pad", "regulation: repetition rest pad", ("contact06.second.y",), 1e-3, adds=True),
    Free("capstan", "regulation: capstan", ("contact01.first.y",), 5e-4, adds=True),
    Free("string", "regulation: height of the stop", ("contact12.second.y",), 3e-3, adds=True),
    Free("stop_felt", "stiffness of the stop", tuple(f"contact12.normal.{x}" for x in "abc"), 1.0),
    Free("stop_damping", "damping of the stop", ("contact12.normal.D",), 1.0),
    Free(
        "key_felt",
        "stiffness between key and whippen (felt on the capstan)",
        tuple(f"contact01.normal.{x}" for x in "abc"),
        1.0,
    ),
    Free("spring", "repetition spring: stiffness", ("repetition_spring.stiffness",), 0.5),
    Free("spring_torque", "repetition spring: torque, N m", ("repetition_spring.torque",), 0.015, adds=True),
    Free("hammer_mass", "hammer: mass and inertia", ("hammer.mass", "hammer.inertia"), 0.2),
    Free("hammer_friction", "friction of the hammer's joint", ("hammer.joint_friction.A",), 0.7),
    Free("lever_friction", "friction of the repetition lever's joint", ("repetition.joint_friction.A",), 0.7),
    Free("knuckle_friction", "friction under the knuckle", ("contact07.friction.A", "contact10.friction.A"), 0.5),
    Free("check_friction", "friction in the back check", ("contact04.friction.A",), 0.5),
    Free("rest_damping", "damping of the hammer's rest", ("contact13.normal.D",), 0.7),
    Free("knuckle_damping", "damping of the knuckle", ("contact07.normal.D", "contact10.normal.D"), 0.7),
)
FREE = (*SENSORS, *ACTION)
NAMES = tuple(one.name for one in FREE)
AFTER_THE_TURN = np.array(
    [name.startswith("hammer_") and one in SENSORS for name, one in zip(NAMES, FREE, strict=True)]
)
"""Parameters that change what is shown of a turn, not the turn."""
TURNS = 32
"""So many turns of the hammer are kept: slopes by the parameters above cost nothing."""


@dataclass(frozen=True)
class Sensing:
    """How the model's angles are tied to the sensors."""

    # key_rad_per_m, key_zero_m, key_shape: the key turns by ``key_rad_per_m`` per metre of its calibrated point, from
    # ``key_zero_m`` on, the displacement u (in rulers) bowed to u + shape u (1 − u)
    key_rad_per_m: float
    key_zero_m: float
    key_shape: float
    # hammer_m_per_rad, hammer_zero_m: likewise the other way round
    hammer_m_per_rad: float
    hammer_zero_m: float
    # what the hammer's sensor shows too much at the shares `CURVE_AT` of its ruler, in rulers
    hammer_curve: tuple[float, ...]


def values_of(z: Array) -> dict[str, float]:
    """Parameters by name: shifts (m, or the unit of the parameter) and factors."""
    return {
        one.name: float(one.width * x if one.adds else np.exp(one.width * x)) for one, x in zip(FREE, z, strict=True)
    }


def action_of(action: model.Action, z: Array) -> model.Action:
    """The action with the parameters of ``z``.

    Raises
    ------
    model.InputError
        A value leaves its allowed range.
    """
    values = values_of(z)
    changed = {}
    for one in ACTION:
        for path in one.paths:
            changed[path] = action[path] + values[one.name] if one.adds else action[path] * values[one.name]
    return action.with_values(changed, "identified")


@dataclass(frozen=True)
class Nominal:
    """What of an action ties angles to sensors: key at rest (rad), its turn in a whole dip, the hammer's to the
    string."""

    key_rest_rad: float
    dip_rad: float
    string_rad: float

    @classmethod
    def of(cls, action: model.Action) -> Nominal:
        """Of an action as it is."""
        rest = model.rest_state(action).angle_rad
        turn = np.linspace(0.0, 1.0, 4001)
        hammer = float(rest[model.BODIES.index("hammer")])
        height = model.observables.hammer_height_from_angle(action, hammer - turn)
        return cls(
            float(rest[model.BODIES.index("key")]),
            DIP_M / action["drive.point.x"],
            float(turn[int(np.argmax(height <= 0.0))]),
        )


def sensing_of(nominal: Nominal, z: Array, key_travel_m: float, hammer_travel_m: float) -> Sensing:
    """How angles and sensors are tied by ``z``: nominally the key's ruler is the dip, the hammer's the way to the
    string."""
    values = dict(zip(NAMES, z, strict=False))
    away = {one.name: one.width * float(values[one.name]) for one in SENSORS}
    return Sensing(
        nominal.dip_rad / key_travel_m * float(np.exp(away["key_scale"])),
        away["key_zero"],
        away["key_shape"],
        hammer_travel_m / nominal.string_rad * float(np.exp(away["hammer_scale"])),
        away["hammer_zero"],
        tuple(away[one.name] for one in SENSORS if one.name.startswith("hammer_curve")),
    )


TOLERANCE_RAD = 2e-4
"""Requested largest error of an angle. After a release errors grow: at 1e-3 a bounce came out 0.13 rad off."""
SPEED_OVER_S = 5e-3
"""Interval over which the key's speed is judged: noise between two samples is not its speed."""
STEP_M = 3e-4
"""Displacement of the key between the knots of its motion at its fastest; at least two samples apart."""
ORDER = 6


def bowed(u: Array, shape: float) -> Array:
    """``u`` with a bow that leaves 0 and 1 where they are."""
    return np.asarray(u + shape * u * (1.0 - u))


def key_turn(stroke: Stroke, sensing: Sensing, displacement_m: Array | None = None) -> Array:
    """Turn of the key from rest, rad, positive as it is pressed, by the measured displacement or another one."""
    value = stroke.key.value_m if displacement_m is None else displacement_m
    travel = stroke.key.travel_m
    return sensing.key_rad_per_m * (travel * bowed(value / travel, sensing.key_shape) - sensing.key_zero_m)


def key_motion(stroke: Stroke, turn_rad: Array, rest_rad: float) -> model.KeyMotion:
    """The key's motion as a cubic spline through averages as far apart as the stroke is slow."""
    reach = max(round(SPEED_OVER_S / stroke.interval_s), 1)
    fastest = float(np.abs(stroke.key.value_m[reach:] - stroke.key.value_m[:-reach]).max()) / (
        reach * stroke.interval_s
    )
    step = int(np.clip(STEP_M / max(fastest, 1e-9) / stroke.interval_s, 2, 0.005 / stroke.interval_s))
    at = np.arange(0, turn_rad.size, step)
    at[-1] = turn_rad.size - 1
    mean = gaussian_filter1d(turn_rad, 0.4 * step, mode="nearest")
    spline = CubicSpline(stroke.time_s[at], rest_rad - mean[at], bc_type="clamped")
    rows = np.zeros((at.size - 1, ORDER))
    rows[:, 2:] = spline.c.T
    return model.KeyMotion(spline.x, rows)


def hammer_place(turn_rad: Array, sensing: Sensing, travel_m: float) -> Array:
    """What a sensor of the hammer would show of its turn from rest, m, if its ruler had no ends.

    Between the shares `CURVE_AT` a monotone cubic; beyond the ruler what is there.
    """
    u = turn_rad * sensing.hammer_m_per_rad / travel_m
    more = PchipInterpolator((0.0, *CURVE_AT, 1.0), (0.0, *sensing.hammer_curve, 0.0))(np.clip(u, 0.0, 1.0))
    return np.asarray(travel_m * (u + more) + sensing.hammer_zero_m)


def hammer_reading(turn_rad: Array, sensing: Sensing, travel_m: float) -> Array:
    """What the hammer's sensor shows of its turn from rest, m, held at the ruler's ends."""
    return np.clip(hammer_place(turn_rad, sensing, travel_m), 0.0, travel_m)


def hammer_turn(action: model.Action, stroke: Stroke, key_turn_rad: Array, key_rest_rad: float) -> Array:
    """Predict the turn of the hammer.

    Parameters
    ----------
    action : the action that moves
    key_turn_rad : (n,), turn of the key from where its sensor reads zero
    key_rest_rad : angle of the key there

    Returns
    -------
    ndarray
        Turn from rest (n,), rad.

    Raises
    ------
    model.ModelError
        The action cannot follow.
    """
    motion = key_motion(stroke, key_turn_rad, key_rest_rad)
    run = run_prescribed(action, motion, stroke.time_s, tolerance=TOLERANCE_RAD)
    return np.asarray(run.angle_rad[0, HAMMER] - run.angle_rad[:, HAMMER])


STEP_S = 2.5e-4


@dataclass(frozen=True)
class NullAction:
    """What the null model knows of an action."""

    reduced: model.null_model.Reduced
    weight_nm_at: tuple[float, float]
    damping: float
    reach_m: float

    @classmethod
    def of(cls, action: model.Action) -> NullAction:
        """Reduce an action."""
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


def predict_null(null: NullAction, stroke: Stroke, sensing: Sensing, displacement_m: Array | None = None) -> Array:
    """Predict the displacement of the hammer's calibrated point by the null model.

    The rules are those of `model.null_model` with the key's motion given instead of the force: the hammer rides with
    the joined path up to let-off or until it would have to be pulled, flies under gravity alone, rebounds from the
    string by the restitution of its felt, is caught where the back check or the repetition lever meets it, and rides
    again once the jack is back under it. Nothing in it is fitted to the action; sensors are tied to it as to the full
    model.

    Parameters
    ----------
    stroke : its key's displacement goes in
    displacement_m : ndarray, shape (n,), optional, another displacement of the key

    Returns
    -------
    ndarray
        Displacement (n,), m.
    """
    motion = key_motion(stroke, key_turn(stroke, sensing, displacement_m), 0.0)
    time_s = np.arange(stroke.time_s[0], stroke.time_s[-1], STEP_S)
    state = motion.at(np.minimum(time_s, motion.break_s[-1]))
    phi = _march(null, -state[:, 0], -state[:, 1])
    return hammer_reading(np.interp(stroke.time_s, time_s, phi), sensing, stroke.hammer.travel_m)


def _march(null: NullAction, s: Array, w: Array) -> Array:
    """Turn of the hammer above its rest (m,) for places and speeds of the key (m,), even in time."""
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


T = TypeVar("T")
Predict = Callable[[Array, Stroke, Array | None], Array]
"""Displacement of the hammer (n,), m, for parameters (p,) and a stroke, the key's displacement given or measured."""


@dataclass(frozen=True)
class Mixture:
    """Sets of parameters that explain the same strokes: each (p,), in standard deviations of the priors, the best
    first, and their weights, which sum to one."""

    z: list[list[float]]
    weight: list[float]

    @classmethod
    def of_one(cls, z: Array) -> Mixture:
        """A single set."""
        return cls([z.tolist()], [1.0])

    def predict(self, predict: Predict, stroke: Stroke) -> Array:
        """Mean of the sets' predictions (n,), m; a set that cannot follow the key says nothing.

        Raises
        ------
        model.ModelError
            None can follow.
        """
        total, weights, failed = np.zeros(stroke.time_s.size), 0.0, None
        for z, weight in zip(self.z, self.weight, strict=True):
            try:
                total += weight * predict(np.array(z), stroke, None)
                weights += weight
            except model.ModelError as error:
                failed = error
        if failed is not None and not weights:
            raise failed
        return total / weights


def of_model(action: model.Action) -> Predict:
    """The full model under test as a prediction of all free parameters."""

    nominal = _known(action, Nominal.of)

    @lru_cache(maxsize=TURNS)
    def turn(key: bytes, stroke: Stroke) -> Array:
        z = np.frombuffer(key)
        return hammer_turn(
            action_of(action, z), stroke, key_turn(stroke, _sensing(nominal, z, stroke)), nominal.key_rest_rad
        )

    def predict(z: Array, stroke: Stroke, displacement_m: Array | None) -> Array:
        sensing, travel = _sensing(nominal, z, stroke), stroke.hammer.travel_m
        if displacement_m is None:
            moved = turn(np.where(AFTER_THE_TURN, 0.0, z).tobytes(), stroke)
        else:
            given = key_turn(stroke, sensing, displacement_m)
            moved = hammer_turn(action_of(action, z), stroke, given, nominal.key_rest_rad)
        return hammer_reading(moved, sensing, travel)

    return predict


def of_null(action: model.Action) -> Predict:
    """The null model as a prediction of the sensors' parameters alone."""
    nominal, null = _known(action, Nominal.of), _known(action, NullAction.of)

    def predict(z: Array, stroke: Stroke, displacement_m: Array | None) -> Array:
        return predict_null(null, stroke, _sensing(nominal, z, stroke), displacement_m)

    return predict


def _known(action: model.Action, of: Callable[[model.Action], T]) -> T:
    """What is known of an action before any stroke; one line where it does not even rest."""
    try:
        return of(action)
    except model.ModelError as error:
        raise ValidationInputError(f"{action.name}: the model cannot run ({error}); use another action") from None


def _sensing(nominal: Nominal, z: Array, stroke: Stroke) -> Sensing:
    return sensing_of(nominal, z, stroke.key.travel_m, stroke.hammer.travel_m)
