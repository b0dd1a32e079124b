"""Force tables of the benchmark: 5 kHz, 0.7 s, rounded to 1e-4 N; time (s), force on the key (N, positive down).

Made by formula, so that any machine gets the same numbers; forte, piano and noisy have the knots of
tests/model/data/make_reference.py on a longer table.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

RATE_HZ = 5000
DURATION_S = 0.7
NOISE_N = 0.05

KNOTS = {
    "forte": (
        [0, 0.05, 0.07, 0.09, 0.11, 0.1125, 0.115, 0.118, 0.3, 0.39],
        [0, 0, 1.4, 4.9, 10, 27, 15, 10, 10, 0],
    ),
    "piano": ([0, 0.03, 0.16, 0.165, 0.17, 0.35, 0.45], [0, 0, 1.5, 3.0, 1.5, 1.5, 0]),
    # two strikes: the key goes up within 0.02 s between them, else the hammer stays in check
    "double": (
        [0, 0.03, 0.08, 0.11, 0.15, 0.17, 0.25, 0.28, 0.31, 0.45, 0.5],
        [0, 0, 6, 12, 8, 0, 0, 8, 14, 8, 0],
    ),
    # a 60 N spike of 2.5 ms half width on a hard blow
    "fortissimo": (
        [0, 0.03, 0.05, 0.065, 0.0675, 0.07, 0.075, 0.25, 0.3],
        [0, 0, 8, 18, 60, 25, 15, 15, 0],
    ),
}
BLOWS = (*KNOTS, "noisy")


def force_table(blow: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (k,) and forces (k,) of one blow; ``noisy`` is the forte as a load cell of 0.05 N noise reads it."""
    k = np.arange(round(DURATION_S * RATE_HZ) + 1)
    time = np.round(k / RATE_HZ, 4)
    at, newton = KNOTS["forte" if blow == "noisy" else blow]
    force = np.interp(time, np.array(at, dtype=float), np.array(newton, dtype=float))
    if blow == "noisy":
        force = force + np.random.default_rng(4).normal(0.0, NOISE_N, len(time))
    return time, np.round(force, 4)
