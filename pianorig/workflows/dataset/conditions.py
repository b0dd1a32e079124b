"""What is played in the data set: five levels from forte to piano, double, staccato, repetition, as motor commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RATE_HZ = 5000.0
WINDOW_S = 0.2
"""Rest before each stroke: the initialisation window."""
AFTER_S = 0.25

FORTE = ((0.0, 0.0), (0.01, 0.435), (0.02, 1.46), (0.03, 2.97), (0.04, 4.92), (0.05, 7.27), (0.06, 10.0))
"""Rise of a forte, s and N."""
PIANO = ((0.0, 0.0), (0.15, 1.25), (0.16, 1.25), (0.175, 0.72), (0.215, 0.72), (0.28, 1.5), (0.5, 1.5), (0.57, 0.0))


@dataclass(frozen=True)
class Condition:
    """A kind of stroke: its name and corner points of the nominal force, s and N."""

    name: str
    points: tuple[tuple[float, float], ...]

    def corners(self, strength: float = 1.0, stretch: float = 1.0) -> tuple[Array, Array]:
        """Corner points of the motor's profile, s and N, with rest before and after, stronger or slower by a factor."""
        times = WINDOW_S + stretch * np.array([t for t, _ in self.points])
        values = strength * np.array([f for _, f in self.points])
        return np.concatenate([[0.0], times, [times[-1] + AFTER_S]]), np.concatenate([[0.0], values, [0.0]])


def _strokes(level: float, onsets: tuple[float, ...], hold_s: float, fall_s: float) -> tuple[tuple[float, float], ...]:
    points: list[tuple[float, float]] = []
    for onset in onsets:
        points += [(onset + t, level / 10.0 * f) for t, f in FORTE]
        points += [(onset + 0.06 + hold_s, level), (onset + 0.06 + hold_s + fall_s, 0.0)]
    return tuple(points)


CONDITIONS = (
    Condition("forte", _strokes(10.0, (0.0,), 0.2, 0.09)),
    Condition("mezzoforte", _strokes(7.0, (0.0,), 0.2, 0.09)),
    Condition("mezzo", _strokes(5.0, (0.0,), 0.2, 0.09)),
    Condition("mezzopiano", _strokes(3.5, (0.0,), 0.2, 0.09)),
    Condition("piano", PIANO),
    Condition("double", _strokes(10.0, (0.0, 0.2), 0.05, 0.03)),
    Condition("staccato", _strokes(8.0, (0.0,), 0.01, 0.02)),
    Condition("repetition", _strokes(6.0, (0.0, 0.16, 0.32, 0.48), 0.03, 0.03)),
)
