"""One body of the specimen held at reference angles, as ``pianorig calibrate encoder`` asks its operator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import model
from rig.errors import RigInputError
from rig.simulated.bench.plant import ActionPlant
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, PlantBlock

HELD_S, MOVED_S = 1.2, 0.3  # at a reference angle, and on the way to the next: a careful hand


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
        self._edge = 0

    def advance(self, command_v: NDArray[np.float64]) -> PlantBlock:
        """Return the state at the next n edges, n being the number of volts, which have no effect: the body at a
        reference angle or on the way to the next, the others at rest, no force."""
        n = len(command_v)
        time_s = np.arange(self._edge, self._edge + n, dtype=np.float64) / self.sample_rate_hz
        self._edge += n
        seen = np.tile(self._rest, (n, 1))
        seen[:, self._body] += np.interp(time_s, self._time_s, self._angle)
        return PlantBlock(time_s=time_s, force_n=np.zeros(n), angle_rad=seen, motor_rad=np.zeros(n))

    def truth(self) -> NDArray[np.float64]:
        return self._angle[::2]


def make_pose_plant(bench: ActionPlant, text: str, where: str) -> PosePlant:
    """Plant that holds one encoded body at the angles from its rest, rad, that ``text`` lists as ``BODY:A,B,…``, each
    for 1.2 s, the others at rest; refuse another text, naming the address ``where``."""
    body, _, listed = text.partition(":")
    try:
        angles = [float(one) for one in listed.split(",")]
    except ValueError:
        angles = []
    if body not in ENCODED_BODIES or not angles or not np.isfinite(angles).all():
        raise RigInputError(f"{where}: pose = {text!r}, allowed as in key:0,0.01,0.02 with {', '.join(ENCODED_BODIES)}")
    rest = model.rest_state(bench.action).angle_rad
    encoded = np.array([rest[model.BODIES.index(name)] for name in ENCODED_BODIES])
    return PosePlant(encoded, body, angles, bench.sample_rate_hz)
