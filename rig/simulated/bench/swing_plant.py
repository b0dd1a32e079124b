"""One body of the specimen on its joint: held up, let go, swinging until friction holds it.

As in ``pianorig calibrate joint``: the law of the joint is the specimen's, dry friction with its smoothed sign. With a
pad, as in ``calibrate contact``, a pair of a contact's materials rubs on a drum about the axis, by eq. 2.10.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import model
from rig.errors import RigInputError
from rig.simulated.bench.plant import ActionPlant
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, PlantBlock

LET_GO_S = 0.6  # after the lift
LIFTED_RAD = 1.1  # rad from rest: as far as a hand lifts a hammer
SLIP_RAD_PER_S = 1e-3  # over which the friction changes its sign: choice


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
        self._angle, self._speed, self._edge = LIFTED_RAD * (1.0 + 0.01 * (trial % 7)), 0.0, 0  # other heights

    def advance(self, command_v: NDArray[np.float64]) -> PlantBlock:
        """Return the state at the next n edges, n being the number of volts, which have no effect: the body is held up
        for 0.6 s of the trial, then swings until friction holds it; no force."""
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
        return self.friction_nm, self.weight_nm

    def _step(self, h: float) -> None:
        """Step angle, rad, and speed, rad/s, by ``h`` s: half of the weight's torque, all of the friction's against the
        speed so far, half of the weight's; a body that friction can hold stops."""
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


def make_swing_plant(bench: ActionPlant, body: str, pad: str = "") -> SwingPlant:
    """Return a body of a bench's specimen on its joint; ``pad`` is ``contact:load_n:radius_m``, or nothing."""
    if body not in ENCODED_BODIES:
        raise RigInputError(f"swing {body}: not found; allowed {', '.join(ENCODED_BODIES)}")
    if b1 := bench.action[f"{body}.joint_friction.B1"]:
        raise RigInputError(f"swing {body}: joint_friction.B1 = {b1:g}, allowed 0: it swings on dry friction")
    return SwingPlant(bench.action, body, bench.sample_rate_hz, _parse_pad(bench.action, pad) if pad else None)


def _parse_pad(action: model.Action, text: str) -> Pad:
    """Rubbing pad (load, N, radius, m, and the contact's friction) from text such as ``contact04:0.2:0.005``; refuse
    another form, an unknown contact, and a load or radius that is not above 0."""
    try:
        contact, load, radius = text.split(":")
        load_n, radius_m = float(load), float(radius)
        a, b1, b2 = (action[f"{contact}.friction.{k}"] for k in ("A", "B1", "B2"))
        if not (0 < load_n < math.inf and 0 < radius_m < math.inf):
            raise ValueError
    except (ValueError, KeyError, model.ModelError):
        raise RigInputError(f"pad {text}: allowed CONTACT:LOAD_N:RADIUS_M, as contact04:0.2:0.005") from None
    return Pad(load_n, radius_m, a, b1, b2, action["friction_threshold.v_t"])
