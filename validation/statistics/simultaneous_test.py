"""Does the mean difference of model and trials leave what the declared uncertainties allow, anywhere in the window?

Conventions: curves are stacked (…, n_samples, n_channels) in rad; *draws* are differences as they would be if the model
were right, each with all inputs drawn anew (`validation.prediction.joint_draws`), so their covariance over time and
channels is that of the declared uncertainties, whatever its form.
Source: Monte Carlo test (Besag and Clifford 1989). u(t) is the root mean square of the draws; T is the largest |D| over
time and channels in units of √(u² + u_w²), where u_w is a quarter of the root mean square of u over the window: without
it an instant at which few draws differ decides, and power is lost (the quarter was chosen by power, on seeds of its
own). The difference found is one more draw if the model is right, so that it exceeds the draw of rank 0.95 (N + 1) with
a probability of 5 %, however skewed and correlated the curves are. A draw is judged by the others' u.
Scatter of the trials enters where it is larger than the draws' own (their 95 % rank) and there are at least four
trials: random combinations of the trials' residuals, with Student's factor, are added to the draws.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array

LEVEL = 0.05
FEWEST_FOR_SCATTER = 4
STEADY = 0.25
SEED = 1989


@dataclass(frozen=True)
class SimultaneousTest:
    """Outcome of the test, and the band it amounts to.

    Attributes
    ----------
    difference, u : (n_samples, n_channels) mean difference, model minus trial, and its standard uncertainty
    scale : (n_samples, n_channels) unit in which the difference is judged, at least ``u``
    factor : largest |D|/scale that a right model reaches in 95 % of sessions; the band is ± factor · scale
    reached : (n_channels,) largest |D|/scale found, NaN where a channel is not known
    largest_at : (n_channels,) its sample
    p : share of draws that reach at least as far; at least 1/(N + 1)
    draws : N
    excess_scatter : whether the trials scatter about the model by more than is declared, and this was added
    """

    difference: Array
    u: Array
    scale: Array
    factor: float
    reached: Array
    largest_at: NDArray[np.int64]
    p: float
    draws: int
    excess_scatter: bool

    @property
    def rejected(self) -> bool:
        """Whether the difference lies outside the band anywhere."""
        return bool(np.nanmax(self.reached) > self.factor)


def simultaneous_test(found: Array, draws: Array, floor: Array) -> SimultaneousTest | None:
    """Test the mean over trials.

    Parameters
    ----------
    found : (n_trials, n_samples, n_channels) array
        Model minus trial, NaN where lost.
    draws : (N, n_trials, n_samples, n_channels) array
        The same as drawn.
    floor : (n_channels,) array
        Smallest standard uncertainty of a mean of this channel.

    Returns
    -------
    SimultaneousTest or None
        None when fewer than 19 draws could be run, or nothing is known.
    """
    n_draws, n_trials = draws.shape[:2]
    if n_draws < 19 or not np.isfinite(found).any():
        return None
    usable = np.isfinite(found) & np.isfinite(draws).all(axis=0)
    count = usable.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(usable, found, 0.0).sum(axis=0) / count
        drawn = np.where(usable, draws, 0.0).sum(axis=1) / count
    known = count > 0
    excess = n_trials >= FEWEST_FOR_SCATTER and _more_scatter(found, draws, usable, mean, drawn)
    if excess:
        residual = np.where(usable, found - mean, 0.0)
        rng = np.random.default_rng([SEED, n_draws, n_trials])
        z = rng.standard_normal((n_draws, n_trials))
        student = np.sqrt((n_trials - 1) / rng.chisquare(n_trials - 1, n_draws))
        extra = np.tensordot(z * student[:, None], residual, axes=1)
        drawn = drawn + extra / np.sqrt(n_trials * (n_trials - 1.0))
    square = np.where(known, drawn, 0.0) ** 2
    total = square.sum(axis=0)
    u = np.sqrt(total / n_draws + floor**2)
    scale = _steadied(u, known)
    others = _steadied(np.sqrt((total - square) / (n_draws - 1) + floor**2), known)
    reach = np.sort((np.sqrt(square) / np.where(others > 0, others, np.inf)).max(axis=(1, 2)))
    rank = int(np.ceil((1 - LEVEL) * (n_draws + 1) - 1e-9))
    there = known & (scale > 0)
    ratio = np.where(there, np.abs(np.where(known, mean, 0.0)) / np.where(there, scale, 1.0), -np.inf)
    reached = ratio.max(axis=0)
    found_reach = float(reached.max())
    return SimultaneousTest(
        difference=np.where(known, mean, np.nan),
        u=np.where(known, u, np.nan),
        scale=np.where(known, scale, np.nan),
        factor=float(reach[min(rank, n_draws) - 1]),
        reached=np.where(np.isfinite(reached), reached, np.nan),
        largest_at=np.asarray(ratio.argmax(axis=0), dtype=np.int64),
        p=float((1 + (reach >= found_reach).sum()) / (n_draws + 1)),
        draws=n_draws,
        excess_scatter=excess,
    )


def _steadied(u: Array, known: NDArray[np.bool_]) -> Array:
    """Unit of the statistic, (…, n_samples, n_channels): u and a share of its root mean square over the window."""
    mean_square = np.where(known, u**2, 0.0).sum(axis=-2, keepdims=True) / np.maximum(known.sum(axis=0), 1)
    return np.asarray(np.sqrt(u**2 + STEADY**2 * mean_square))


def _more_scatter(found: Array, draws: Array, usable: NDArray[np.bool_], mean: Array, drawn: Array) -> bool:
    """Whether the trials scatter about their mean difference by more than 95 % of the draws do, in any channel."""
    own = (np.where(usable, found - mean, 0.0) ** 2).sum(axis=(0, 1))
    theirs = (np.where(usable, draws - drawn[:, None], 0.0) ** 2).sum(axis=(1, 2))
    usual = theirs.mean(axis=0)
    there = usual > 0
    if not there.any():
        return bool((own > 0).any())
    rank = int(np.ceil((1 - LEVEL) * (len(draws) + 1) - 1e-9))
    reach = np.sort((theirs[:, there] / usual[there]).max(axis=1))
    return bool((own[there] / usual[there]).max() > reach[min(rank, len(reach)) - 1])
