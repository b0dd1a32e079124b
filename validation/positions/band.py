"""A 95 % band about a prediction, chosen and calibrated on training strokes left out of the fit, alike for every model.

A band's half width is q · u(t): u joins what the key's calibration leaves open (an ensemble), the hammer's own
calibration and a floor; q is a number for each phase of the key, or one for the whole stroke. Which of the `CANDIDATES`
is used is decided by training strokes alone (`calibrate`, docs/explanation/positions.md): the numbers
come from some, the interval score is taken on another. So q holds what the model lacks and what other strokes would
have made of its parameters, as far as left-out strokes show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

import numpy as np

import model
from validation.conventions import Array
from validation.positions.identify import Predict
from validation.positions.measured import NORMAL, Stroke
from validation.positions.phases import PHASES, phases

LEVEL = 0.95
DRAWS, SEED = 9, 19
WHOLE = "whole"
"""The number for the whole stroke, beside those of the phases."""


@dataclass(frozen=True)
class Candidate:
    """A way to calibrate: floor of u in rulers, numbers by phase or one, quantiles pooled or the largest of strokes."""

    floor: float
    by_phase: bool
    joined: Literal["pooled", "largest"]


FLOORS = (0.005, 0.01, 0.02, 0.04)
JOINED: tuple[Literal["pooled", "largest"], ...] = ("pooled", "largest")
CANDIDATES = tuple(Candidate(floor, phase, how) for floor, phase, how in product(FLOORS, (True, False), JOINED))


@dataclass(frozen=True)
class Calibration:
    """A calibrated band.

    Attributes
    ----------
    floor : float
        Least standard uncertainty of a prediction, in rulers.
    by_phase : bool
        There is a number for each phase; otherwise one for the whole stroke.
    joined : str
        ``pooled``: the 95 % quantile of errors over u in the training strokes, each of the same weight; ``largest``:
        the largest of the strokes' own.
    q : dict of str
        The numbers, by phase, and that of the whole stroke.
    left_out : dict
        For each training stroke how the band calibrated on the others fared there: ``inside``, ``half_width`` (median)
        and ``score`` (interval score), in rulers.
    """

    floor: float
    by_phase: bool
    joined: str
    q: dict[str, float]
    left_out: dict[str, dict[str, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PredictedStroke:
    """A stroke, its prediction and u without floor, (n,), m; to calibrate on: by parameters fitted without it."""

    stroke: Stroke
    prediction_m: Array
    u_m: Array


def spread(stroke: Stroke, predict: Predict, z: Array, prediction: Array) -> Array:
    """Standard uncertainty u(t) (n,), m, of a prediction beside what the model lacks, without floor.

    The ensemble draws calibrations and rests of the key; its spread is the median departure, so that a draw in which
    the hammer goes another way (is not caught, say) does not set it. What other strokes would have made of the
    parameters is in q.
    """
    random = np.random.default_rng(SEED)
    away = []
    for _ in range(DRAWS):
        try:
            away.append(np.abs(predict(z, stroke, stroke.key.draw(random)) - prediction))
        except model.ModelError:
            continue
    drawn = NORMAL * np.median(away, axis=0) if away else np.zeros(prediction.size)
    return np.hypot(drawn, np.hypot(stroke.hammer.position.u_calibration_m, stroke.hammer.u_zero_m))


def calibrate(strokes: Sequence[PredictedStroke]) -> Calibration:
    """Choose the candidate with the least interval score on strokes that its numbers have not seen, and calibrate it.

    Parameters
    ----------
    strokes : sequence of PredictedStroke
        Training strokes, at least two.

    Returns
    -------
    Calibration
    """
    best: tuple[float, Candidate, dict[str, dict[str, float]]] | None = None
    for candidate in CANDIDATES:
        fared = {}
        for one in strokes:
            q = quantiles([other for other in strokes if other is not one], candidate)
            fared[str(one.stroke.number)] = score(one.stroke, one.prediction_m, half_width(one, candidate, q))
        mean = float(np.mean([row["score"] for row in fared.values()]))
        if best is None or mean < best[0]:
            best = mean, candidate, fared
    assert best is not None
    _, chosen, fared = best
    return Calibration(chosen.floor, chosen.by_phase, chosen.joined, quantiles(strokes, chosen), fared)


def quantiles(strokes: Sequence[PredictedStroke], candidate: Candidate) -> dict[str, float]:
    """Numbers q of each phase and of the whole; a phase that no stroke shows gets that of the whole."""
    ratios: dict[str, list[Array]] = {name: [] for name in (*PHASES, WHOLE)}
    for one in strokes:
        error = np.abs(one.prediction_m - one.stroke.hammer.value_m)
        at, ratio = phases(one.stroke), error / floored(one, candidate.floor)
        ratios[WHOLE].append(ratio)
        for i, name in enumerate(PHASES):
            if np.any(at == i):
                ratios[name].append(ratio[at == i])
    join = _pooled if candidate.joined == "pooled" else _largest
    whole = join(ratios[WHOLE])
    return {name: join(of) if of and candidate.by_phase else whole for name, of in ratios.items()}


def floored(one: PredictedStroke, floor: float) -> Array:
    """Standard uncertainty with its floor (n,), m."""
    return np.asarray(np.hypot(one.u_m, floor * one.stroke.hammer.travel_m))


def _pooled(ratios: Sequence[Array]) -> float:
    values = np.concatenate(ratios)
    weights = np.concatenate([np.full(one.size, 1.0 / one.size) for one in ratios])
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / len(ratios)
    return float(values[order][min(int(np.searchsorted(share, LEVEL)), values.size - 1)])


def _largest(ratios: Sequence[Array]) -> float:
    return max(_pooled([one]) for one in ratios)


def half_width(one: PredictedStroke, way: Candidate | Calibration, q: dict[str, float]) -> Array:
    """Half width of the band (n,), m."""
    return np.asarray(floored(one, way.floor) * np.array([q[name] for name in PHASES])[phases(one.stroke)])


def score(stroke: Stroke, prediction_m: Array, half_m: Array) -> dict[str, float]:
    """Share inside a band, its median half width and its interval score, the latter two in rulers."""
    travel = stroke.hammer.travel_m
    return {
        "inside": float(np.mean(np.abs(prediction_m - stroke.hammer.value_m) <= half_m)),
        "half_width": float(np.median(half_m)) / travel,
        "score": interval_score(stroke.hammer.value_m, prediction_m, half_m) / travel,
    }


def interval_score(measured: Array, prediction: Array, half: Array) -> float:
    """Mean interval score of a 95 % band (Gneiting and Raftery 2007, eq. 43), in the unit of the curves; less is
    better."""
    beyond = np.maximum(np.abs(measured - prediction) - half, 0.0)
    return float(np.mean(2.0 * half + 2.0 / (1.0 - LEVEL) * beyond))
