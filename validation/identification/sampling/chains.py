"""Chains of draws from a density that is costly, smooth, and near a normal one: independence Metropolis–Hastings.

All proposals come from one multivariate Student density, so that their runs need not wait for each other; it is fitted
to the density first, in a few rounds of importance sampling. What is drawn is exact whatever the proposal; how well it
mixes is told by the share of proposals accepted and by R-hat. Source: Tierney (1994); Cappé and others (2004),
population Monte Carlo.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, logsumexp

from validation.conventions import Array

FREEDOM = 4.0
LEAST_ROUNDS, MOST_ROUNDS, ROUND = 3, 8, 100  # of fitting the proposal, and how many points each
ENOUGH = 0.4  # of a round's points that count: the proposal fits
WIDER = 1.1  # than what was found: a proposal must not be narrower than the density
LEAST_ACCEPTED, MOST_R_HAT = 0.1, 1.05

LogDensity = Callable[[Array], Array]


@dataclass(frozen=True)
class Chains:
    """Draws of some chains.

    Attributes
    ----------
    draws : (chains, draws, k)
    log_density : (chains, draws)
    accepted : share of proposals accepted
    r_hat : (k,) of each component, split chains
    """

    draws: Array
    log_density: Array
    accepted: float
    r_hat: Array

    @property
    def mixed(self) -> bool:
        """Whether the chains have mixed well enough to be used."""
        return self.accepted >= LEAST_ACCEPTED and bool(np.all(self.r_hat <= MOST_R_HAT))


@dataclass(frozen=True)
class _Student:
    """Multivariate Student density."""

    mean: Array
    root: Array

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        normal = rng.standard_normal((n, self.mean.size)) @ self.root.T
        return np.asarray(self.mean + normal / np.sqrt(rng.chisquare(FREEDOM, n) / FREEDOM)[:, None])

    def log_density(self, at: Array) -> Array:
        k = self.mean.size
        w = np.linalg.solve(self.root, (at - self.mean).T)
        head = gammaln(0.5 * (FREEDOM + k)) - gammaln(0.5 * FREEDOM) - np.log(np.diag(self.root)).sum()
        return np.asarray(head - 0.5 * (FREEDOM + k) * np.log1p((w**2).sum(axis=0) / FREEDOM))


def sample(log_density: LogDensity, size: int, chains: int, draws: int, rng: np.random.Generator) -> Chains:
    """Draw from a density.

    Parameters
    ----------
    log_density : callable
        Log densities (n,) of points (n, size), but for a constant; minus infinity where there is none.
    size : number of components; in units in which the density is near a standard normal one
    chains, draws : how many chains, and draws of each
    rng : numpy.random.Generator
    """
    proposal = _Student(np.zeros(size), np.eye(size))
    for k in range(MOST_ROUNDS):
        at = proposal.draw(ROUND + 10 * size, rng)
        proposal, (start, log_start), counting = _fitted(proposal, at, log_density(at), chains, rng)
        if counting > ENOUGH and k + 1 >= LEAST_ROUNDS:
            break
    flat = proposal.draw(chains * draws, rng)
    log_flat = log_density(flat)
    weight = (log_flat - proposal.log_density(flat)).reshape(chains, draws)
    now, log_now = start, log_start
    weight_now = log_now - proposal.log_density(now)
    points, logs = flat.reshape(chains, draws, size), log_flat.reshape(chains, draws)
    out, out_log, taken = np.empty_like(points), np.empty_like(logs), 0
    for i in range(draws):
        accept = np.log(rng.random(chains)) < weight[:, i] - weight_now
        taken += int(accept.sum())
        now = np.where(accept[:, None], points[:, i], now)
        log_now, weight_now = np.where(accept, logs[:, i], log_now), np.where(accept, weight[:, i], weight_now)
        out[:, i], out_log[:, i] = now, log_now
    return Chains(out, out_log, taken / weight.size, r_hat(out))


def _fitted(
    proposal: _Student, at: Array, log_at: Array, chains: int, rng: np.random.Generator
) -> tuple[_Student, tuple[Array, Array], float]:
    """A proposal fitted to weighted points, points to start chains from, and the share of points that count."""
    weight = log_at - proposal.log_density(at)
    if not np.isfinite(weight).any():
        raise ValueError("sampling: no point of a round has a density; the start is no maximum")
    share = np.exp(weight - logsumexp(weight))
    known = share > 0.0
    mean = share[known] @ at[known]
    off = (at - mean)[known]
    spread = (off * share[known][:, None]).T @ off
    effective = 1.0 / float(np.sum(share**2))
    # few points that count say little of the width: it is mixed with the last one's
    trust = effective / (effective + 2.0 * mean.size)
    spread = trust * spread + (1.0 - trust) * proposal.root @ proposal.root.T
    chosen = rng.choice(len(at), size=chains, p=share)
    fitted = _Student(mean, WIDER * np.linalg.cholesky(spread))
    return fitted, (at[chosen], log_at[chosen]), effective / len(at)


def r_hat(draws: Array) -> Array:
    """R-hat (k,) of split chains (chains, draws, k): 1 where they agree."""
    half = draws.shape[1] // 2
    parts = np.concatenate([draws[:, :half], draws[:, half : 2 * half]])
    within = parts.var(axis=1, ddof=1).mean(axis=0)
    between = parts.mean(axis=1).var(axis=0, ddof=1)
    return np.asarray(np.sqrt((half - 1) / half + between / np.maximum(within, 1e-300)))
