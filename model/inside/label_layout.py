"""Places for the names in the moving side view: beside their points, on no other name and no other point.

In: points and lengths of the names, millimetres; out: the offset of each name from its point. Names are placed one
after the other, each at the nearest free place around its point; what has no free place takes the emptiest one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HEIGHT = 6.0  # of a name, mm in the drawing
WIDTH = 3.8  # of a letter
DISTANCES = (5.0, 9.0, 13.0, 18.0, 24.0)
DIRECTIONS = 16
POINT = 3.0  # kept free around every point


def places(points: Array, names: Sequence[str]) -> Array:
    """Offsets (c, 2) of the middle of each name from its point.

    Parameters
    ----------
    points : (c, 2) mm, y up
    names : what is written there

    Returns
    -------
    ndarray
        Offsets (c, 2), mm.
    """
    turns = np.linspace(0.25 * np.pi, 2.25 * np.pi, DIRECTIONS, endpoint=False)
    ways = np.column_stack([np.cos(turns), np.sin(turns)])
    taken: list[tuple[Array, Array]] = []
    out = np.zeros((len(names), 2))
    for k, name in enumerate(names):
        half = np.array([0.5 * WIDTH * len(name), 0.5 * HEIGHT])
        tries = [(way * (distance + half * np.abs(way))) for distance in DISTANCES for way in ways]
        covered = [_covered(points[k] + offset, half, points, taken) for offset in tries]
        out[k] = tries[int(np.argmin(covered))]  # the first, nearest one of equals
        taken.append((points[k] + out[k], half))
    return out


def _covered(middle: Array, half: Array, points: Array, taken: Sequence[tuple[Array, Array]]) -> float:
    """Area, mm², that a name at ``middle`` shares with names and points."""
    total = 0.0
    for other, size in (*taken, *((point, np.full(2, POINT)) for point in points)):
        overlap = half + size - np.abs(middle - other)
        if np.all(overlap > 0.0):
            total += float(np.prod(np.minimum(overlap, 2.0 * np.minimum(half, size))))
    return total
