"""How the filmed bodies of the tests move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def smooth_step(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """0 to 1 while x goes from 0 to 1, with zero speed and acceleration at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x * x)


def bar_motion(n: int, pivot: tuple[float, float], turn_rad: float, still: int = 14) -> NDArray[np.float64]:
    """Poses (n, 1, 3) of a bar that rests, turns about its origin, and drifts to the right and down."""
    s = smooth_step((np.arange(n) - still) / (n - still - 6))
    return np.column_stack([turn_rad * s, pivot[0] + 6.0 * s, pivot[1] + 3.0 * s])[:, None, :]
