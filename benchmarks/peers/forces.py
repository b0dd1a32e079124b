"""Force tables of the benchmark: ``model.files.force_library`` and a noisy one; time (s), key force (N)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.files import force_library as forces

RATE_HZ, DURATION_S = forces.RATE_HZ, forces.DURATION_S
NOISE_N = 0.05
BLOWS = ("forte", "piano", "double", "fortissimo", "noisy")


def force_table(blow: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (k,) and forces (k,) of one blow; ``noisy`` is the forte as read by a load cell with 0.05 N noise."""
    time, force = forces.force_table("forte" if blow == "noisy" else blow)
    if blow == "noisy":
        noise = np.random.default_rng(4).normal(0.0, NOISE_N, len(time))
        at, newton = forces.KNOTS["forte"]
        force = np.round(np.interp(time, np.array(at, dtype=float), np.array(newton, dtype=float)) + noise, 4)
    return time, force
