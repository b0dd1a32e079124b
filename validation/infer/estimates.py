"""From a fit to the estimate of each asked parameter: value, interval, verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from validation.conventions import CONFIDENCE, Array
from validation.infer.budget import Budget
from validation.infer.fit import CORRECTIONS, Fitted
from validation.infer.identifiability import HALF
from validation.infer.noise import RISEN, OwnModes
from validation.infer.problem import Problem, residuals_there
from validation.infer.response import Own
from validation.infer.scatter import (
    LEAST_TRIALS,
    discrepancy_u,
    factors,
    jackknife,
    jackknife_over_strokes,
    widen_by_jackknife,
)

IDENTIFIED = "identified"
DOUBTFUL = "not identified: the model lacks more than the parameter does"
NOT_SETTLED = "not identified: the fit ran out of its budget"
TOO_FEW = "not identified: fewer than three trials say nothing of their scatter"
NOT_IDENTIFIABLE = "not identifiable from these strokes"
AT_BOUND = "at the end of what was allowed"


@dataclass(frozen=True)
class Estimate:
    """One parameter that was asked for.

    Conventions: ``value`` is SI, or a factor of the printed stiffness where a, b and c move together; ``u`` is the
    standard uncertainty of the value; intervals are 95 %. ``z`` and its uncertainty are in prior standard
    uncertainties.

    Attributes
    ----------
    name : as in `naming`
    unit : of the value
    prior, prior_u : value and relative or SI standard uncertainty before
    basis : where the prior's u comes from
    z, z_u : most probable value and standard uncertainty, in prior standard uncertainties
    value, u : the same in SI or as a factor
    low, high : 95 % interval of the value; by profile where one was made
    profiled : whether the interval is from a profile
    interval : ``two-sided``, ``open above``, ``open below`` or ``open``: what the strokes alone, without the prior, say
    u_jackknife : of z, from leaving out one trial after the other; NaN with fewer than 3
    u_form : part of ``z_u`` that comes from what the model lacks
    verdict : `IDENTIFIED`, or why not: `NOT_IDENTIFIABLE`, `AT_BOUND`, `DOUBTFUL`,
        `NOT_SETTLED`, `TOO_FEW`
    u_strokes : of z, from leaving out one session, which is one kind of stroke, after the other; NaN with one
    """

    name: str
    unit: str
    prior: float
    prior_u: float
    basis: str
    z: float
    z_u: float
    value: float
    u: float
    low: float
    high: float
    profiled: bool
    interval: str
    u_jackknife: float
    u_form: float
    verdict: str
    u_strokes: float = math.nan


REACH = (-2.0, -1.0, 1.0, 2.0)  # ends of the 95 % interval of the linear model


@dataclass(frozen=True)
class Profile:
    """One profile.

    Attributes
    ----------
    name : of the parameter
    z : (k,) held values, in increasing order, the most probable one among them
    rise : (k,) of the objective
    low, high : 95 % interval of z
    interval : ``two-sided``, ``open above``, ``open below`` or ``open``, without the parameter's own prior
    """

    name: str
    z: Array
    rise: Array
    low: float
    high: float
    interval: str


def profiles(
    problem: Problem, fitted: Fitted, factors: Mapping[int, float], budget: Budget | None = None
) -> list[Profile]:
    """Profile of twice the negative log posterior over each parameter in ``factors``, index in z -> Student factor of
    its 95 % interval: it is held at a few values, and the others refitted by runs. Fewer profiles where the budget
    ends.

    Conventions: the objective is twice the negative log posterior; at each held value the others go where the linear
    model says, and are corrected by runs of the model itself until that gains nothing. The 95 % interval is where it
    has risen by the square of the Student factor. The same without the parameter's own prior says what the strokes
    alone allow: open where it does not rise enough within `priors.BOX`. Profiles stop with the budget.
    """
    made: list[Profile] = []
    budget = Budget(np.inf) if budget is None else budget
    with budget.interruptible():
        for j, factor in factors.items():
            if budget.is_spent:
                break
            made.append(_make_profile(problem, fitted, j, factor))
    return made


def _make_profile(problem: Problem, fitted: Fitted, j: int, factor: float) -> Profile:
    """Profile of the j-th entry of z; ``factor`` is the Student factor of its 95 % interval."""
    low, high = (edge[j] for edge in problem.box())
    width, best = float(np.sqrt(fitted.covariance[j, j])), float(fitted.z[j])
    held = np.unique(np.clip(best + width * factor * np.array(REACH), low, high))
    points = [(j, _conditional_mode(problem, fitted, j, float(v))) for v in held if abs(v - best) > 1e-9]
    found = [(best, 0.0)]
    found += [
        (float(z[j]), up - fitted.objective)
        for (_, z), up in zip(points, _find_least(problem, fitted, points), strict=True)
    ]
    at, rise = np.array(sorted(pair for pair in found if np.isfinite(pair[1]))).T
    below, above = _find_interval_ends(at, rise, best, factor**2, width)
    alone = rise - (at**2 - best**2)
    ends = max(below, float(low)), min(above, float(high))
    return Profile(problem.unknowns.moved[j].name, at, rise, *ends, _interval_kind(at, alone, best, factor**2))


def _conditional_mode(problem: Problem, fitted: Fitted, j: int, value: float) -> Array:
    """Most probable z (p,) of the linear model with its j-th entry held at ``value``, in prior standard uncertainties;
    the others are clipped to their bounds."""
    low, high = problem.box()
    cov = fitted.covariance
    z = fitted.z + cov[:, j] / cov[j, j] * (value - fitted.z[j])
    z = np.clip(z, low, high)
    z[j] = value
    return z


def _find_least(problem: Problem, fitted: Fitted, points: Sequence[tuple[int, Array]]) -> list[float]:
    """Least objective (twice the negative log posterior) that runs reach from each start (j, z (p,)) with the j-th
    entry of z held and the others corrected; infinite where the model cannot run."""
    best, at = [math.inf] * len(points), [z for _, z in points]
    own = [fitted.own_at(z) for z in at]
    active = list(range(len(points)))
    for _ in range(CORRECTIONS + 1):
        found = _evaluate_points(problem, fitted, [at[i] for i in active], [own[i] for i in active])
        before, active, asked = best.copy(), [], active
        for i, (objective, linear) in zip(asked, found, strict=True):
            best[i] = min(objective, best[i])
            if linear is None or objective > before[i] - RISEN:
                continue
            at[i] = _correct_others(problem, fitted, points[i][0], at[i], linear)
            own[i] = None if fitted.own is None else OwnModes(fitted.marginal, linear, at[i]).most
            active.append(i)
        if not active:
            break
    return best


def _correct_others(problem: Problem, fitted: Fitted, j: int, z: Array, linear: list[Array]) -> Array:
    """Point z (p,) after a Gauss–Newton step of all but its j-th entry, clipped to the bounds; ``linear``: residuals of
    each trial that the linear model has at z = 0."""
    low, high = problem.box()
    cov = fitted.covariance
    mean = fitted.marginal.mean(linear)[: fitted.marginal.p]
    new = np.clip(mean + cov[:, j] / cov[j, j] * (z[j] - mean[j]), low, high)
    new[j] = z[j]
    return np.asarray(new)


def _evaluate_points(
    problem: Problem, fitted: Fitted, points: Sequence[Array], own: Sequence[Sequence[Own] | None]
) -> list[tuple[float, list[Array] | None]]:
    """Objective (twice the negative log posterior) at each point z (p,), by runs, and each trial's residuals of the
    linear model at z = 0; (inf, None) where the model cannot run. ``own``: random effects of the trials at each point,
    or None."""
    blocks = fitted.marginal.blocks
    out: list[tuple[float, list[Array] | None]] = []
    with_own = None if fitted.own is None else [o for o in own if o is not None]
    for z, o, curves in zip(points, own, problem.response.curves(points, with_own), strict=True):
        if curves is None:
            out.append((math.inf, None))
            continue
        here = residuals_there(problem, blocks, curves, o)
        linear = [r + b.moved @ z for r, b in zip(here, blocks, strict=True)]
        out.append((fitted.marginal.objective(here, z), linear))
    return out


def _find_interval_ends(z: Array, rise: Array, best: float, level: float, width: float) -> tuple[float, float]:
    """Lower and upper z at which a profile, ``rise`` (k,) at ``z`` (k,), reaches ``level`` on either side of ``best``:
    linear in its root, extrapolated beyond its ends; ``width``: u of z, used where it does not rise."""
    root = np.sqrt(np.maximum(rise, 0.0))
    want = float(np.sqrt(level))
    edges = []
    for sign in (-1.0, 1.0):
        side = sign * (z - best) >= 0
        x, y = sign * (z[side] - best), np.maximum.accumulate(root[side][:: int(sign)])[:: int(sign)]
        order = np.argsort(x)
        x, y = x[order], y[order]
        if y[-1] > want:
            i = int(np.argmax(y > want))
            edge = x[i - 1] + (want - y[i - 1]) / (y[i] - y[i - 1]) * (x[i] - x[i - 1])
        else:
            edge = x[-1] * want / y[-1] if y[-1] > 0.0 else want * width
        edges.append(best + sign * max(float(edge), 0.0))
    return edges[0], edges[1]


def _interval_kind(z: Array, alone: Array, best: float, level: float) -> str:
    """``two-sided`` where a profile's rise without the prior, ``alone`` (k,) at ``z`` (k,), exceeds ``level`` on both
    sides of ``best``; else the open end: ``open below``, ``open above`` or ``open``."""
    below = not bool(np.any(alone[z < best] > level)) if np.any(z < best) else True
    above = not bool(np.any(alone[z > best] > level)) if np.any(z > best) else True
    if below and above:
        return "open"
    return "open below" if below else "open above" if above else "two-sided"


NEAR_BOUND = 0.02  # prior standard deviations: an estimate so near a bound lies on it
NORMAL = float(ndtri(0.5 + 0.5 * CONFIDENCE))
LACKING = 0.01
"""Size of the discrepancy, of what all laws together could do, above which the model is said to lack something."""


def estimate_all(
    problem: Problem,
    fitted: Fitted,
    wanted: Sequence[str] | None,
    say: Callable[[str], None],
    keep: Callable[[Profile], None] | None = None,
    budget: Budget | None = None,
) -> list[Estimate]:
    """Estimates of all asked parameters in their order, with profiles by runs of those named in ``wanted`` (None: all;
    empty: none). ``say`` gets a line of progress; ``keep`` is called with each profile once all are made."""
    factor, jack, lack = factors(fitted), jackknife(fitted), discrepancy_u(fitted)
    strokes = jackknife_over_strokes(fitted)
    width = widen_by_jackknife(np.sqrt(np.diag(fitted.covariance)), jack, len(problem.trials))
    if fitted.remaining is not None:
        width = np.hypot(width, fitted.remaining[: len(width)])
    names = [p.name for p in problem.unknowns.asked]
    chosen = {j: float(factor[j]) for j, name in enumerate(names) if wanted is None or name in wanted}
    made: dict[int, Profile] = {}
    if chosen:
        say(f"profiles of {', '.join(names[j] for j in chosen)}")
        made = dict(zip(chosen, profiles(problem, fitted, chosen, budget), strict=False))
    if keep is not None:
        for one in made.values():
            keep(one)
    out = []
    for j in range(len(names)):
        spread = float(factor[j]), float(width[j]), float(jack[j]), float(lack[j])
        out.append(replace(_make_estimate(problem, fitted, j, spread, made.get(j)), u_strokes=float(strokes[j])))
    return out


def _make_estimate(
    problem: Problem, fitted: Fitted, j: int, spread: tuple[float, float, float, float], made: Profile | None
) -> Estimate:
    """Estimate with its verdict of the j-th asked parameter; ``spread``, all of z: Student factor of the 95 % interval,
    u, u by jackknife, u from what the model lacks; ``made``: its profile, None without one."""
    parameter, action = problem.unknowns.asked[j], problem.action
    factor, width, jack, lack = spread
    z = float(fitted.z[j])
    low, high = z - factor * width, z + factor * width
    if made is not None:  # a profile made of few points is not taken to be narrower than the linear model
        low, high = min(low, made.low), max(high, made.high)
    least, most = (float(edge[j]) for edge in problem.box())
    interval = "two-sided" if made is None else made.interval
    value = parameter.physical(action, z)
    verdict = IDENTIFIED
    if not fitted.converged:
        verdict = NOT_SETTLED
    elif len(problem.trials) < LEAST_TRIALS:
        verdict = TOO_FEW
    elif min(z - least, most - z) < NEAR_BOUND:
        verdict = AT_BOUND
    elif (high - low) / (2.0 * NORMAL) >= HALF or interval != "two-sided":
        else_u = float(np.sqrt(max(width**2 - lack**2, 0.0)))
        verdict = DOUBTFUL if interval == "two-sided" and factor * else_u < HALF * NORMAL else NOT_IDENTIFIABLE
    ends = sorted(parameter.physical(action, v) for v in (max(low, least), min(high, most)))
    return Estimate(
        name=parameter.name,
        unit=parameter.unit(action),
        prior=parameter.physical(action, 0.0),
        prior_u=parameter.u,
        basis=parameter.basis,
        z=z,
        z_u=width,
        value=value,
        u=abs(value) * parameter.u * width if parameter.factor else parameter.u * width,
        low=ends[0],
        high=ends[1],
        profiled=made is not None,
        interval=interval,
        u_jackknife=jack,
        u_form=lack,
        verdict=verdict,
    )
