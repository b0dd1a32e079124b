"""Motion of the bodies in the film benchmarks: at rest, then as in a fast blow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

REST = np.array([0.0251, 0.3198, 0.3523])  # whippen, jack, repetition lever


def smooth_step(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Step from 0 to 1 as x goes from 0 to 1, with zero speed and acceleration at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x * x)


def blow(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles of a fast blow, rad, with peak speeds of 4, 25 and 14 rad/s."""
    down = 1.0 - smooth_step((time_s - 0.20) / 0.06)
    return REST + np.column_stack(
        [
            0.09 * smooth_step((time_s - 0.06) / 0.04) * down,
            -0.35 * smooth_step((time_s - 0.08) / 0.026) * down,
            0.22 * smooth_step((time_s - 0.07) / 0.03) * down,
        ]
    )
