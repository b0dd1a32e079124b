"""Intervals of the model error, and the simultaneous test, from draws of all uncertain inputs: pure functions.

In: an `ErrorSample`, quantities by draws. Out: `Estimates`. Source: ASME V&V 20-2009, E = δ + e: the comparison error E
(model − trial) is the model error δ and an error e of inputs and measurement. A draw is what E would be with δ = 0, so
that E and N draws are exchangeable if the model is right: whatever the form of their distribution, the interval
E − e₍ₖ₎ holds δ at its level, and a statistic of rank k is exceeded at its level (Monte Carlo test, Besag and Clifford
1989). A standard uncertainty is half the central 68 %: a few draws far away do not widen it. The simultaneous test
measures each quantity in the distance from its median to the end of its central 95 %, each side by itself, so that a
quantity whose draws have a long tail does not decide alone how far all others must lie.
What differs between trials is one variance component, scaled inverse χ²: the declared one counts as `PRIOR_FREEDOM`
degrees of freedom, the trials add n − 1 (Gelman et al., Bayesian Data Analysis, 3rd ed., Section 3.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from validation.conventions import CONFIDENCE, LEVEL, Array

EQUIVALENCE = 1.0 - 2.0 * LEVEL  # coverage of an interval inside a limit: two one-sided tests of `LEVEL` each
LEAST_SHARE = 0.2  # of the variance of a quantity, from which an input is named for it: choice
POWER = 0.80  # at which an error counts as detectable: usual in the planning of tests
PRIOR_FREEDOM = 3.0  # few, so that six trials outweigh what is declared; one trial has Student's factor 3.2
FEWEST_FOR_INTERVAL = round(2.0 / LEVEL) - 1  # so that 95 % lie within the extreme ranks
FEWEST_FOR_BRANCH = round(1.0 / LEVEL)  # so that a rank of the level is among them
RARE_BRANCH = LEVEL / 2  # of the level of the simultaneous test, what branches of the motion may take
SIGMA = 0.158655  # of a normal distribution below −σ
TAIL = 0.5 * (1.0 - CONFIDENCE)
WINSOR = 4.0  # scales beyond which a draw counts as that far when variances are divided among inputs
SEED = 20


@dataclass(frozen=True)
class ErrorSample:
    """Comparison errors of V quantities, found and drawn."""

    found: Array  # (V,), mean over trials of model − trial, NaN where not known
    n_trials: NDArray[np.int64]  # (V,), trials that each mean is of
    residuals: Array  # (n, V), of each trial from that mean, NaN where not known
    common: Array  # (N, V), errors as drawn, of what is common to all trials
    own: Array  # (K, V), errors as drawn, of what each trial has for itself as declared
    condition: NDArray[np.int64]  # (V,), place of the condition that each quantity is of
    branch: NDArray[np.int64]  # (N, P), branch of the motion of each draw in each condition, as a number
    branch_found: NDArray[np.int64]  # (P,), that of the trials; need not occur in ``branch``
    inputs: Array  # (N, q), drawn values of the inputs, standard normal
    floor: Array  # (V,), smallest scale
    primary: NDArray[np.bool_]  # (V,), quantities of the claim


@dataclass(frozen=True)
class Estimates:
    """What is estimated of each quantity, (V,) each unless said otherwise; NaN where it cannot be stated."""

    # low, high: ends of the individual 95 % interval of the model error
    low: Array
    high: Array
    # low_90, high_90: ends of the 90 % interval
    low_90: Array
    high_90: Array
    u: Array  # standard uncertainty of the comparison error, robust
    u_repeat: Array  # that from what differs between trials
    u_inputs: Array  # (q, V) from each input
    u_other: Array  # from inputs that ``inputs`` do not list
    ratio: Array  # |E − median of the draws| over the distance of the end of their central 95 % on its side
    ratio_limit: float  # ratio that the largest one exceeds in 5 % of sessions of models without error
    resolved: NDArray[np.bool_]  # whether the simultaneous test resolves this quantity
    # detectable_low, detectable_high: least error of either sign that is resolved in 80 % of sessions
    detectable_low: Array
    detectable_high: Array
    p: float  # of the simultaneous test
    n_draws: NDArray[np.int64]  # (P,), draws on the branch that was observed in each condition
    share: Array  # (P,), of the draws on that branch
    is_branch_resolved: bool  # whether the branch itself is what a model without error hardly ever does

    @property
    def alone(self) -> NDArray[np.bool_]:
        """Whether only the individual interval excludes an error of zero."""
        return ((self.low > 0) | (self.high < 0)) & ~self.resolved


def estimate_errors(sample: ErrorSample) -> Estimates:
    """Intervals of the model error (model − trial) of each quantity of a sample, what they come from and which error is
    detectable, and a simultaneous test of all primary quantities and of the branch of the motion."""
    n_all = len(sample.common)
    rng = np.random.default_rng([SEED, n_all, len(sample.found)])
    noise, u_repeat = draw_trial_scatter(sample.residuals, sample.own, sample.n_trials, n_all, rng)
    on_branch = sample.branch == sample.branch_found
    common = np.where(on_branch[:, sample.condition], sample.common, np.nan)
    drawn = common + noise
    middle, lower, upper = pooled_scale(drawn, sample.found, sample.floor)
    _, below, above = pooled_scale(drawn, sample.found, sample.floor, TAIL)
    inside = drawn[on_branch.all(axis=1)]  # every condition as observed
    n = len(inside)
    reached = side_ratio(sample.found, middle, below, above)
    rare, p_branch = rare_branches(sample.branch, sample.branch_found)
    largest = _largest(side_ratio(inside, middle, below, above)[:, sample.primary])
    ranked = np.concatenate([largest, np.full(int(rare.sum()), np.inf)])
    limit = quantile_by_rank(ranked, 1.0 - LEVEL) if n >= FEWEST_FOR_BRANCH else np.nan
    found_largest = float(_largest(reached[None, sample.primary])[0])
    is_branch_resolved = p_branch <= RARE_BRANCH
    at_least = n_all if is_branch_resolved else int((ranked >= found_largest).sum())
    p = p_branch if is_branch_resolved or n < FEWEST_FOR_BRANCH else (1 + at_least) / (ranked.size + 1)
    shares, other = divide_variance(common, sample.inputs, middle, lower, upper)
    with np.errstate(invalid="ignore"):
        resolved = sample.primary & (reached > limit)
    detectable = detectable_errors(drawn, middle, below, above, float(limit))
    low, high = interval_by_rank(sample.found, drawn, CONFIDENCE)
    low_90, high_90 = interval_by_rank(sample.found, drawn, EQUIVALENCE)
    return Estimates(
        low=low,
        high=high,
        low_90=low_90,
        high_90=high_90,
        u=np.where(np.isfinite(low), 0.5 * (lower + upper), np.nan),
        u_repeat=u_repeat,
        u_inputs=shares,
        u_other=other,
        ratio=reached,
        ratio_limit=float(limit),
        resolved=resolved,
        detectable_low=detectable[0],
        detectable_high=detectable[1],
        p=float(p),
        n_draws=on_branch.sum(axis=0),
        share=on_branch.sum(axis=0) / n_all if n_all else np.full(on_branch.shape[1], np.nan),
        is_branch_resolved=bool(is_branch_resolved),
    )


def draw_trial_scatter(
    residuals: Array, own: Array, n_trials: NDArray[np.int64], n_draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Draws (n_draws, V) of the mean random error of ``n_trials`` (V,) trials, and its standard deviation (V,): pooled
    from the trials' ``residuals`` (n, V) and from errors ``own`` (K, V) drawn of one trial as declared; NaN where not
    known.

    Random combinations of the trials' residuals and of the declared errors, so that quantities stay correlated.
    """
    known = np.isfinite(own).sum(axis=0)
    declared = np.where(np.isfinite(own), own - _nan_mean(own), 0.0) / np.sqrt(np.maximum(known - 1, 1))
    seen = np.nan_to_num(residuals)
    freedom = PRIOR_FREEDOM + np.maximum(n_trials - 1, 0)
    variance = (PRIOR_FREEDOM * (declared**2).sum(axis=0) + (seen**2).sum(axis=0)) / freedom
    combined = np.sqrt(PRIOR_FREEDOM) * rng.standard_normal((n_draws, len(declared))) @ declared
    combined += rng.standard_normal((n_draws, len(seen))) @ seen
    # start-up: `scipy.stats.chi2` loads for half a second
    chi_square = 2.0 * gammaincinv(0.5 * freedom, rng.uniform(size=(n_draws, 1)))
    student = np.sqrt(freedom / chi_square)
    count = np.sqrt(np.maximum(n_trials, 1))
    return combined * student / np.sqrt(freedom) / count, np.sqrt(variance) / count


def pooled_scale(drawn: Array, found: Array, floor: Array, tail: float = SIGMA) -> tuple[Array, Array, Array]:
    """Median of ``found`` (V,) and ``drawn`` (N, V) together, and its distances, positive, to their lower and upper
    quantile ``tail``, ``floor`` (V,) at least: (V,) each. The median is NaN where all are.

    What was found is one of N + 1 exchangeable values: a scale of the draws alone would favour it.
    """
    every = np.vstack([drawn, found[None]])
    enough = np.isfinite(every).any(axis=0)
    low, middle, high = np.full((3, len(found)), np.nan)
    if enough.any():
        low[enough], middle[enough], high[enough] = np.nanquantile(
            every[:, enough], [tail, 0.5, 1.0 - tail], axis=0, method="linear"
        )
    return middle, np.fmax(middle - low, floor), np.fmax(high - middle, floor)


def side_ratio(values: Array, middle: Array, lower: Array, upper: Array) -> Array:
    away = values - middle
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.abs(away) / np.where(away > 0, upper, lower))


def _largest(ratio: Array) -> Array:
    """Largest value (N,) of each row, skipping NaN; −inf where all are NaN."""
    filled = np.where(np.isfinite(ratio), ratio, -np.inf)
    return np.asarray(filled.max(axis=1, initial=-np.inf))


def quantile_by_rank(drawn: Array, share: float) -> float:
    """Value that one more draw exceeds with a probability of 1 − ``share`` at most."""
    rank = int(np.ceil(share * (drawn.size + 1) - 1e-9))
    return float(np.sort(drawn)[rank - 1]) if 1 <= rank <= drawn.size else float("inf")


def interval_by_rank(found: Array, drawn: Array, share: float) -> tuple[Array, Array]:
    """Lower and upper ends (V,) of intervals of coverage ``share`` for the model errors, from the errors ``found`` (V,)
    and draws of them without a model error, ``drawn`` (N, V); NaN with fewer than 39 finite draws."""
    low, high = np.full((2, found.size), np.nan)
    for v in range(found.size):
        known = np.sort(drawn[np.isfinite(drawn[:, v]), v])
        rank = int(np.floor(0.5 * (1.0 - share) * (known.size + 1) + 1e-9))
        if known.size >= FEWEST_FOR_INTERVAL and rank >= 1:
            low[v], high[v] = found[v] - known[known.size - rank], found[v] - known[rank - 1]
    return low, high


def rare_branches(branch: NDArray[np.int64], found: NDArray[np.int64]) -> tuple[NDArray[np.bool_], float]:
    """Mask (N,) of draws whose branches of motion are rare, and p of the branches ``found`` (P,): the share of draws on
    branches as rare as these. ``branch`` (N, P): of each draw in each of P conditions, which together are one outcome.
    """
    every = np.vstack([branch, found])
    _, place, counts = np.unique(every, axis=0, return_inverse=True, return_counts=True)
    as_rare = np.array([counts[counts <= own].sum() for own in counts]) / len(every)
    p = as_rare[place.ravel()]
    return np.asarray(p[:-1] <= RARE_BRANCH), float(p[-1])


def detectable_errors(drawn: Array, middle: Array, lower: Array, upper: Array, limit: float) -> Array:
    """Least negative and least positive model error, (2, V), that the test resolves in 80 % of sessions: draws (N, V),
    moved by it, beyond ``limit`` times the scale ``lower`` or ``upper`` (V,) from ``middle`` (V,). NaN where not known.
    """
    out = np.full((2, middle.size), np.nan)
    known = np.isfinite(drawn).any(axis=0)
    if not np.isfinite(limit) or not known.any():
        return out
    least, most = np.nanquantile(drawn[:, known], [1.0 - POWER, POWER], axis=0)
    out[0, known] = middle[known] - limit * lower[known] - most
    out[1, known] = middle[known] + limit * upper[known] - least
    return out


def divide_variance(errors: Array, inputs: Array, middle: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Standard uncertainty that each drawn input (N, q) makes of the ``errors`` (N, V), as (q, V), and that of what is
    left, (V,), by linear regression; errors farther than four ``lower`` or ``upper`` (V,) from ``middle`` (V,) count as
    that far.

    Regression on the inputs; of its squared slopes their own uncertainty is taken off.
    """
    n, q = inputs.shape
    varied = int((np.ptp(inputs, axis=0) > 0.0).sum()) if n else 0
    v = errors.shape[1] if errors.ndim == 2 else 0
    slopes, other = np.zeros((q, v)), np.full(v, np.nan)
    if n < FEWEST_FOR_INTERVAL:
        return np.full((q, v), np.nan), other
    design = np.column_stack([np.ones(n), inputs])
    for k in range(v):
        known = np.isfinite(errors[:, k])
        if known.sum() < max(FEWEST_FOR_INTERVAL, 2 * (varied + 1)) or not np.isfinite(middle[k]):
            continue
        ends = middle[k] - WINSOR * lower[k], middle[k] + WINSOR * upper[k]
        y = np.clip(errors[known, k], *ends)
        x = design[known]
        beta, *_ = np.linalg.lstsq(x, y, rcond=None)
        left = float(((y - x @ beta) ** 2).sum()) / (y.size - varied - 1)
        variance = np.diag(np.linalg.pinv(x.T @ x)) * left
        slopes[:, k] = np.sqrt(np.maximum(beta[1:] ** 2 - variance[1:], 0.0))
        other[k] = np.sqrt(left)
    return slopes, other


def strongest_inputs(errors: Array, inputs: Array, names: Sequence[str]) -> list[str]:
    """For each column of ``errors`` (N, V) the name of the column of ``inputs`` (N, q) with the largest squared rank
    correlation, empty where that is below 0.2 or there are fewer than 39 draws; ``names``: of the q inputs."""
    known = np.isfinite(errors)
    enough = known.sum(axis=0) >= FEWEST_FOR_INTERVAL
    if not len(names) or not enough.any():
        return [""] * errors.shape[1]
    rank = np.argsort(np.argsort(np.where(known, errors, np.inf), axis=0), axis=0).astype(float)
    ranks = np.argsort(np.argsort(inputs, axis=0), axis=0).astype(float)
    count = np.maximum(known.sum(axis=0), 1)
    rank = np.where(known, rank - np.where(known, rank, 0.0).sum(axis=0) / count, 0.0)
    mean = known.T @ ranks / count[:, None]  # (V, q), of the draws known
    square = np.maximum(known.T @ ranks**2 - count[:, None] * mean**2, 1e-9)
    share = (rank.T @ ranks) ** 2 / (np.maximum((rank**2).sum(axis=0), 1e-9)[:, None] * square)
    best = np.argmax(share, axis=1)
    return [names[b] if ok and s[b] >= LEAST_SHARE else "" for b, ok, s in zip(best, enough, share, strict=True)]


def _nan_mean(values: Array) -> Array:
    known = np.isfinite(values)
    return np.asarray(np.where(known, values, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
