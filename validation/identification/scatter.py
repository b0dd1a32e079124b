"""How far the result hangs on single trials: jackknife, and the Student factor of few trials.

The sizes of noise are learnt from few trials, so that intervals need more than 1.96 standard uncertainties. The
variance of a value is a sum of shares of all sizes; the information on the sizes says how well each share is known, and
so how many degrees of freedom the variance has (as Welch and Satterthwaite's, with sizes that are learnt together).
Source: JCGM 100, G.4; Kackar and Harville (1984).
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student

from validation.conventions import Array
from validation.identification.fit import Fitted
from validation.identification.noise import Marginal
from validation.identification.noise.learning import scores

LEAST_TRIALS = 3
LEAST_FREEDOM = 2.0
BY_CHANCE = 0.99  # probability: a jackknife that is larger than chance makes it widens an interval


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


def widened(width: Array, jack: Array, trials: int) -> Array:
    """Standard uncertainties, as large as the jackknife where trials pull apart by more than chance.

    The jackknife of few trials is itself known to a third only: the larger of the two would always be too large.
    """
    most = np.sqrt(chi2.ppf(BY_CHANCE, max(trials - 1, 1)) / max(trials - 1, 1))
    return np.where(np.isfinite(jack) & (jack > most * width), jack, width)


def factors(fitted: Fitted) -> Array:
    """Student factor (p,) of the 95 % interval of each parameter."""
    found = scores(fitted.marginal)
    _, spread = fitted.marginal.sizes.belief()
    unknown = np.linalg.inv(found.information + np.diag(1.0 / spread**2))  # covariance of the logarithms of sizes
    varied = np.einsum("pi,ij,pj->p", found.shares, unknown, found.shares)
    return np.asarray(student.ppf(0.975, np.clip(0.5 / np.maximum(varied, 1e-9), LEAST_FREEDOM, None)))


def of_lacking(fitted: Fitted) -> Array:
    """Standard uncertainty (p,) of z that comes from what the model lacks."""
    sizes = fitted.marginal.sizes
    shares = scores(fitted.marginal).shares[:, -sizes.common.size :].sum(axis=1)
    return np.asarray(np.sqrt(np.minimum(shares, 1.0) * np.diag(fitted.covariance)))


def lacking(fitted: Fitted) -> float:
    """Largest learnt size of the discrepancy in any session and channel, of what all laws together could do."""
    return float(fitted.marginal.sizes.discrepancy.max())
