"""The analog comparator of a card: it finds the sample at which an input crosses a level, or enters or leaves a window.

Hardware compares between the samples, the virtual device at them: a trigger comes up to one sample later.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class AnalogShape:
    """What is waited for: a crossing of ``level`` after ``armed_at``, or of the edges of a window.

    ``source`` names a channel of the task; an empty one is a terminal to which nothing is wired. Values are in the
    channel's units.
    """

    source: str
    rising: bool
    """Upwards, or into the window."""
    level: float
    armed_at: float
    """An upward crossing counts only after a value at or below this one: the level less the hysteresis."""
    window: tuple[float, float] | None = None
    """Bottom and top; ``level`` has no meaning then."""


@dataclass(eq=False)
class Comparator:
    """An analog shape and where the signal was: each value is shown to it once, in order."""

    shape: AnalogShape
    _armed: bool = False

    def crossings(self, value: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return how many crossings have come by each of the next values (n,), counted from the first of them."""
        shape, armed = self.shape, self._armed
        passed = np.zeros(value.size, dtype=np.int64)
        if not shape.source:
            return passed
        if shape.window is not None:
            bottom, top = shape.window
            beyond = ((value >= bottom) & (value <= top)) == shape.rising
            before = ~beyond
        elif shape.rising:
            beyond, before = value >= shape.level, value <= shape.armed_at
        else:
            beyond, before = value <= shape.level, value >= shape.armed_at
        count = 0
        for k in range(value.size):
            if armed and beyond[k]:
                count, armed = count + 1, False
            elif before[k]:
                armed = True
            passed[k] = count
        self._armed = armed
        return passed
