"""The handful of parameters that are identified from positions: sensors, regulation, a few properties of the action.

Each has a nominal value (that of the action, or of a sensor as its ruler says) and a wide prior. A vector ``z`` counts
standard deviations of the priors, zero is nominal. Screws add to a place, m; everything else is a factor exp(.).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import model
from validation.conventions import Array

DIP_M = 0.010
"""Dip of a regulated key at its front, m (thesis Section 2.3)."""


@dataclass(frozen=True)
class Free:
    """A free parameter.

    Attributes
    ----------
    name : str
    meaning : str
        For the report.
    paths : tuple of str
        Parameters of the action it changes; empty for one of a sensor.
    width : float
        Standard deviation of the prior: m for a screw (``adds``), 1 for the logarithm of a factor or a sensor's shape.
    adds : bool
        It is added, not a factor.
    """

    name: str
    meaning: str
    paths: tuple[str, ...]
    width: float
    adds: bool = False


SENSORS = (
    Free("key_scale", "key: turn per displacement of the calibrated point (key ratio)", (), 0.13),
    Free("key_zero", "key: place of the rest", (), 3e-4, adds=True),
    Free("key_shape", "key: bow of the calibration curve", (), 0.2, adds=True),
    Free("hammer_scale", "hammer: displacement of the calibrated point per turn (hammer lever)", (), 0.15),
    Free("hammer_zero", "hammer: place of the rest", (), 5e-5, adds=True),
    Free("hammer_shape", "hammer: bow of the calibration curve", (), 0.1, adds=True),
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


@dataclass(frozen=True)
class Sensing:
    """How the model's angles are tied to the sensors.

    Attributes
    ----------
    key_rad_per_m, key_zero_m, key_shape : float
        The key turns by ``key_rad_per_m`` per metre of its calibrated point, from ``key_zero_m`` on, the displacement u
        (in rulers) bowed to u + shape u (1 − u).
    hammer_m_per_rad, hammer_zero_m, hammer_shape : float
        Likewise the other way round.
    """

    key_rad_per_m: float
    key_zero_m: float
    key_shape: float
    hammer_m_per_rad: float
    hammer_zero_m: float
    hammer_shape: float


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
        away["hammer_shape"],
    )
