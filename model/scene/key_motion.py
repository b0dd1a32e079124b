"""A prescribed motion: angle of key, motor arm or finger over time as a piecewise polynomial of degree five.

Input of a motion-driven scene (``build_scene(key_motion=...)``); `model.motion_driven.spline_fit` makes one of measured
angles. Its second derivative is the acceleration, so the pieces must join twice continuously; this is checked.
Of a key that lifts or whose joint gives the front is prescribed, where the force acts; the angle is then that of a key
on its pivot whose front is at that height. `append_prescribed_motion` gives its true one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.elements.prescribed import ORDER
from model.elements.structure import Structure
from model.errors import InputError
from model.kernels.layout import FORCE_DOWN, Tables

Array = NDArray[np.float64]

LARGEST_RISE = 0.5  # of the front above its pivot, of its distance from it: beyond, bounds on gaps fail
JUMP = 1e-6  # share of the largest value of a derivative by which it may jump at a break


@dataclass(frozen=True)
class KeyMotion(ArrayRecord):
    """Angle of the key over time.

    Attributes
    ----------
    break_s : (m + 1,) increasing times between the pieces
    coefficient : (m, 6) of each piece, highest power first, in the time since its start; rad/s^k
    """

    break_s: Array
    coefficient: Array

    def __post_init__(self) -> None:
        """Refuse pieces that do not join."""
        super().__post_init__()
        if self.break_s.ndim != 1 or self.coefficient.shape != (len(self.break_s) - 1, ORDER):
            raise InputError(
                f"key motion: found {self.break_s.shape} times and {self.coefficient.shape} coefficients, "
                f"allowed (m + 1,) and (m, {ORDER})"
            )
        if not (np.all(np.isfinite(self.break_s)) and np.all(np.isfinite(self.coefficient))):
            raise InputError("key motion: found a number that is not finite")
        width = np.diff(self.break_s)
        if np.any(width <= 0.0):
            raise InputError("key motion: found times that do not increase")
        pieces = self.coefficient
        for derivative, name in enumerate(("angle", "speed", "acceleration")):
            left = np.zeros(len(width))
            for k in range(pieces.shape[1]):
                left = left * width + pieces[:, k]
            jump = np.abs(left[:-1] - pieces[1:, -1])
            if len(jump) and np.max(jump) > JUMP * (1.0 + np.max(np.abs(pieces[:, -1]))):
                at = int(np.argmax(jump))
                raise InputError(
                    f"key motion: {name} jumps by {jump[at]:g} at {self.break_s[at + 1]:g} s; allowed pieces that join "
                    "with equal angle, speed and acceleration"
                )
            if derivative < 2:
                pieces = pieces[:, :-1] * np.arange(pieces.shape[1] - 1, 0, -1)

    def shift_angle(self, angle_rad: float) -> KeyMotion:
        """Copy of the motion with ``angle_rad`` added to every angle."""
        rows = self.coefficient.copy()
        rows[:, -1] += angle_rad
        return KeyMotion(self.break_s, rows)

    def pack_numbers(self, front: tuple[float, float] | None = None) -> list[float]:
        """Number of pieces, break times (s) and coefficients in a row, as kernels read them; `InputError` for a motion
        that takes ``front`` (x, y in the key's frame, m) too far from its pivot's height.

        Beyond that, bounds on gaps would not hold.
        """
        if front is not None:
            x, y = front
            angle, most = self.coefficient[:, -1], LARGEST_RISE * np.hypot(x, y)
            far = int(np.argmax(np.abs(np.sin(angle) * x + np.cos(angle) * y)))
            if not abs(np.sin(angle[far]) * x + np.cos(angle[far]) * y) <= most:
                raise InputError(
                    f"key motion: found {angle[far]:g} rad, allowed angles that keep the front within {most:.3g} m of "
                    "its pivot's height"
                )
        return [float(len(self.break_s) - 1), *self.break_s.tolist(), *self.coefficient.ravel().tolist()]

    def evaluate(self, time_s: ArrayLike) -> Array:
        """Angle (rad), speed (rad/s) and acceleration (rad/s^2), columns of (k, 3), at times (k,), s, within the
        breaks."""
        times = as_numbers(time_s, "times of a key motion", 1)
        k = np.clip(np.searchsorted(self.break_s, times, side="right") - 1, 0, len(self.coefficient) - 1)
        x, row, out = times - self.break_s[k], self.coefficient[k], []
        for _ in range(3):
            value = row[:, 0]
            for c in row.T[1:]:
                value = value * x + c
            out.append(value)
            row = row[:, :-1] * np.arange(row.shape[1] - 1, 0, -1)
        return np.stack(out, axis=1)

    raised, at = shift_angle, evaluate  # former names, for one release


def _rises(tables: Tables, states: tuple[Array, Array], memory: Array | None) -> tuple[Array, Array] | None:
    """Rise (m,), m, and its rate, m/s, of the pivot of a key whose front is prescribed; None in other scenes.

    At states of the bodies and of what joints give.
    """
    rise, bodies, count = next(iter(Structure(tables).led.values()), None), len(tables.parent), len(tables.pin)
    if rise is None:
        return None
    if rise < bodies:
        return states[0][:, rise], states[1][:, rise]
    at = len(tables.memory) + rise - bodies
    rows = np.zeros((len(states[0]), at + count + 1)) if memory is None else memory
    return rows[:, at], rows[:, at + count]


def angle_at_height(front: ArrayLike, height_m: ArrayLike) -> Array:
    """Angle (rad) of a key whose front, at ``front`` (2,) of its frame, is so far above its pivot."""
    (x, y), height = np.asarray(front, dtype=float), np.asarray(height_m, dtype=float)
    turned = np.arctan2(height, np.sign(x) * np.sqrt(x * x + y * y - height * height)) - np.arctan2(y, x)
    return np.asarray(np.mod(turned + np.pi, 2.0 * np.pi) - np.pi)


def append_prescribed_motion(
    tables: Tables, p: Array, others: tuple[Array, Array], prescribed: Array, memory: Array | None = None
) -> tuple[Array, Array]:
    """Angles and speeds (m, n) of all coordinates: ``others`` (m, n - 1) each, then the angle and speed that a motion
    prescribes, from ``prescribed`` (m, 2)."""
    angle, speed = prescribed[:, 0], prescribed[:, 1]
    risen = _rises(tables, others, memory)
    if risen is not None:
        front = x, y = p[tables.offset[2] : tables.offset[2] + 2]
        level = np.cos(angle) * x - np.sin(angle) * y
        angle = angle_at_height(front, np.sin(angle) * x + np.cos(angle) * y - risen[0])
        speed = (level * speed - risen[1]) / (np.cos(angle) * x - np.sin(angle) * y)
    return np.column_stack([others[0], angle]), np.column_stack([others[1], speed])


def acceleration_of_input(
    tables: Tables, p: Array, states: tuple[Array, Array], acceleration: Array, memory: Array | None = None
) -> Array:
    """Acceleration (m,) along the input's line of action, from the ``acceleration`` (m,) of a prescribed motion and the
    states (m, n).

    It is what `model.codegen.evaluate_observables.bodies_at` takes.
    """
    if tables.drive[0, 0] != FORCE_DOWN:
        return acceleration
    front = x, y = p[tables.offset[2] : tables.offset[2] + 2]
    angle, speed = states[0][:, -1], states[1][:, -1]
    height, rate = np.sin(angle) * x + np.cos(angle) * y, (np.cos(angle) * x - np.sin(angle) * y) * speed
    risen = _rises(tables, states, memory)
    if risen is not None:
        height, rate = height + risen[0], rate + risen[1]
        angle = angle_at_height(front, height)
    level = np.cos(angle) * x - np.sin(angle) * y
    return np.asarray(height * (rate / level) ** 2 - level * acceleration)
