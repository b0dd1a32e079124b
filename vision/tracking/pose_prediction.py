"""Where a body will be in the next frame: constant acceleration, seen from its parent.

A child's placement is tracked in the axes of its parent, so that a jack that rides on a moving whippen is predicted
with the whippen's motion in the same frame. A `Placement` is (phi, x, y) of the centre in the picture, or in the
parent's axes.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

Placement = NDArray[np.float64]


def in_parent(child: Placement, parent: Placement) -> Placement:
    """Placement of a child in the axes of its parent."""
    cosine, sine = math.cos(parent[0]), math.sin(parent[0])
    # plain numbers: arrays of three cost more than the sums
    (turn, x, y), (turn0, x0, y0) = child.tolist(), parent.tolist()
    return np.array([turn - turn0, cosine * (x - x0) + sine * (y - y0), cosine * (y - y0) - sine * (x - x0)])


def from_parent(relative: Placement, parent: Placement) -> Placement:
    """Placement in the picture of a child given in the axes of its parent; undoes `in_parent`."""
    cosine, sine = math.cos(parent[0]), math.sin(parent[0])
    (turn, x, y), (turn0, x0, y0) = relative.tolist(), parent.tolist()
    return np.array([turn + turn0, x0 + cosine * x - sine * y, y0 + sine * x + cosine * y])


class PlacementHistory:
    """The last three placements of a body, for extrapolation; after a gap it starts anew."""

    def __init__(self) -> None:
        self._last: deque[tuple[int, Placement]] = deque(maxlen=3)

    def add(self, step: int, placement: Placement) -> None:
        """Record the placement found at a step (the running number of the tracked frame)."""
        if self._last and step != self._last[-1][0] + 1:
            self._last.clear()
        self._last.append((step, placement))

    def clear(self) -> None:
        """Forget everything."""
        self._last.clear()

    def items(self) -> list[tuple[int, Placement]]:
        """The placements, oldest first, with their steps."""
        return list(self._last)

    def newest(self) -> Placement | None:
        """The newest known placement."""
        return self._last[-1][1] if self._last else None

    def newest_step(self) -> int | None:
        """Step of the newest known placement."""
        return self._last[-1][0] if self._last else None

    def predict(self, step: int) -> Placement | None:
        """Placement at a step: constant acceleration from three neighbours, else the newest known one."""
        if not self._last:
            return None
        newest, place = self._last[-1]
        if step != newest + 1 or len(self._last) < 2:
            return place
        if len(self._last) == 2:
            return 2.0 * place - self._last[0][1]
        (a0, a1, a2), (b0, b1, b2), (c0, c1, c2) = (item[1].tolist() for item in self._last)
        return np.array([3.0 * c0 - 3.0 * b0 + a0, 3.0 * c1 - 3.0 * b1 + a1, 3.0 * c2 - 3.0 * b2 + a2])
