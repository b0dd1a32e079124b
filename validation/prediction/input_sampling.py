"""What the inputs of a prediction may have been: draws of the force and of the action's parameters within their u.

Conventions: a *case* is an action, a force and a tolerance; parameters are drawn independently from normal
distributions cut at three standard deviations, from lognormal ones where u is more than a quarter of the value, so
that no friction turns negative. Parameters whose u is this project's decision (basis ``assumed``) are a group of their
own; those of an identified set are drawn together, as correlated as they were found (`posterior`). A draw the model
cannot use is counted by `validation.statistics.event_budget`.
Source: JCGM 101 (propagation of distributions); the force's budget is that of
`validation.measurement.force_correction`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import model
from validation.conventions import Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.posterior import posterior_of

ASSUMED = "assumed"
PARAMETER_DRAWS = 24
ASSUMED_DRAWS = 12
IDENTIFIED = "identified parameters"
NOISE_DRAWS = 4
LARGE_RELATIVE_U = 0.25
SEED = 20


@dataclass(frozen=True)
class Case:
    """Inputs of one run: its group, changed parameters, force over time, requested tolerance, preload."""

    group: str
    changed: dict[str, float]
    time_s: Array
    force_n: Array
    tolerance: float
    preload_n: float


def cases(m: MeasuredTrial, action: model.Action, tolerance: float) -> list[Case]:
    """All runs of a budget; the first is the case as it stands."""
    f = m.force

    def case(
        group: str,
        *,
        changed: dict[str, float] | None = None,
        time_s: Array = f.time_s,
        force_n: Array = f.force_n,
        tol: float = tolerance,
        preload: float = f.preload_n,
    ) -> Case:
        return Case(group, changed or {}, time_s, force_n, tol, preload)

    gain = 1 + f.channel.gain_relative_u
    rng = np.random.default_rng([SEED, m.number])
    found = [case("base"), case("numerics", tol=tolerance / 10), case("numerics", tol=tolerance / 100)]
    found += [
        case("force gain", force_n=f.force_n * gain, preload=f.preload_n * gain),
        case("force level", force_n=f.force_n + f.u_level_n, preload=f.preload_n + f.u_level_n),
        case("force delay", time_s=f.time_s + f.channel.u_group_delay_s),
    ]
    found += [
        case("force noise", force_n=f.force_n + f.noise_n * rng.standard_normal(f.force_n.size))
        for _ in range(NOISE_DRAWS)
    ]
    for group, draws in (("stated parameters", PARAMETER_DRAWS), ("assumed parameters", ASSUMED_DRAWS)):
        known = uncertain_parameters(action, assumed=group.startswith("assumed"))
        if known:
            found += [case(group, changed=_unit_vectors(values, action)) for values in _draws(known, draws, rng)]
    joint = posterior_of(action)
    if joint is not None:
        drawn = joint.draws(action, PARAMETER_DRAWS, rng)
        found += [case(IDENTIFIED, changed=_unit_vectors(values, action)) for values in drawn]
    return found


def parameter_draws(action: model.Action, n: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """Draw ``n`` sets of all uncertain parameters, stated, assumed and identified ones together."""
    known = uncertain_parameters(action, assumed=False) | uncertain_parameters(action, assumed=True)
    alone = list(_draws(known, n, rng)) if known else [{} for _ in range(n)]
    joint = posterior_of(action)
    together = joint.draws(action, n, rng) if joint is not None else [{} for _ in range(n)]
    return [_unit_vectors(a | b, action) for a, b in zip(alone, together, strict=True)]


def uncertain_parameters(action: model.Action, *, assumed: bool) -> dict[str, tuple[float, float]]:
    """Value and standard uncertainty of every parameter with u > 0 whose basis is (not) an assumption.

    Those of an identified set's posterior are not among them.
    """
    joint = posterior_of(action)
    elsewhere = joint.moved if joint is not None else frozenset()
    return {
        path: (q.value, q.u)
        for path, q in sorted(model.quantities_of(action).items())
        if q.u > 0 and (q.basis == ASSUMED) == assumed and path not in elsewhere
    }


def _draws(known: dict[str, tuple[float, float]], n: int, rng: np.random.Generator) -> Iterator[dict[str, float]]:
    value, u = (np.array(column) for column in zip(*known.values(), strict=True))
    for _ in range(n):
        z = np.clip(rng.standard_normal(value.size), -3.0, 3.0)
        drawn = value + u * z
        large = u > LARGE_RELATIVE_U * np.abs(value)
        with np.errstate(divide="ignore", invalid="ignore"):
            width = np.sqrt(np.log1p((u / value) ** 2))
            skewed = value * np.exp(width * z - width**2 / 2)
        # a value of zero has no logarithm: a half normal keeps its sign
        drawn = np.where(large, np.where(value == 0, np.abs(u * z), skewed), drawn)
        yield {path: float(x) for path, x in zip(known, drawn, strict=True)}


def _unit_vectors(values: dict[str, float], action: model.Action) -> dict[str, float]:
    """Directions drawn by their components, brought back to the length they have."""
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
