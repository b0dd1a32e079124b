"""How far the result hangs on single trials: jackknife, and the Student factor of few trials.

The sizes of noise are learnt from few trials, so that intervals need more than 1.96 standard uncertainties: the part of
the variance that comes from scatter between trials has as many degrees of freedom as trials less sessions; that of the
discrepancy as many as independent values of it are seen (Welch–Satterthwaite). Source: JCGM 100, G.4.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from validation.conventions import Array
from validation.identification.fit import Fitted
from validation.identification.noise import FORMS_S, LEAST, Marginal, Sizes, learn

LEAST_TRIALS = 3
ROUNDS = 15


def jackknife(fitted: Fitted) -> Array:
    """Standard uncertainty (p,) of z from leaving out one trial after the other; NaN with fewer than three."""
    blocks = fitted.marginal.blocks
    n = len(blocks)
    if n < LEAST_TRIALS:
        return np.full(fitted.z.size, np.nan)
    found = []
    for k in range(n):
        kept = [i for i in range(n) if i != k]
        if not any(blocks[i].session == blocks[k].session for i in kept):
            continue  # the only trial of its session: leaving it out is another experiment
        part = Marginal([blocks[i] for i in kept], fitted.marginal.sizes)
        found.append(part.mean([fitted.linear[i] for i in kept])[: part.p])
    if len(found) < LEAST_TRIALS:
        return np.full(fitted.z.size, np.nan)
    m = len(found)
    return np.asarray(np.sqrt((m - 1) / m * ((np.array(found) - np.mean(found, axis=0)) ** 2).sum(axis=0)))


def factors(fitted: Fitted) -> Array:
    """Student factor (p,) of the 95 % interval of each parameter."""
    marginal = fitted.marginal
    sizes, blocks = marginal.sizes, marginal.blocks
    whole = np.diag(marginal.covariance)[: marginal.p]

    def share(other: Sizes) -> Array:
        """Share of the variance that is gone with these sizes, (p,)."""
        return np.clip(1.0 - np.diag(Marginal(blocks, other).covariance)[: marginal.p] / whole, 0.0, 1.0)

    still = replace(sizes, scatter=np.minimum(sizes.scatter, LEAST), own=np.minimum(sizes.own, LEAST))
    right = replace(sizes, common=np.minimum(sizes.common, LEAST))
    first = {b.session: b for b in blocks}
    between = max(len(blocks) - len(first), 1)
    # a discrepancy is as many independent values as correlation times fit into a stroke, in each channel
    values = sum(len(b.channels) * (1.0 + float(np.ptp(b.time_s)) / sizes.correlated_s) for b in first.values())
    within = max(values - float(np.sum(whole < 0.25)), 1.0)
    freedom = 1.0 / np.maximum(share(still) ** 2 / between + share(right) ** 2 / within, 1e-6)
    return np.asarray(student.ppf(0.975, freedom))


def forms(fitted: Fitted) -> Array:
    """How far z (p,) moves at most with the assumed form of what the model lacks: with other correlation times."""
    marginal = fitted.marginal
    here = marginal.mean(fitted.linear)[: marginal.p]
    moved = np.zeros(marginal.p)
    for correlated_s in FORMS_S:
        sizes = replace(marginal.sizes, correlated_s=correlated_s)
        other = learn(marginal.blocks, fitted.linear, sizes, ROUNDS)
        moved = np.maximum(moved, np.abs(other.mean(fitted.linear)[: marginal.p] - here))
    return moved


def lacking(fitted: Fitted) -> float:
    """Largest learnt size of the discrepancy in any session and channel, of what all laws together could do."""
    return float(fitted.marginal.sizes.common.max())
