"""A 95 % band about a prediction, calibrated on strokes that were not fitted, the same way for every model.

A band's half width is q · u(t): u joins what the key's calibration leaves open (an ensemble), the hammer's own
calibration and a floor; q is a number for each phase of the stroke, the 95 % quantile of |error| / u there over all
left-out strokes, each of the same weight. So q holds what the model lacks and what other strokes would have made of its
parameters, as far as left-out strokes show it. Phases follow from the key alone: they are known before the hammer is.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

import model
from validation.conventions import Array
from validation.positions.identify import Predict
from validation.positions.measured import Stroke

PHASES = ("rest", "strike", "hold", "release")
FLOOR = 0.02
"""Least standard uncertainty of a prediction, in rulers: a fifth of the hammer ruler's tick, whatever a sensor says."""
LEVEL = 0.95
DRAWS, SEED = 9, 19
NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median departure."""
STARTED, DOWN, UP = 0.05, 0.9, 0.1
"""Shares of the key's travel: a strike begins above the first; above the second the key is down, below the third up."""
AFTER_DOWN_S, AFTER_UP_S = 0.06, 0.25
"""The strike lasts so long after the key is down; the release so long after the key is up."""
AGAIN = 0.15
"""A key that rises by this share before it is up and goes down again begins a new strike."""


@lru_cache(maxsize=64)
def phases(stroke: Stroke) -> NDArray[np.int64]:
    """Phase of each sample (n,), an index of `PHASES`, by the key alone."""
    share = stroke.key.value_m / max(float(stroke.key.value_m.max()), 1e-9)
    out = np.zeros(share.size, dtype=np.int64)
    step, now, since, lowest = stroke.interval_s, 0, 0.0, 1.0
    for k, x in enumerate(share):
        since += step
        if now == 0 and x > STARTED:
            now = 1
        elif now == 1:
            since = since if x > DOWN else 0.0
            if since > AFTER_DOWN_S:
                now = 2
            elif x < STARTED / 2 and since == 0.0 and share[:k].max() > DOWN:
                now, lowest = 3, x
        elif now == 2 and x < DOWN:
            now, lowest = 3, x
        elif now == 3:
            lowest = min(lowest, x)
            since = since if x < UP else 0.0
            if x > lowest + AGAIN:
                now, since = 1, 0.0
            elif since > AFTER_UP_S:
                now = 0
        out[k] = now
    return out


def spread(stroke: Stroke, predict: Predict, z: Array, prediction: Array) -> Array:
    """Standard uncertainty u(t) (n,), m, of a prediction beside what the model lacks.

    The ensemble draws calibrations of the key; its spread is the median departure, so that a draw in which the hammer
    goes another way (is not caught, say) does not set it. What other strokes would have made of the parameters is in q.
    """
    random = np.random.default_rng(SEED)
    away = []
    for _ in range(DRAWS):
        try:
            away.append(np.abs(predict(z, stroke, stroke.key.draw(random)) - prediction))
        except model.ModelError:
            continue
    drawn = NORMAL * np.median(away, axis=0) if away else np.zeros(prediction.size)
    own = np.hypot(stroke.hammer.position.u_calibration_m, FLOOR * stroke.hammer.travel_m)
    return np.hypot(drawn, own)


def quantiles(strokes: Sequence[tuple[Stroke, Array, Array]]) -> dict[str, float]:
    """Numbers q of each phase from left-out strokes: (stroke, prediction (n,), u (n,)) each.

    The 95 % quantile of |error| / u of all left-out strokes together, every stroke of the same weight.
    """
    ratios: dict[str, list[Array]] = {name: [] for name in PHASES}
    for stroke, prediction, u in strokes:
        at, ratio = phases(stroke), np.abs(prediction - stroke.hammer.value_m) / u
        for i, name in enumerate(PHASES):
            if np.any(at == i):
                ratios[name].append(ratio[at == i])
    return {name: _pooled(of) if of else 0.0 for name, of in ratios.items()}


def _pooled(ratios: Sequence[Array]) -> float:
    values = np.concatenate(ratios)
    weights = np.concatenate([np.full(one.size, 1.0 / one.size) for one in ratios])
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / len(ratios)
    return float(values[order][min(int(np.searchsorted(share, LEVEL)), values.size - 1)])


def half_width(stroke: Stroke, u: Array, q: dict[str, float]) -> Array:
    """Half width of the band (n,), m."""
    return np.asarray(u * np.array([q[name] for name in PHASES])[phases(stroke)])


def interval_score(measured: Array, prediction: Array, half: Array) -> float:
    """Mean interval score of a 95 % band (Gneiting and Raftery 2007, eq. 43), in the unit of the curves; less is
    better."""
    beyond = np.maximum(np.abs(measured - prediction) - half, 0.0)
    return float(np.mean(2.0 * half + 2.0 / (1.0 - LEVEL) * beyond))
