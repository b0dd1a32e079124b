"""From a fit to the estimate of each asked parameter: value, interval, verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from validation.identification.fit import Fitted
from validation.identification.identifiability import HALF
from validation.identification.outcome.result import (
    AT_BOUND,
    DOUBTFUL,
    IDENTIFIED,
    NOT_IDENTIFIABLE,
    NOT_SETTLED,
    TOO_FEW,
    Estimate,
)
from validation.identification.problem import Problem
from validation.identification.profiles import Profile, profile
from validation.identification.scatter import LEAST_TRIALS, factors, jackknife, of_lacking, widened

NEAR_BOUND = 0.02
NORMAL = 1.96
LACKING = 0.01
"""Size of the discrepancy, of what all laws together could do, above which the model is said to lack something."""


def estimate_all(
    problem: Problem,
    fitted: Fitted,
    wanted: Sequence[str] | None,
    say: Callable[[str], None],
    keep: Callable[[Profile], None] | None = None,
) -> list[Estimate]:
    """Estimates of all asked parameters.

    Parameters
    ----------
    problem : Problem
    fitted : Fitted
    wanted : names to make a profile of; None for all asked
    say : called with a line of text
    keep : called with each profile
    """
    factor, jack, lack = factors(fitted), jackknife(fitted), of_lacking(fitted)
    width = widened(np.sqrt(np.diag(fitted.covariance)), jack, len(problem.trials))
    out = []
    for j, parameter in enumerate(problem.unknowns.asked):
        made = None
        if wanted is None or parameter.name in wanted:
            say(f"profile of {parameter.name}")
            made = profile(problem, fitted, j, float(factor[j]))
            if keep is not None:
                keep(made)
        out.append(
            _estimate(problem, fitted, j, (float(factor[j]), float(width[j]), float(jack[j]), float(lack[j])), made)
        )
    return out


def _estimate(
    problem: Problem, fitted: Fitted, j: int, spread: tuple[float, float, float, float], made: Profile | None
) -> Estimate:
    """One estimate; ``spread`` is Student factor, u, jackknife u, and u from what the model lacks."""
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
