"""A prescribed motion: angle of the key over time as a piecewise polynomial of degree five.

Input of a motion-driven scene (``build_scene(key_motion=...)``); `model.motion_driven.spline_fit` makes one of measured
angles. Its second derivative is the key's acceleration, so the pieces must join twice continuously; this is checked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.elements.prescribed import ORDER
from model.errors import InputError

Array = NDArray[np.float64]

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

    def raised(self, angle_rad: float) -> KeyMotion:
        """The same motion from another angle on, so many rad higher."""
        rows = self.coefficient.copy()
        rows[:, -1] += angle_rad
        return KeyMotion(self.break_s, rows)

    def packed(self) -> list[float]:
        """The block of the parameter vector that kernels read; see `model.elements.prescribed`."""
        return [float(len(self.break_s) - 1), *self.break_s.tolist(), *self.coefficient.ravel().tolist()]

    def at(self, time_s: ArrayLike) -> Array:
        """Angle (rad), speed and acceleration at times (k,) within the breaks; (k, 3)."""
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
