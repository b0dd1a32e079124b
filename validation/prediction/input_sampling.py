"""What the parameters of an action may have been: draws within their standard uncertainties.

Conventions: parameters are drawn independently from normal distributions cut at three standard deviations, from
lognormal ones where u is more than a quarter of the value, so that no friction turns negative; those of an identified
set are drawn together, as correlated as they were found (`posterior`).
Source: JCGM 101 (propagation of distributions).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import model
from validation.prediction.posterior import CUT, posterior_of

ASSUMED = "assumed"
LARGE_RELATIVE_U = 0.25  # beyond it a Gaussian would draw below 0 once in thirty thousand


def parameter_draws(action: model.Action, n: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """Draw ``n`` sets of all uncertain parameters, stated, assumed and identified ones together."""
    known = uncertain_parameters(action, assumed=False) | uncertain_parameters(action, assumed=True)
    alone = list(_draws(known, n, rng)) if known else [{} for _ in range(n)]
    joint = posterior_of(action)
    together = joint.draws(action, n, rng) if joint is not None else [{} for _ in range(n)]
    return [_restore_normals(a | b, action) for a, b in zip(alone, together, strict=True)]


def uncertain_parameters(action: model.Action, *, assumed: bool) -> dict[str, tuple[float, float]]:
    """Path -> (value, standard uncertainty), SI, of every parameter with u > 0 whose basis is an assumption
    (``assumed``), or is none; those of an identified set's posterior are left out."""
    joint = posterior_of(action)
    elsewhere = joint.moved if joint is not None else frozenset()
    return {
        path: (q.value, q.u)
        for path, q in sorted(model.quantities_of(action).items())
        if q.u > 0 and (q.basis == ASSUMED) == assumed and path not in elsewhere
    }


def _draws(known: dict[str, tuple[float, float]], n: int, rng: np.random.Generator) -> Iterator[dict[str, float]]:
    """Yield ``n`` independent draws, path -> value, of parameters ``known``, path -> (value, u): normal within 3 u,
    log-normal where u is over a quarter of the value, half normal where that is 0."""
    value, u = (np.array(column) for column in zip(*known.values(), strict=True))
    for _ in range(n):
        z = np.clip(rng.standard_normal(value.size), -CUT, CUT)
        drawn = value + u * z
        large = u > LARGE_RELATIVE_U * np.abs(value)
        with np.errstate(divide="ignore", invalid="ignore"):
            width = np.sqrt(np.log1p((u / value) ** 2))
            skewed = value * np.exp(width * z - width**2 / 2)
        # a value of zero has no logarithm: a half normal keeps its sign
        drawn = np.where(large, np.where(value == 0, np.abs(u * z), skewed), drawn)
        yield {path: float(x) for path, x in zip(known, drawn, strict=True)}


def _restore_normals(values: dict[str, float], action: model.Action) -> dict[str, float]:
    """Copy of drawn values by path, in which the drawn components of a contact's normal are scaled back to the length
    that the action gives it."""
    out = dict(values)
    for path in values:
        stem, _, axis = path.rpartition(".")
        if not stem.endswith(".normal") or axis not in ("x", "y"):
            continue
        pair = f"{stem}.x", f"{stem}.y"
        x, y = (out.get(p, action[p]) for p in pair)
        share = float(np.hypot(action[pair[0]], action[pair[1]]) / np.hypot(x, y))
        out |= {p: share * drawn for p, drawn in zip(pair, (x, y), strict=True) if p in values}
    return out
