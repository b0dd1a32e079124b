"""Position sensors of key and hammer: what they read of a motion, and the errors of their calibration.

A reading is an observable of the state, the turn of a body since rest times a lever arm, with the errors of a channel:
gain (the arm), offset (place of the rest), and departures of the ruler. Each error has a prior; a fit that has learnt
them writes them into its action file, table ``[identification.position_sensors]``.
Conventions: an error z counts standard uncertainties of its prior, 0 is what the ruler says; the arm of the key's ruler
is that of a dip of 10 mm, of the hammer's that of the way to the string, both of `REFERENCE`. Readings stand as turns,
rad, counter-clockwise: displacement over that arm; beyond the ruler's ends the end is held, in trial and prediction
alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d

import model
from validation.conventions import HAMMER, Array
from validation.errors import TrialError, ValidationInputError
from validation.measurement.geometry import ActionGeometry, geometry_of

TABLE = "position_sensors"
REFERENCE = "hirschkorn2004-regulated"
DIP_M = 0.010
"""Dip of a regulated key at its front, m (thesis Section 2.3)."""


@dataclass(frozen=True)
class SensorError:
    """One error of a position sensor, with the standard uncertainty of its prior."""

    name: str
    meaning: str
    u: float  # m for a zero, else relative, or in rulers


CURVE_AT = (0.04, 0.1, 0.2, 0.4, 0.7)
"""Shares of the hammer's ruler at which its sensor may show more or less than is there."""
RULER_U = 0.05  # of the ruler: choice
POSITION_ERRORS = (
    SensorError("key_scale", "key: turn per displacement of the calibrated point", 0.13),  # choice
    SensorError("key_zero", "key: place of the rest, m", 3e-4),  # choice: felt that gives
    SensorError("key_shape", "key: bow of the calibration curve, rulers", 0.2),  # choice: sensors are bent
    SensorError("hammer_scale", "hammer: displacement of the calibrated point per turn", 0.15),  # choice
    SensorError("hammer_zero", "hammer: place of the rest, m", 5e-5),  # choice
    *(
        SensorError(
            f"hammer_curve_{100 * at:02.0f}", f"hammer: shown too high at {100 * at:.0f} % of its ruler", RULER_U
        )
        for at in CURVE_AT
    ),
)
ERROR_NAMES = tuple(error.name for error in POSITION_ERRORS)
N_KEY = 3
"""The first errors are of the key, which drives the model; the others of what is compared."""
PRIOR_U = np.array([error.u for error in POSITION_ERRORS])


@dataclass(frozen=True)
class SensorCalibration:
    """Errors of the two sensors of a bench, as learnt or as the ruler says, with their standard uncertainty."""

    z: tuple[float, ...] = (0.0,) * len(POSITION_ERRORS)
    u: tuple[float, ...] = (1.0,) * len(POSITION_ERRORS)
    sensors: Mapping[str, str] | None = None  # places that they were learnt at; None where nothing was

    def table(self) -> dict[str, Any]:
        """Plain values for a table of an action file."""
        errors = zip(ERROR_NAMES, self.z, self.u, strict=True)
        return {
            "sensors": dict(self.sensors or {}),
            "errors": {name: [float(f"{z:.7g}"), float(f"{u:.7g}")] for name, z, u in errors},
        }


def calibration_of(action: model.Action) -> SensorCalibration:
    """Sensor errors identified with an action, from its file; without them zero errors of the prior's uncertainty,
    which is what the calibration curves say. Raises an input error where the file's table is damaged."""
    table = action.identification.get(TABLE)
    if table is None:
        return SensorCalibration()
    try:
        z, u = zip(*(map(float, table["errors"][name]) for name in ERROR_NAMES), strict=True)
        if not (np.all(np.isfinite(z)) and np.all(np.isfinite(u)) and min(u) >= 0.0):
            raise ValueError("an error or its uncertainty is not finite, or below 0")
        return SensorCalibration(z, u, {str(k): str(v) for k, v in table["sensors"].items()})
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValidationInputError(
            f"{action.origin}: [identification.{TABLE}] found damaged ({error}); write the file again with pianorig "
            "identify, or take the table out"
        ) from None


@lru_cache(maxsize=1)
def reference_geometry() -> ActionGeometry:
    action = model.load_action(REFERENCE)
    return geometry_of(action, model.rest_state(action).angle_rad)


@lru_cache(maxsize=1)
def reference_turns() -> tuple[float, float]:
    """Turn of the key in a dip of 10 mm and of the hammer to the string, rad, positive."""
    geometry = reference_geometry()
    to_string = abs(geometry.string_angle_rad - float(geometry.rest_angle_rad[HAMMER]))
    return DIP_M / float(model.load_action(REFERENCE)["drive.point.x"]), to_string


BEYOND = 1.01
"""The ruler's end in ways to the string: a hammer that is held there has passed the string, where an impact is told."""
SPEED_OVER_S = 5e-3
"""Interval over which the key's speed is judged: noise between two samples is not its speed."""
STEP_M = 3e-4
"""Displacement of the key between the knots of its motion at its fastest; at least two samples apart."""
LONGEST_KNOT_S = SPEED_OVER_S
ORDER = 6  # coefficients of a piece of `model.KeyMotion`


@dataclass(frozen=True, eq=False)
class PositionSensors:
    """Sensors of one trial: the key's displacement, and how turns and readings are tied."""

    time_s: Array  # (n,)
    key_m: Array  # (n,) displacement of the key's calibrated point from rest
    key_travel_m: float  # length of the ruler
    hammer_travel_m: float
    calibration: SensorCalibration
    sensors: Mapping[str, str]  # places of the sensors and of the calibrated points

    def check_sensors(self) -> None:
        for name, place in (self.calibration.sensors or {}).items():
            if self.sensors.get(name) != place:
                raise TrialError(
                    f"{name} is {self.sensors.get(name)!r}, the identified set holds for {place!r}; identify a set on "
                    "this session, or compare with another `action`"
                )

    def errors(self, away: Array | None = None) -> Array:
        """Errors (10,) in the units of `PRIOR_U`, ``away`` standard uncertainties from the calibration."""
        z = np.array(self.calibration.z)
        return PRIOR_U * (z if away is None else z + np.array(self.calibration.u) * away)

    def key_turn_rad(self, away: Array | None = None) -> Array:
        """Turn of the key since rest (n,), rad, positive as it is pressed."""
        scale, zero, bow = self.errors(away)[:N_KEY]
        share = self.key_m / self.key_travel_m
        bowed = self.key_travel_m * (share + bow * share * (1.0 - share))
        return np.asarray(reference_turns()[0] / self.key_travel_m * np.exp(scale) * (bowed - zero))

    def key_motion(self, rest_rad: float, away: Array | None = None) -> model.KeyMotion:
        """The key's absolute angle, rad, as a cubic spline through averages, closer together the faster the stroke;
        ``rest_rad``: its angle at rest, ``away`` (10,): shifts of the calibration errors, in standard uncertainties."""
        turn, interval = self.key_turn_rad(away), float(self.time_s[1] - self.time_s[0])
        reach = max(round(SPEED_OVER_S / interval), 1)
        fastest = float(np.abs(self.key_m[reach:] - self.key_m[:-reach]).max()) / (reach * interval)
        step = int(np.clip(STEP_M / max(fastest, 1e-9) / interval, 2, max(LONGEST_KNOT_S / interval, 2)))
        at = np.arange(0, turn.size, step)
        at[-1] = turn.size - 1
        # a width of 0.4 of the knots' distance averages the samples between them
        mean = gaussian_filter1d(turn, 0.4 * step, mode="nearest")
        spline = CubicSpline(self.time_s[at], rest_rad - mean[at], bc_type="clamped")
        rows = np.zeros((at.size - 1, ORDER))
        rows[:, 2:] = spline.c.T
        return model.KeyMotion(spline.x, rows)

    def read_hammer(self, change_rad: Array, away: Array | None = None) -> Array:
        """What the hammer's sensor reads of changes of its angle since rest (n,), rad."""
        _, _, _, scale, zero, *curve = self.errors(away)
        share = -change_rad * np.exp(scale) / reference_turns()[1]
        more = PchipInterpolator((0.0, *CURVE_AT, 1.0), (0.0, *curve, 0.0))(np.clip(share, 0.0, 1.0))
        return self.as_turn(self.hammer_travel_m * (share + more) + zero)

    def as_turn(self, hammer_m: Array) -> Array:
        """A reading (n,), m, held at the ruler's ends, as a change of angle since rest, rad."""
        return np.asarray(-np.clip(hammer_m / self.hammer_travel_m, 0.0, 1.0) * BEYOND * reference_turns()[1])
