"""The joint uncertainty that goes into ``identified.toml``: the covariance of the fit, as wide as the estimates say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from validation.identification.fit import Fitted
from validation.identification.outcome.result import Estimate
from validation.identification.problem import Problem
from validation.prediction.posterior import Posterior, make_posterior


def joint_posterior(
    problem: Problem, fitted: Fitted, estimates: Sequence[Estimate], trials: Mapping[str, str]
) -> Posterior:
    """Posterior of every parameter the fit moved, without the force's errors; the asked ones as wide as stated.

    Correlations stay.

    Parameters
    ----------
    problem, fitted : the fit
    estimates : of the asked parameters
    trials : label -> SHA-256 of the trials fitted
    """
    wider = np.ones(fitted.covariance.shape[0])
    for j, e in enumerate(estimates):
        wider[j] = e.z_u / np.sqrt(fitted.covariance[j, j])
    kept = [j for j, p in enumerate(problem.unknowns.moved) if p.paths]  # errors of the force are the bench's
    moved = [(p.name, p.paths, p.u, p.factor) for p in problem.unknowns.moved if p.paths]
    return make_posterior(moved, (fitted.covariance * np.outer(wider, wider))[np.ix_(kept, kept)], trials)
