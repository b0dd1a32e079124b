"""One body of the specimen on its joint alone: held at reference angles one after the other, or swinging freely.

Held as in ``pianorig calibrate-encoder``; held up, let go, until friction holds it, as in ``calibrate-joint``: the law
of the joint is the specimen's, dry friction with its smoothed sign. With a pad, as in ``calibrate-contact``, a pair of
a contact's materials rubs on a drum about the axis, by eq. 2.10.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import model
from rig.errors import RigInputError
from rig.simulated.bench.plant import ActionPlant
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, PlantBlock

HELD_S, MOVED_S = 1.2, 0.3


class PosePlant:
    """One body at given angles from rest; implements `rig.simulated.bench.plant_protocol.Plant`."""

    def __init__(self, rest_rad: NDArray[np.float64], body: str, angles_rad: Sequence[float], rate_hz: float) -> None:
        self.sample_rate_hz = rate_hz
        self._rest, self._body = rest_rad, ENCODED_BODIES.index(body)
        begins = np.arange(len(angles_rad)) * (HELD_S + MOVED_S)
        self._time_s = np.column_stack((begins, begins + HELD_S)).ravel()
        self._angle = np.repeat(np.asarray(angles_rad, dtype=float), 2)
        self._edge = 0

    def start_trial(self, trial: int) -> None:
        """Begin at the first angle."""
        self._edge = 0

    def advance(self, command_v: NDArray[np.float64]) -> PlantBlock:
        """Hold, move on, hold; the motor has nothing to do with it."""
        n = len(command_v)
        time_s = np.arange(self._edge, self._edge + n, dtype=np.float64) / self.sample_rate_hz
        self._edge += n
        seen = np.tile(self._rest, (n, 1))
        seen[:, self._body] += np.interp(time_s, self._time_s, self._angle)
        return PlantBlock(time_s=time_s, force_n=np.zeros(n), angle_rad=seen, motor_rad=np.zeros(n))

    def truth(self) -> NDArray[np.float64]:
        """The angles, rad."""
        return self._angle[::2]


def pose_plant(bench: ActionPlant, text: str, where: str) -> PosePlant:
    """Return a body at the angles of ``key:0,0.01,0.02``.

    Raises
    ------
    RigInputError
        No such body, or no list of angles.
    """
    body, _, listed = text.partition(":")
    try:
        angles = [float(one) for one in listed.split(",")]
    except ValueError:
        angles = []
    if body not in ENCODED_BODIES or not angles:
        raise RigInputError(f"{where}: pose = {text!r}, allowed as in key:0,0.01,0.02 with {', '.join(ENCODED_BODIES)}")
    rest = model.rest_state(bench.action).angle_rad
    encoded = np.array([rest[model.BODIES.index(name)] for name in ENCODED_BODIES])
    return PosePlant(encoded, body, angles, bench.sample_rate_hz)


LET_GO_S = 0.6
LIFTED_RAD = 1.1
SLIP_RAD_PER_S = 1e-3


@dataclass(frozen=True)
class Pad:
    """A pad on a drum of ``radius_m`` about the axis, under ``load_n``; A, B1, B2 and v_t of its contact's friction."""

    load_n: float
    radius_m: float
    a: float
    b1: float
    b2: float
    v_t: float

    def torque(self, speed: float) -> float:
        """Friction torque against a speed, rad/s; N m, positive."""
        s = abs(speed) * self.radius_m / self.v_t
        return self.load_n * self.radius_m * self.a * (math.tanh(s) + self.b1 * s / (1.0 + self.b2 * s**4))


class SwingPlant:
    """One body on its joint; implements `rig.simulated.bench.plant_protocol.Plant`."""

    def __init__(self, action: model.Action, body: str, sample_rate_hz: float, pad: Pad | None = None) -> None:
        self.sample_rate_hz = sample_rate_hz
        self._pad = pad
        self._body = ENCODED_BODIES.index(body)
        arm = math.hypot(action[f"{body}.center_of_mass.x"], action[f"{body}.center_of_mass.y"])
        self.weight_nm = action[f"{body}.mass"] * action["gravity.g"] * arm
        self.friction_nm = action[f"{body}.joint_friction.A"]
        self._inertia = action[f"{body}.inertia"] + action[f"{body}.mass"] * arm**2
        self.start_trial(1)

    def start_trial(self, trial: int) -> None:
        """Hold the body up."""
        self._angle, self._speed, self._edge = LIFTED_RAD * (1.0 + 0.01 * (trial % 7)), 0.0, 0

    def advance(self, command_v: NDArray[np.float64]) -> PlantBlock:
        """Swing for n sample periods; the motor has nothing to do with it."""
        n, h = len(command_v), 1.0 / self.sample_rate_hz
        angles = np.empty(n)
        for k in range(n):
            angles[k] = self._angle
            if (self._edge + k) * h >= LET_GO_S:
                self._step(h)
        time_s: NDArray[np.float64] = np.arange(self._edge, self._edge + n, dtype=np.float64) * h
        self._edge += n
        seen = np.zeros((n, len(ENCODED_BODIES)))
        seen[:, self._body] = angles
        return PlantBlock(time_s=time_s, force_n=np.zeros(n), angle_rad=seen, motor_rad=np.zeros(n))

    def truth(self) -> tuple[float, float]:
        """Friction and weight times arm, N m."""
        return self.friction_nm, self.weight_nm

    def _step(self, h: float) -> None:
        """Half a step of weight, one of friction against the speed it leaves, half a step of weight."""
        before = self._speed - 0.5 * h * self.weight_nm / self._inertia * math.sin(self._angle)
        pad = self._pad
        holds = self.friction_nm + (0.0 if pad is None else pad.load_n * pad.radius_m * pad.a)
        most = h * holds / self._inertia
        torque = self.friction_nm * math.tanh(abs(before) / SLIP_RAD_PER_S)
        torque += 0.0 if pad is None else pad.torque(before)
        slowed = math.copysign(max(abs(before) - h * torque / self._inertia, 0.0), before)
        if abs(before) <= most and abs(self.weight_nm * math.sin(self._angle)) <= holds:
            self._speed = 0.0  # it sticks
            return
        self._angle += h * slowed
        self._speed = slowed - 0.5 * h * self.weight_nm / self._inertia * math.sin(self._angle)


def swing_plant(bench: ActionPlant, body: str, pad: str = "") -> SwingPlant:
    """Return a body of a bench's specimen on its joint; ``pad`` is ``contact:load_n:radius_m``, or nothing.

    Raises
    ------
    RigInputError
        No body with an encoder, or no such pad.
    """
    if body not in ENCODED_BODIES:
        raise RigInputError(f"swing {body}: not found; allowed {', '.join(ENCODED_BODIES)}")
    return SwingPlant(bench.action, body, bench.sample_rate_hz, _pad(bench.action, pad) if pad else None)


def _pad(action: model.Action, text: str) -> Pad:
    try:
        contact, load, radius = text.split(":")
        load_n, radius_m = float(load), float(radius)
        a, b1, b2 = (action[f"{contact}.friction.{k}"] for k in ("A", "B1", "B2"))
        if load_n <= 0 or radius_m <= 0:
            raise ValueError
    except (ValueError, KeyError, model.ModelError):
        raise RigInputError(f"pad {text}: allowed CONTACT:LOAD_N:RADIUS_M, as contact04:0.2:0.005") from None
    return Pad(load_n, radius_m, a, b1, b2, action["friction_threshold.v_t"])
