"""A body of the specimen that swings freely about its joint: held up, let go, until friction holds it.

As in ``pianorig calibrate-joint``; the law of the joint is the specimen's, dry friction with its smoothed sign.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

import model
from rig.errors import RigInputError
from rig.simulated.bench.plant import ActionPlant
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, PlantBlock

LET_GO_S = 0.6
LIFTED_RAD = 1.1
SLIP_RAD_PER_S = 1e-3


class SwingPlant:
    """One body on its joint; implements `rig.simulated.bench.plant_protocol.Plant`."""

    def __init__(self, action: model.Action, body: str, sample_rate_hz: float) -> None:
        self.sample_rate_hz = sample_rate_hz
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
        most = h * self.friction_nm / self._inertia
        slowed = math.copysign(max(abs(before) - most * math.tanh(abs(before) / SLIP_RAD_PER_S), 0.0), before)
        if abs(before) <= most and abs(self.weight_nm * math.sin(self._angle)) <= self.friction_nm:
            self._speed = 0.0  # it sticks
            return
        self._angle += h * slowed
        self._speed = slowed - 0.5 * h * self.weight_nm / self._inertia * math.sin(self._angle)


def swing_plant(bench: ActionPlant, body: str) -> SwingPlant:
    """Return a body of a bench's specimen on its joint.

    Raises
    ------
    RigInputError
        No body with an encoder.
    """
    if body not in ENCODED_BODIES:
        raise RigInputError(f"swing {body}: not found; allowed {', '.join(ENCODED_BODIES)}")
    return SwingPlant(bench.action, body, bench.sample_rate_hz)
