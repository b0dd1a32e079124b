"""How well the strokes of one kind are predicted by all others, in closed form.

With W the inverse covariance of all data and a = W y, the trials kept aside (k) differ from what all others predict by
W_kk⁻¹ a_k with covariance W_kk⁻¹. Source: Rasmussen and Williams (2006), 5.4.2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from validation.conventions import Array
from validation.identification.noise.marginal import Marginal

GROWN = (2.0, 4.0, 0.5)
"""Factors of the whole discrepancy that are tried beside the likeliest."""


def held_out_score(marginal: Marginal, residuals: Sequence[Array]) -> float:
    """Sum of the log densities of strokes kept aside, each session where there are several, each trial else.

    Parameters
    ----------
    marginal : Marginal
    residuals : at z = 0 of the linear model, of each trial
    """
    mean, total = marginal.mean(residuals), 0.0
    sessions = sorted(marginal.roots)
    numbers = range(len(marginal.blocks))
    kinds = [[k for k in numbers if marginal.blocks[k].session == s] for s in sessions]
    if len(sessions) == 1:
        kinds = [[k] for k in numbers]
    for aside in kinds:
        mine = marginal.columns_of(marginal.blocks[aside[0]].session)
        log_root, backs, pulls = 0.0, [], []
        for k in aside:
            lower, x = marginal.white[k]
            log_root -= float(np.log(np.diag(lower)).sum())
            backs.append(x)
            pulls.append(solve_triangular(lower, residuals[k], lower=True) - x @ mean[mine])
        inner = marginal.covariance[np.ix_(mine, mine)]
        total += log_root + _log_density(np.vstack(backs), np.concatenate(pulls), inner)
    return total


def _log_density(back: Array, left: Array, covariance: Array) -> float:
    """Log density of whitened rows kept aside, whose part of the inverse covariance is 1 − back covariance backᵀ."""
    inside = np.linalg.inv(covariance) - back.T @ back  # the precision without the strokes kept aside
    inside = 0.5 * (inside + inside.T)
    factor = cho_factor(inside)
    # W_kk⁻¹ = 1 + back inside⁻¹ backᵀ, in whitened rows
    square = float(left @ left) + float((back.T @ left) @ cho_solve(factor, back.T @ left))
    log_det = float(np.linalg.slogdet(covariance)[1]) + 2.0 * float(np.log(np.diag(factor[0])).sum())
    return 0.5 * (log_det - square)
