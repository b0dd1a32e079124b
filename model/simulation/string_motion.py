"""Motion of a scene's string at the output times, the force on it, and its energy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.elements.strings import AWAKE, free_vibration
from model.kernels import layout as L
from model.scene.build import Scene

Array = NDArray[np.float64]


def count_modes(scene: Scene) -> dict[str, int | float]:
    """How many modes of a string are stepped, as a counter; nothing where the scene has the bar."""
    return {"string_modes": int(scene.vector[scene.tables.offset[7]])} if len(scene.tables.string) else {}


@dataclass(frozen=True)
class StringMotion:
    """A string's motion at the output times, computed when it is asked for."""

    scene: Scene  # with the string
    time_s: Array  # (m,)
    rows: Array  # (m, z) memories as the step loop left them

    @cached_property
    def _now(self) -> tuple[Array, Array]:
        at, (gain, _, _), _ = _numbers(self.scene)
        first, count = at + L.STRING_STATES, len(gain)
        now = propagate_free_string(self.scene, self.time_s, self.rows)
        return now[:, first : first + count], now[:, first + count : first + 2 * count]

    @property
    def mode_m(self) -> Array:
        """Displacement of each mode at the hammer, (m, k) m."""
        return self._now[0]

    @property
    def mode_m_per_s(self) -> Array:
        """Rate of each mode's displacement at the hammer, (m, k) m/s."""
        return self._now[1]

    @property
    def omega_rad_per_s(self) -> Array:
        """Angular frequencies of the modes without loss, (k,)."""
        return np.asarray(np.sqrt(_numbers(self.scene)[1][1]))

    @property
    def way_m(self) -> Array:
        """Displacement (m,), m, of the string at the hammer, without the compliance of modes left out."""
        return np.asarray(self.mode_m.sum(axis=1))


def _numbers(scene: Scene) -> tuple[int, Array, float]:
    """Index of the string's states, (3, k) gains, stiffnesses and dampings of modes, residual compliance (m/N)."""
    p = scene.vector[scene.tables.offset[7] :]
    count = round(float(p[0]))
    rows = p[L.STRING_HEAD :][: 3 * count].reshape(3, count)
    return len(scene.tables.memory) + 2 * len(scene.pins), rows, float(p[L.STRING_GIVE])


def straight_string_state(scene: Scene) -> Array:
    """States of the scene's string when it is straight and still; whether a hammer is near the first step finds out."""
    if not len(scene.tables.string):
        return np.empty(0)
    out = np.zeros(L.STRING_STATES + 2 * _numbers(scene)[1].shape[1])
    out[L.SINCE] = AWAKE
    return out


def propagate_free_string(scene: Scene, time_s: Array, rows: Array) -> Array:
    """Copy of rows (m, z) of internal variables in which modes that vibrate freely are advanced to ``time_s`` (m,), s;
    without a string, the rows themselves."""
    if not len(scene.tables.string):
        return rows
    at, (_, stiffness, damping), _ = _numbers(scene)
    first, count, out = at + L.STRING_STATES, len(stiffness), rows.copy()
    free = np.flatnonzero(rows[:, at + L.SINCE] >= 0.5 * AWAKE)
    t = (time_s[free] - rows[free, at + L.SINCE])[:, None]
    sigma = 0.5 * damping
    omega = np.sqrt(stiffness - sigma**2)
    y, u = rows[free, first : first + count], rows[free, first + count : first + 2 * count]
    turned = np.exp(-sigma * t), np.cos(omega * t), np.sin(omega * t) / omega
    way, rate = free_vibration(y, u, stiffness, sigma, turned)
    out[free, first : first + count], out[free, first + count : first + 2 * count] = way, rate
    return out


def string_motion(scene: Scene, time_s: Array, rows: Array) -> StringMotion | None:
    """Motion of the scene's string at output times; None where the scene has the bar."""
    if not len(scene.tables.string):
        return None
    return StringMotion(scene, time_s, rows)


def string_loss(scene: Scene, time_s: tuple[float, float], memory: tuple[Array, Array]) -> float:
    """Energy (J) that a string lost, free, between two states (z,); 0 for a scene with the bar."""
    if not len(scene.tables.string):
        return 0.0
    first, last = (_accumulated_loss(scene, t, row) for t, row in zip(time_s, memory, strict=True))
    return last - first


def _accumulated_loss(scene: Scene, time_s: float, memory: Array) -> float:
    """Energy (J) that the string has lost up to ``time_s`` from the released state in ``memory`` (z,)."""
    at, (gain, stiffness, _), _ = _numbers(scene)
    if not len(memory):
        return 0.0
    rows = np.stack([memory, propagate_free_string(scene, np.array([time_s]), memory[None])[0]])
    first, count = at + L.STRING_STATES, len(gain)
    y, u = rows[:, first : first + count], rows[:, first + count : first + 2 * count]
    then, now = np.sum((u**2 + stiffness * y**2) / (2.0 * gain), axis=1)
    return float(memory[at + L.RELEASED] + then - now)
