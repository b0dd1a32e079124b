"""Identification of the handful of free parameters from some strokes: bounded least squares with wide priors.

The misfit is that of the hammer's displacement in rulers, at samples spread evenly over time and movement together, so
that a long hold does not outweigh the blow. It is robust (pseudo-Huber): what the model lacks, such as a bounce
after the release, must not drag the rest along. Each stroke counts as `INDEPENDENT` values that scatter by
`SCATTER`, whatever its length: residuals of a model are not white, and intervals from white ones would be many times
too small.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import model
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.positions.driven import predict_hammer
from validation.positions.measured import Stroke, smoothed
from validation.positions.null_hammer import NullAction, predict_null
from validation.positions.parameters import Nominal, Sensing, action_of, sensing_of

SCATTER = 0.05
"""What the model is expected to miss the hammer by, in rulers."""
INDEPENDENT = 60.0
APART_S, APART_M = 0.02, 0.02
"""Samples of the misfit are so far apart: in time, or the hammer in rulers."""
DIFFERENCE = 0.06
"""Step of a parameter for the slopes, in standard deviations of its prior: contacts make the misfit rough."""
LIMIT = 4.0
"""Parameters stay within so many standard deviations of their priors."""
MOST_RUNS = 25

T = TypeVar("T")
Predict = Callable[[Array, Stroke, Array | None], Array]
"""Displacement of the hammer (n,), m, for parameters (p,) and a stroke, the key's displacement given or measured."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters in standard deviations of their priors (p,), their covariance (p, p), and the misfit before and
    after."""

    z: Array
    covariance: Array
    cost_before: float
    cost: float
    runs: int


def of_model(action: model.Action) -> Predict:
    """The full model under test as a prediction of all free parameters."""

    nominal = _known(action, Nominal.of)

    def predict(z: Array, stroke: Stroke, displacement_m: Array | None) -> Array:
        sensing = _sensing(nominal, z, stroke)
        return predict_hammer(action_of(action, z), stroke, sensing, nominal.key_rest_rad, displacement_m)

    return predict


def of_null(action: model.Action) -> Predict:
    """The null model as a prediction of the sensors' parameters alone."""
    nominal, null = _known(action, Nominal.of), _known(action, NullAction.of)

    def predict(z: Array, stroke: Stroke, displacement_m: Array | None) -> Array:
        return predict_null(null, stroke, _sensing(nominal, z, stroke), displacement_m)

    return predict


def _known(action: model.Action, of: Callable[[model.Action], T]) -> T:
    """What is known of an action before any stroke; one line where it does not even rest."""
    try:
        return of(action)
    except model.ModelError as error:
        raise ValidationInputError(f"{action.name}: the model cannot run ({error}); use another action") from None


def _sensing(nominal: Nominal, z: Array, stroke: Stroke) -> Sensing:
    return sensing_of(nominal, z, stroke.key.travel_m, stroke.hammer.travel_m)


@lru_cache(maxsize=64)
def chosen_samples(stroke: Stroke) -> NDArray[np.int64]:
    """Samples of the misfit."""
    steady = smoothed(stroke.hammer.value_m, np.full(stroke.time_s.size, 2e-2 * stroke.hammer.travel_m), 4e-5)
    way = np.diff(stroke.time_s) / APART_S + np.abs(np.diff(steady)) / (APART_M * stroke.hammer.travel_m)
    length = np.concatenate([[0.0], np.cumsum(way)])
    return np.unique(np.searchsorted(length, np.arange(0.0, length[-1])))


def misfit(z: Array, strokes: Sequence[Stroke], predict: Predict) -> Array:
    """Residuals: one a parameter (its prior), then those of every stroke."""
    parts = [z]
    for stroke in strokes:
        at = chosen_samples(stroke)
        try:
            error = (predict(z, stroke, None) - stroke.hammer.value_m)[at] / stroke.hammer.travel_m
        except model.ModelError:
            error = np.ones(at.size)
        error = np.clip(np.nan_to_num(error, nan=1.0), -1.0, 1.0) / SCATTER
        robust = np.sign(error) * np.sqrt(2.0 * (np.sqrt(1.0 + error**2) - 1.0))
        parts.append(robust * np.sqrt(INDEPENDENT / at.size))
    return np.concatenate(parts)


def fit(
    strokes: Sequence[Stroke],
    predict: Predict,
    start: Array,
    *,
    runs: int = MOST_RUNS,
    say: Callable[[str], None] = lambda text: None,
) -> Fit:
    """Identify the parameters.

    Parameters
    ----------
    strokes : sequence of Stroke
    predict : callable
    start : ndarray, shape (p,)
    runs : int
        Most evaluations of the misfit, slopes not counted.
    say : callable
        Told of the progress.

    Returns
    -------
    Fit

    Raises
    ------
    ValidationInputError
        There is no stroke to fit.
    """
    if not strokes:
        raise ValidationInputError("identification: no stroke to fit; choose some that are not held out")

    def slopes(z: Array) -> Array:
        here = misfit(z, strokes, predict)
        out = np.empty((here.size, z.size))
        for i in range(z.size):
            step = DIFFERENCE if z[i] < LIMIT - DIFFERENCE else -DIFFERENCE
            moved = z.copy()
            moved[i] += step
            out[:, i] = (misfit(moved, strokes, predict) - here) / step
        say(f"misfit {0.5 * float(here @ here):.1f}")
        return out

    before = misfit(start, strokes, predict)
    found = least_squares(
        lambda z: misfit(z, strokes, predict), start, jac=slopes, bounds=(-LIMIT, LIMIT), max_nfev=runs, xtol=1e-3,
        ftol=2e-3,
    )  # fmt: skip
    covariance = np.linalg.inv(found.jac.T @ found.jac)  # the priors' rows keep it regular
    return Fit(found.x, covariance, 0.5 * float(before @ before), float(found.cost), int(found.nfev))
