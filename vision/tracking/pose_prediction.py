"""Where a body will be in the next frame: constant acceleration, seen from its parent.

A child's placement is tracked in the axes of its parent, so that a jack that rides on a moving whippen is predicted
with the whippen's motion in the same frame. A `Placement` is (phi, x, y) of the centre in the picture, or in the
parent's axes.
"""

from __future__ import annotations

import math

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
    """The last three placements of a body, for extrapolation; after a gap it starts anew.

    They are kept in arrays (``known`` (1,), their steps (3,) and themselves (3, 3), oldest first), which may be parts
    of larger ones, where compiled code finds them.
    """

    def __init__(
        self,
        known: NDArray[np.int64] | None = None,
        steps: NDArray[np.int64] | None = None,
        places: NDArray[np.float64] | None = None,
    ) -> None:
        self._known = np.zeros(1, dtype=np.int64) if known is None else known
        self._steps = np.zeros(3, dtype=np.int64) if steps is None else steps
        self._places = np.zeros((3, 3)) if places is None else places

    def add(self, step: int, placement: Placement) -> None:
        """Record the placement found at a step (the running number of the tracked frame)."""
        known = int(self._known[0])
        if known and step != self._steps[known - 1] + 1:
            known = 0
        if known == 3:
            self._steps[:2], self._places[:2] = self._steps[1:].copy(), self._places[1:].copy()
            known = 2
        self._steps[known], self._places[known] = step, placement
        self._known[0] = known + 1

    def clear(self) -> None:
        """Forget everything."""
        self._known[0] = 0

    def items(self) -> list[tuple[int, Placement]]:
        """The placements, oldest first, with their steps."""
        return [(int(self._steps[k]), self._places[k].copy()) for k in range(int(self._known[0]))]

    def newest(self) -> Placement | None:
        """The newest known placement."""
        known = int(self._known[0])
        return self._places[known - 1].copy() if known else None

    def newest_step(self) -> int | None:
        """Step of the newest known placement."""
        known = int(self._known[0])
        return int(self._steps[known - 1]) if known else None

    def predict(self, step: int) -> Placement | None:
        """Placement at a step: constant acceleration from three neighbours, else the newest known one."""
        known = int(self._known[0])
        if not known:
            return None
        if step != self._steps[known - 1] + 1 or known < 2:
            return self._places[known - 1].copy()
        if known == 2:
            return np.asarray(2.0 * self._places[1] - self._places[0])
        (a0, a1, a2), (b0, b1, b2), (c0, c1, c2) = self._places.tolist()
        return np.array([3.0 * c0 - 3.0 * b0 + a0, 3.0 * c1 - 3.0 * b1 + a1, 3.0 * c2 - 3.0 * b2 + a2])
