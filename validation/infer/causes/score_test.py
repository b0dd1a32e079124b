"""Score test of all causes in the linear model, and its threshold by Monte Carlo under the fitted null hypothesis.

Residuals of n trials, r = X z + e with z ~ N(0, I), are turned into their mean and n - 1 orthonormal contrasts. The
noise model is that of the fit (`validation.infer.noise`): a contrast has the covariance B of what a trial has of its
own, the mean has B / n + S, where S is what all share. The trials' deviation, a variance component of B, is profiled
over a grid with its prior, with and without a cause. Source: Rao (1948).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from validation.conventions import Array
from validation.infer.blocks import Block
from validation.infer.hypotheses import Candidate
from validation.infer.noise import Sizes, null_covariances

DEVIATIONS = tuple(1e-3 * 10.0 ** (0.5 * k) for k in range(5))
"""Grid of each trial's deviation, relative to the response."""
DRAWS = 1999  # sessions under the null: ten lie beyond its 99.5 % point
LEVEL = 0.01  # probability that any cause is named where the null hypothesis holds
ODDS = 1.0 / LEVEL  # likelihood ratio from which a session tells one cause from another
PAIRED = 8  # causes, the best alone, that are paired with all others, or tried in place of one
CHUNK = 250  # draws at a time, for memory


def helmert(n: int) -> Array:
    """Matrix (n, n) that turns n values into their mean (first row) and n - 1 orthonormal contrasts."""
    out = np.zeros((n, n))
    out[0] = 1.0 / n
    for k in range(1, n):
        out[k, :k], out[k, k] = 1.0, -k
        out[k] /= np.sqrt(k * (k + 1.0))
    return out


class BalancedNoise:
    """The noise model (`noise.Sizes`) of like trials: covariances of their mean and of a contrast, for each deviation.

    Parameters
    ----------
    blocks : linear model of one trial of each condition, with the share of the trials that it stands for
    families : (p,) of its columns, see `noise.Sizes`
    scatter : (p,) declared standard deviations of the amounts of columns that are no laws between trials
    known : (p, k) root of the declared covariance of its columns' amounts
    trials : how many
    curved : (draws, n) changes of the predicted curve at drawn amounts, less those of the linear model
    """

    def __init__(
        self,
        blocks: Sequence[tuple[float, Block]],
        families: NDArray[np.intp],
        scatter: Array,
        known: Array,
        trials: int,
        curved: Array,
    ) -> None:
        self.trials = trials
        sizes = [Sizes.null(families, own) for own in DEVIATIONS]
        found = [(share, _covariances(block, sizes, scatter, known)) for share, block in blocks]
        own, laws, shared = (np.sum([share * parts[k] for share, parts in found], axis=0) for k in range(3))
        common = [_shared_columns(block, known) for _, block in blocks]
        middle = np.sum([share * columns for (share, _), columns in zip(blocks, common, strict=True)], axis=0)
        for (share, _), columns in zip(blocks, common, strict=True):  # what all share reads otherwise where a cause is
            laws = laws + share * (columns - middle) @ (columns - middle).T
        total = [each + laws + curved.T @ curved / len(curved) for each in own]
        self._inverse: dict[int, list[Array]] = {}
        self._own = [cholesky(c, lower=True) for c in own]
        self._shared = cholesky(shared, lower=True)
        self.between = [cholesky(b, lower=True) for b in total]
        self.mean = [cholesky(b / trials + shared, lower=True) for b in total]
        log_det = [
            (trials - 1) * np.log(np.diag(b)).sum() + np.log(np.diag(m)).sum()
            for b, m in zip(self.between, self.mean, strict=True)
        ]
        self.log_prior = np.array([size.log_prior() for size in sizes]) - np.array(log_det)

    def draw(self, k: int, count: int, rng: np.random.Generator, runs: Array) -> Array:
        """Draw ``count`` sessions of the null hypothesis, in which each trial deviates by the share `DEVIATIONS[k]` of
        the response and scatters as one of ``runs`` (draws, n): mean and contrasts (count, trials, n) of the residuals,
        all rad."""
        n = len(self._shared)
        each = rng.standard_normal((count, self.trials, n)) @ self._own[k].T
        each += runs[rng.integers(len(runs), size=(count, self.trials))]
        out = np.einsum("jt,dtn->djn", helmert(self.trials), each)
        out[:, 0] += rng.standard_normal((count, n)) @ self._shared.T
        return np.asarray(out)

    def whiten(self, k: int, turned: Array) -> Array:
        """Whitened copy of ``turned`` (trials, n, …), mean and contrasts over trials of residuals or columns, rad: in
        standard deviations of the noise in which trials deviate by `DEVIATIONS[k]`."""
        if k not in self._inverse:
            roots = self.mean[k], self.between[k]
            self._inverse[k] = [solve_triangular(root, np.eye(len(root)), lower=True) for root in roots]
        mean, between = self._inverse[k]
        columns = turned.reshape(*turned.shape[:2], -1)
        return np.concatenate([mean @ columns[:1], between @ columns[1:]]).reshape(turned.shape)

    def log_likelihoods(self, turned: Array) -> Array:
        """Log posterior of each of `DEVIATIONS`, but for a constant, at mean and contrasts (trials, n)."""
        squares = [np.sum(self.whiten(k, turned) ** 2) for k in range(len(DEVIATIONS))]
        return self.log_prior - 0.5 * np.array(squares)


def _covariances(block: Block, sizes: Sequence[Sizes], scatter: Array, known: Array) -> tuple[Array, Array, Array]:
    """Covariances of a trial: its random effects (sizes, n, n); its scatter, and what all trials share, (n, n)."""
    found = [null_covariances(block, size) for size in sizes]
    _, laws, shared = found[0]
    scattered, declared = block.moved * scatter, block.moved @ known
    own = np.array([each for each, _, _ in found])
    return own, laws + scattered @ scattered.T, shared + declared @ declared.T


def _shared_columns(block: Block, known: Array) -> Array:
    """Declared uncertainties (n, k) that all trials share, as a trial's curves answer them."""
    return np.hstack([block.moved @ known, block.instrument])


@dataclass(frozen=True)
class Threshold:
    """Points of the null distribution that the search exceeds with probability `LEVEL`, half of it for each."""

    single: float
    pair: float


class ScoreTest:
    """Twice the gain of log likelihood of causes, alone and in pairs, around one point.

    Parameters
    ----------
    noise : BalancedNoise
    columns : (n, p) derivatives of the predicted curve with respect to each source
    candidates : causes: a source with the share of it that each trial has
    """

    def __init__(self, noise: BalancedNoise, columns: Array, candidates: Sequence[Candidate]) -> None:
        self.noise, self.columns = noise, columns
        self.source = np.array([c.source for c in candidates], dtype=np.intp)
        weights = np.array([c.weights for c in candidates]).reshape(-1, noise.trials)
        self.weights = helmert(noise.trials) @ weights.T
        self._mean = [solve_triangular(root, columns, lower=True) for root in noise.mean]
        self._between = [solve_triangular(root, columns, lower=True) for root in noise.between]

    def gram(self, k: int) -> Array:
        """Products (P, P) of all candidates in standard uncertainties, with `DEVIATIONS[k]`."""
        at = np.ix_(self.source, self.source)
        w, mean, between = self.weights, self._mean[k], self._between[k]
        return np.asarray(np.outer(w[0], w[0]) * (mean.T @ mean)[at] + (w[1:].T @ w[1:]) * (between.T @ between)[at])

    def known_u(self, k: int) -> Array:
        """Standard uncertainty (p,) of each source's amount in one trial if all else is known, with `DEVIATIONS[k]`."""
        norm = np.linalg.norm(self._between[k], axis=0)
        return np.asarray(1.0 / np.maximum(norm, np.finfo(float).tiny))

    def group_alike(self, k: int, furthest: Array) -> dict[int, dict[int, float]]:
        """Group candidates with noise `DEVIATIONS[k]`: index of each one detectable at its largest amount ``furthest``
        (P,) -> indices of those that data cannot tell from it, with the amount of each that equals amount 1 of it.

        At the largest amounts that are looked at, ``furthest`` (P,), the likelihood ratio of one to none, or to the
        other, is below `ODDS`. Of a group, the one that shows most comes first.
        """
        gram = self.gram(k)
        own = np.diag(gram)
        largest = 0.5 * furthest[:, None] ** 2
        told = largest * (own[:, None] - gram**2 / np.maximum(own, np.finfo(float).tiny))
        alike = (told < np.log(ODDS)) & (np.log(ODDS) > told.T)
        free = largest[:, 0] * own > np.log(ODDS)
        groups: dict[int, dict[int, float]] = {}
        for i in np.argsort(-own, kind="stable"):
            if free[i]:
                free[i] = False
                others = np.flatnonzero(alike[i] & free)
                groups[int(i)] = {int(j): float(gram[i, j] / own[j]) for j in others}
                free[others] = False
        return groups

    def products(self, k: int, white: Array) -> Array:
        """Inner products (draws, P) of each candidate's whitened column with residuals ``white`` (draws, trials, n),
        which are mean and contrasts over trials whitened with `DEVIATIONS[k]`."""
        mean, between = white[:, 0] @ self._mean[k], white[:, 1:] @ self._between[k]
        apart = np.einsum("jc,djc->dc", self.weights[1:], between[:, :, self.source])
        return np.asarray(self.weights[0] * mean[:, self.source] + apart)

    def gains(self, turned: Array, held: Sequence[int] = (), z: Array | None = None) -> tuple[Array, int]:
        """Score statistic (P,), twice the gain in log posterior, of each candidate beside those ``held`` (indices) at
        amounts ``z``, 0 of these, and the index in `DEVIATIONS` that is likeliest with the best; ``turned`` (trials,
        n): mean and contrasts of residuals. The deviation is the likeliest with the candidate, and without."""
        z = np.zeros(len(held)) if z is None else z
        without, beside = [], []
        for k, likelihood in enumerate(self.noise.log_likelihoods(turned)):
            gram, b = self.gram(k), self.products(k, self.noise.whiten(k, turned)[None])[0]
            gram, b, at = _condition_on(gram, b, held, z)
            gain = b**2 / (1.0 + np.maximum(np.diag(gram), 0.0))
            gain[list(held)] = 0.0  # a second copy of a cause would halve the penalty of its prior
            without.append(likelihood + 0.5 * at)
            beside.append(without[-1] + 0.5 * gain)
        found = 2.0 * (np.max(beside, axis=0) - max(without))
        return found, int(np.argmax(np.max(beside, axis=1)))

    def statistics(self, turned: Array) -> tuple[float, float]:
        """The largest score statistics, as `find_threshold` has them in drawn sessions, of one cause and of a pair."""
        every = range(len(DEVIATIONS))
        one, two = self._search(turned[None], every, {k: self.gram(k) for k in every})
        return float(one[0]), float(two[0])

    def find_threshold(self, turned: Array, runs: Array, seed: int = 0) -> Threshold:
        """Thresholds of the score statistic of one cause and of a pair, by Monte Carlo: the search repeated in `DRAWS`
        sessions of the null hypothesis fitted to ``turned`` (trials, n), mean and contrasts of residuals, whose trials
        scatter as ``runs`` (draws, n); rad."""
        noise, rng = self.noise, np.random.default_rng(seed)
        posterior = noise.log_likelihoods(turned)
        posterior = np.exp(posterior - posterior.max())
        true = rng.choice(len(DEVIATIONS), DRAWS, p=posterior / posterior.sum())
        sizes = [int(k) for k in np.flatnonzero(posterior > 1e-6)]
        grams = {k: self.gram(k) for k in sizes}
        singles, pairs = [], []
        for k in np.unique(true):
            for count in _chunks(int(np.sum(true == k))):
                one, two = self._search(noise.draw(int(k), count, rng, runs), sizes, grams)
                singles.append(one)
                pairs.append(two)
        share = 1.0 - 0.5 * LEVEL
        return Threshold(
            float(np.quantile(np.concatenate(singles), share)), float(np.quantile(np.concatenate(pairs), share))
        )

    def _search(self, drawn: Array, sizes: Sequence[int], grams: dict[int, Array]) -> tuple[Array, Array]:
        """Largest gains (draws,), twice the log posterior, of one cause and of two in sessions ``drawn`` (draws,
        trials, n), mean and contrasts; ``sizes``: indices in `DEVIATIONS` to choose among, ``grams``: `gram` of each.
        """
        noise, ends = self.noise, []
        for k in sizes:
            again = np.moveaxis(noise.whiten(k, np.moveaxis(drawn, 0, -1)), -1, 0)
            null = noise.log_prior[k] - 0.5 * np.sum(again**2, axis=(1, 2))
            b, gram = self.products(k, again), grams[k]
            gain = b**2 / (1.0 + np.diag(gram))
            ends.append((null, gain.max(axis=1), pair_gains(gram, b)))
        base = np.max([null for null, _, _ in ends], axis=0)
        one = np.max([null + 0.5 * single for null, single, _ in ends], axis=0)
        two = np.max([null + 0.5 * pair for null, _, pair in ends], axis=0)
        return 2.0 * (one - base), 2.0 * (two - base)


def pair_gains(gram: Array, b: Array) -> Array:
    """Largest gain (draws,), twice the log posterior, of two causes, one of them among the `PAIRED` best: ``gram`` (P,
    P) are inner products of the candidates' whitened columns, ``b`` (draws, P) those with the residuals."""
    own = 1.0 + np.diag(gram)
    gain = b**2 / own
    first = np.argsort(-gain, axis=1)[:, :PAIRED]
    lead, across = np.take_along_axis(b, first, axis=1), gram[first]  # (draws, M), (draws, M, P)
    left = own - across**2 / own[first][:, :, None]
    more = (b[:, None, :] - across * (lead / own[first])[:, :, None]) ** 2 / np.maximum(left, 1.0)
    np.put_along_axis(more, first[:, :, None], 0.0, axis=2)  # a cause beside itself
    return np.asarray((np.take_along_axis(gain, first, axis=1) + more.max(axis=2)).max(axis=1))


def _chunks(count: int) -> list[int]:
    return [CHUNK] * (count // CHUNK) + [count % CHUNK] * bool(count % CHUNK)


def _condition_on(gram: Array, b: Array, held: Sequence[int], z: Array) -> tuple[Array, Array, float]:
    """Copies of ``gram`` (P, P) and products ``b`` (P,) without what the candidates ``held`` (indices) at amounts ``z``
    explain, and twice the log posterior that an update of z gains; unchanged, and 0, where none is held."""
    if not held:
        return gram, b, 0.0
    inner = gram[np.ix_(held, held)] + np.eye(len(held))
    slope = b[list(held)] - z  # zero where they have converged
    solved = np.linalg.solve(inner, np.column_stack([gram[held], slope]))
    return gram - gram[:, held] @ solved[:, :-1], b - gram[:, held] @ solved[:, -1], float(slope @ solved[:, -1])
