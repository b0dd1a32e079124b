"""How far the result hangs on single trials and kinds of stroke: jackknife; and the Student factor of few trials.

The sizes of noise are learnt from few trials, so that intervals need more than 1.96 standard uncertainties. The
variance of a value is a sum of shares of all sizes; the information on the sizes says how well each share is known, and
so how many degrees of freedom the variance has (as Welch and Satterthwaite's, with sizes that are learnt together).
Source: JCGM 100, G.4; Kackar and Harville (1984).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, stdtrit

from validation.conventions import CONFIDENCE, Array
from validation.infer.fit import Fitted
from validation.infer.noise import Marginal, scores

LEAST_TRIALS = 3  # that are left when one is taken away, so that a jackknife has a spread
LEAST_FREEDOM = 2.0  # degrees of freedom: Student's t has a mean and is not wider than 4.3
BY_CHANCE = 0.99  # probability: a jackknife that is larger than chance makes it widens an interval


def jackknife(fitted: Fitted) -> Array:
    """Standard uncertainty (p,) of z from leaving out one trial after the other; NaN with fewer than three."""
    blocks = fitted.marginal.blocks
    n = len(blocks)
    # the only trial of its session is not left out: that is another experiment
    alone = {k for k in range(n) if not any(blocks[i].session == blocks[k].session for i in range(n) if i != k)}
    return _jackknife_parts(fitted, [[i for i in range(n) if i != k] for k in range(n) if k not in alone], LEAST_TRIALS)


def jackknife_over_strokes(fitted: Fitted) -> Array:
    """Standard uncertainty (p,) of z by the jackknife on the linear model, leaving out one session (a kind of stroke)
    at a time; NaN with one session.

    It stands beside the interval and does not widen it: a kind of stroke that alone tells of a parameter moves it to
    its prior when it is left out, which is no error.
    """
    blocks = fitted.marginal.blocks
    return _jackknife_parts(
        fitted, [[i for i, b in enumerate(blocks) if b.session != s] for s in sorted({b.session for b in blocks})], 2
    )


def _jackknife_parts(fitted: Fitted, parts: Sequence[Sequence[int]], fewest: int) -> Array:
    """Standard uncertainty (p,) of z by the jackknife, from linear fits to each of ``parts``, lists of the indices of
    the trials kept; NaN with fewer than ``fewest`` parts.

    The sizes of the noise are kept.
    """
    if len(parts) < fewest:
        return np.full(fitted.z.size, np.nan)
    found = []
    for kept in parts:
        part = Marginal([fitted.marginal.blocks[i] for i in kept], fitted.marginal.sizes)
        found.append(part.mean([fitted.linear[i] for i in kept])[: part.p])
    return jackknife_u(found)


def jackknife_u(found: Sequence[ArrayLike]) -> Array:
    """Standard uncertainty (p,) of values from those found with one piece left out at a time, (n, p)."""
    n, table = len(found), np.array(found)
    return np.asarray(np.sqrt((n - 1) / n * ((table - table.mean(axis=0)) ** 2).sum(axis=0)))


def widen_by_jackknife(width: Array, jack: Array, trials: int) -> Array:
    """Standard uncertainties, as large as the jackknife where trials pull apart by more than chance.

    The jackknife of few trials is itself known to a third only: the larger of the two would always be too large.
    """
    most = np.sqrt(chdtri(max(trials - 1, 1), 1.0 - BY_CHANCE) / max(trials - 1, 1))
    return np.where(np.isfinite(jack) & (jack > most * width), jack, width)


def factors(fitted: Fitted) -> Array:
    """Student factor (p,) of the 95 % interval of each parameter."""
    found = scores(fitted.marginal)
    _, spread = fitted.marginal.sizes.log_prior_moments()
    unknown = np.linalg.inv(found.information + np.diag(1.0 / spread**2))  # covariance of the logarithms of sizes
    varied = np.einsum("pi,ij,pj->p", found.shares, unknown, found.shares)
    return np.asarray(stdtrit(np.clip(0.5 / np.maximum(varied, 1e-9), LEAST_FREEDOM, None), 0.5 + 0.5 * CONFIDENCE))


def discrepancy_u(fitted: Fitted) -> Array:
    """Standard uncertainty (p,) of z that comes from what the model lacks."""
    sizes = fitted.marginal.sizes
    shares = scores(fitted.marginal).shares[:, -sizes.common.size :].sum(axis=1)
    return np.asarray(np.sqrt(np.minimum(shares, 1.0) * np.diag(fitted.covariance)))


def measure_lack(fitted: Fitted) -> float:
    """Largest learnt size of the discrepancy in any session and channel, of what all laws together could do."""
    return float(fitted.marginal.sizes.discrepancy.max())
