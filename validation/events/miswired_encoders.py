"""Encoders that turn the wrong way round, or stand in each other's place, found by their prediction.

Every permutation and sign of the channels is compared with the prediction; the best one is reported when it leaves a
quarter of the error of the wiring as declared and fits, within 30 % of the motion, where the bodies move and where they
stand. Channels that change places are judged together: a swap is one fault.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from validation.conventions import ENCODER_CHANNELS, Array, rms
from validation.measurement.trial import MeasuredTrial
from validation.prediction.predict_session import PredictedAngles

BETTER_WIRED = 0.25  # of the error, that the other wiring must leave at most: choice
MISSED = 0.3  # of the motion: choice; below this error the wiring, and the force, is right
STILL = 0.02  # of a body's largest step: below, it stands


@dataclass(frozen=True)
class Rewired:
    """A place whose prediction another column fits: errors as shares of the predicted motion, declared and rewired."""

    place: int
    source: int
    reversed: bool
    error: float
    error_rewired: float


def find_best_wiring(measured: Array, expected: Array) -> list[Rewired]:
    """Columns of ``measured`` (n, k) to be swapped or reversed so that they match ``expected`` (n, k), same unit,
    sorted by column; empty where the wiring as declared is right, no other one is clearly better, or nothing should
    move."""
    known = np.isfinite(expected).all(axis=1) & np.isfinite(measured).all(axis=1)
    k = expected.shape[1]
    if not known.any():
        return []
    size = np.sqrt(np.mean(expected[known] ** 2, axis=0))
    if not np.all(size > 0):
        return []
    error = np.empty((2, k, k))  # sign, column as measured, place as predicted
    for s, (i, j) in product(range(2), product(range(k), range(k))):
        difference = (1 - 2 * s) * measured[known, i] - expected[known, j]
        error[s, i, j] = np.sqrt(np.mean(difference**2)) / size[j]
    sign = error.argmin(axis=0)
    best = error.min(axis=0)
    order = min(permutations(range(k)), key=lambda o: sum(best[o[j], j] ** 2 for j in range(k)))
    found = []
    apart = _is_moving(expected[known])
    for cycle in _find_cycles(order):
        declared = [float(error[0, j, j]) for j in cycle]
        rewired = [float(best[order[j], j]) for j in cycle]
        changed = len(cycle) > 1 or bool(sign[order[cycle[0]], cycle[0]])
        if not changed or rms(declared) < MISSED or rms(rewired) > BETTER_WIRED * rms(declared):
            continue
        turned = [(order[j], j, 1.0 - 2.0 * sign[order[j], j]) for j in cycle]
        if any(rms((turn * measured[known, i] - expected[known, j])[part]) > MISSED * size[j]
               for i, j, turn in turned for part in (apart, ~apart) if part.any()):  # fmt: skip
            continue
        for j, before, after in zip(cycle, declared, rewired, strict=True):
            found.append(Rewired(j, order[j], bool(sign[order[j], j]), before, after))
    return sorted(found, key=lambda r: r.place)


def find_miswired_channels(m: MeasuredTrial, predicted: PredictedAngles) -> list[Rewired]:
    """Wrongly wired encoders of a trial, sorted by their index in `ENCODER_CHANNELS`."""
    return find_best_wiring(m.change_rad, np.column_stack([predicted.change_rad(name) for name in ENCODER_CHANNELS]))


def _is_moving(expected: Array) -> NDArray[np.bool_]:
    """Samples at which a body is predicted to move by more than `STILL` of its largest step."""
    steps = np.abs(np.gradient(expected, axis=0))
    return np.asarray((steps > STILL * np.maximum(steps.max(axis=0), 1e-300)).any(axis=1))


def _find_cycles(order: tuple[int, ...]) -> list[list[int]]:
    """Cycles of a permutation, each as a list of its indices; a fixed point is a cycle of one."""
    left, out = set(range(len(order))), []
    while left:
        at = min(left)
        cycle = []
        while at in left:
            left.remove(at)
            cycle.append(at)
            at = order[at]
        out.append(cycle)
    return out
