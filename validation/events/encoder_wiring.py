"""Encoders that turn the wrong way round, or stand in each other's place, found by their prediction.

Every permutation and sign of the three encoders is compared with the prediction; the best one is reported when it
leaves a quarter of the error of the wiring as declared.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from validation.conventions import ENCODER_CHANNELS
from validation.measurement.trial import MeasuredTrial
from validation.prediction.trial_prediction import PredictedAngles

BETTER_WIRED = 0.25  # the other wiring must leave a quarter of the error
WRONG_WIRED = 0.3  # of the predicted motion: below this error the wiring is right


@dataclass(frozen=True)
class Miswiring:
    """A channel that moves as another one should; errors as shares of the predicted motion, as declared and rewired."""

    channel: str
    recorded_as: str
    reversed: bool
    error: float
    error_rewired: float


def miswired_channels(m: MeasuredTrial, predicted: PredictedAngles) -> list[Miswiring]:
    """Channels of a trial that are wired wrong; none where nothing can be predicted to move."""
    expected = np.column_stack([predicted.change_rad(name) for name in ENCODER_CHANNELS])
    known = np.isfinite(expected).all(axis=1) & np.isfinite(m.change_rad).all(axis=1)
    size = np.sqrt(np.mean(expected[known] ** 2, axis=0))
    if not np.all(size > 0):
        return []
    error = np.empty((2, 3, 3))  # sign, place as measured, body as predicted
    for s, (i, j) in product(range(2), product(range(3), range(3))):
        difference = (1 - 2 * s) * m.change_rad[known, i] - expected[known, j]
        error[s, i, j] = np.sqrt(np.mean(difference**2)) / size[j]
    sign = error.argmin(axis=0)
    best = error.min(axis=0)
    order = min(permutations(range(3)), key=lambda o: sum(best[o[j], j] ** 2 for j in range(3)))
    found = []
    for j, name in enumerate(ENCODER_CHANNELS):
        i = order[j]
        as_declared, rewired = float(error[0, j, j]), float(best[i, j])
        is_reversed = bool(sign[i, j])
        if (i != j or is_reversed) and as_declared >= WRONG_WIRED and rewired <= BETTER_WIRED * as_declared:
            found.append(Miswiring(name, ENCODER_CHANNELS[i], is_reversed, as_declared, rewired))
    return found
