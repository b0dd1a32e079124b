"""Area metric of an event: how far the distribution over predictions lies from the distribution over trials.

Conventions: in the unit of the event; the area between the two empirical distribution functions.
Source: Ferson, Oberkampf and Ginzburg (2008); for equally many values it is the mean distance of the sorted values.
Few trials put a floor under it: two samples of one and the same distribution are apart by chance. The floor is
simulated for independent normal samples (a model driven by the trials' own forces can lie below it).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from validation.conventions import Array

DRAWS = 4000
SEED = 2008


def area_metric(model: Array, trial: Array) -> float:
    """Area between two empirical distribution functions; NaN values are left out."""
    m, t = (np.asarray(v, dtype=float)[np.isfinite(v)] for v in (model, trial))
    if min(m.size, t.size) < 2:
        return float("nan")
    return float(_between(m[None], t[None])[0])


@lru_cache(maxsize=256)
def area_floor(n_model: int, n_trial: int) -> tuple[float, float]:
    """Mean and 95th percentile of the area metric of a perfect model, over the standard deviation of the trials.

    >>> [round(v, 1) for v in area_floor(5, 5)]
    [0.7, 1.3]
    """
    if min(n_model, n_trial) < 2:
        return float("nan"), float("nan")
    rng = np.random.default_rng([SEED, n_model, n_trial])
    areas = _between(rng.standard_normal((DRAWS, n_model)), rng.standard_normal((DRAWS, n_trial)))
    return float(areas.mean()), float(np.quantile(areas, 0.95))


def _between(model: Array, trial: Array) -> Array:
    """Area between the two distribution functions of every row."""
    values = np.concatenate([model, trial], axis=1)
    order = np.argsort(values, axis=1, kind="stable")
    of_model = order < model.shape[1]
    apart = np.cumsum(of_model / model.shape[1] - ~of_model / trial.shape[1], axis=1)
    width = np.diff(np.take_along_axis(values, order, axis=1), axis=1)
    return np.asarray((np.abs(apart[:, :-1]) * width).sum(axis=1))
