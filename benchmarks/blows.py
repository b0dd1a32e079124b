"""Force tables that the benchmarks of the model share: 5 kHz, 0.6 s, rounded to 1e-4 N. None is tuned to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Table = tuple[NDArray[np.float64], NDArray[np.float64]]


def blows() -> dict[str, Table]:
    """Times (s) and forces (N) by name."""
    t = np.round(np.arange(0, 3001) * 2e-4, 4)
    knots = {
        "forte": ([0, 0.05, 0.07, 0.09, 0.11, 0.1125, 0.115, 0.118, 0.3, 0.39, 1], [0, 0, 1.4, 4.9, 10, 27, 15, 10, 10, 0, 0]),
        "piano": ([0, 0.03, 0.16, 0.165, 0.17, 0.35, 0.45, 1], [0, 0, 1.5, 3.0, 1.5, 1.5, 0, 0]),
        "double": (
            [0, 0.05, 0.09, 0.1125, 0.118, 0.2, 0.215, 0.24, 0.26, 0.285, 0.3, 0.42, 0.45, 1],
            [0, 0, 4.9, 25, 9, 9, 0, 0, 6, 22, 9, 9, 0, 0],
        ),
        "fortissimo": ([0, 0.05, 0.06, 0.075, 0.08, 0.083, 0.09, 0.3, 0.35, 1], [0, 0, 8, 30, 60, 40, 20, 20, 0, 0]),
    }
    out = {name: (t, np.round(np.interp(t, *k), 4)) for name, k in knots.items()}
    noise = np.random.default_rng(4).normal(0.0, 0.05, len(t))
    out["noisy"] = (t, np.round(out["forte"][1] + noise, 4))
    return out
