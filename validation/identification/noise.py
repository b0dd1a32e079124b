"""What a difference between model and trial may be made of, and how large each part is, learnt from all trials.

Three kinds beside the sensors' own noise, each as large as the trials themselves say (largest marginal likelihood):
the laws of the action scatter from trial to trial (`Sizes.scatter`); curves of a trial wander by themselves (``own``);
and all trials of a session differ from the model alike (``common``: the discrepancy, what the model lacks). The last
two are Gaussian processes over time with exponential correlation, as large where the action responds as `Block.size`
says: a fraction of what all laws together could do. Source: Kennedy and O'Hagan (2001); variance components by the
fixed point of MacKay (1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from validation.conventions import Array
from validation.identification.blocks import INSTRUMENT, Block

CORRELATED_S = 0.01  # where learning starts
SCATTER, OWN, COMMON = 0.1, 0.03, 0.3  # where learning starts
LEAST = 1e-6
USUAL, BELIEVED = 0.07, 1.0  # scatter of a law from trial to trial (2 % of 30 %), believed as much as one trial
FORMS_S = (3e-3, 1e-2, 3e-2, 0.1)
"""Correlation times tried for what the model lacks; the likeliest is taken."""
FLOOR = 5e-3  # of the response: no model is taken to be closer, and no linear model of it is
LEAST_DAMPING = 0.03
MOST_BOUNDS = 8  # rounds in which values are held at the ends of what is allowed
CHANGE = 10.0  # of a size squared in one round, at most


@dataclass(frozen=True)
class Sizes:
    """Sizes of the parts of a difference.

    Attributes
    ----------
    scatter : (p + h,) standard deviation from trial to trial, of what moves and of fixed laws, in prior standard
        uncertainties; 0 where it is no law
    own : (sessions, channels) of a trial's own wandering, of the size of the response; 0 where it is not measured
    common : (sessions, channels) of the discrepancy, of the size of the response
    correlated_s : time over which own wandering and discrepancy are correlated
    """

    scatter: Array
    own: Array
    common: Array
    correlated_s: float = CORRELATED_S

    @staticmethod
    def start(laws: Array, seen: Array) -> Sizes:
        """Sizes to start learning from; ``seen`` (sessions, channels) is 1 where a session has a channel, else 0."""
        return Sizes(np.where(laws, SCATTER, 0.0), OWN * seen, COMMON * seen)

    @staticmethod
    def tight(laws: Array, seen: Array) -> Sizes:
        """Sizes with next to no discrepancy, which pull values to the data wherever they stand."""
        return Sizes(np.where(laws, USUAL, 0.0), FLOOR * seen, 2.0 * FLOOR * seen)


def kernel_root(block: Block, channel: int, correlated_s: float) -> Array:
    """Root (m, m) of the correlation of a Gaussian process over the phases, times the size of the response."""
    t = block.time_s
    k = np.exp(-np.abs(t[:, None] - t[None, :]) / correlated_s)
    return np.asarray(block.size[channel][:, None] * cholesky(k + 1e-9 * np.eye(t.size), lower=True))


class Marginal:
    """Gaussian model of all trials with given sizes: everything linear taken out in closed form.

    Parameters
    ----------
    blocks : sequence of Block
    sizes : Sizes

    Attributes
    ----------
    curvature : (p, p) half the second derivative of the objective with respect to z
    """

    def __init__(self, blocks: Sequence[Block], sizes: Sizes) -> None:
        self.blocks, self.sizes = list(blocks), sizes
        self.p = blocks[0].moved.shape[1]
        self.shared = self.p + len(INSTRUMENT)
        first = {b.session: b for b in reversed(self.blocks)}
        self.phases = {s: first[s].time_s.size for s in sorted(first)}
        self.channels = {s: first[s].channels for s in self.phases}
        starts, at = {}, self.shared
        for s, m in self.phases.items():
            starts[s], at = at, at + len(self.channels[s]) * m
        self.starts, self.q = starts, at
        self.roots = {
            s: [kernel_root(b, c, sizes.correlated_s) for c in range(len(b.channels))] for s, b in first.items()
        }
        self.white = [self._whiten(b) for b in self.blocks]
        self.precision = np.eye(self.q)
        for (_, x), b in zip(self.white, self.blocks, strict=True):
            mine = self.columns_of(b.session)
            self.precision[np.ix_(mine, mine)] += x.T @ x
        self.covariance = np.asarray(cho_solve(cho_factor(self.precision), np.eye(self.q)))
        self._rest = cho_factor(self.precision[self.p :, self.p :])
        across = self.precision[: self.p, self.p :]
        self.curvature = self.precision[: self.p, : self.p] - across @ cho_solve(self._rest, across.T)

    def columns_of(self, session: int) -> NDArray[np.intp]:
        """Indices of the columns that a trial of this session has."""
        a = self.starts[session]
        own = np.arange(a, a + len(self.channels[session]) * self.phases[session])
        return np.concatenate([np.arange(self.shared), own])

    def design(self, b: Block) -> Array:
        """Columns (3 m, …) of one trial: moved, instrument, discrepancy of its session."""
        m = b.time_s.size
        lacking = np.zeros((len(b.channels) * m, len(b.channels) * m))
        for c, which in enumerate(b.channels):
            part = slice(c * m, (c + 1) * m)
            lacking[part, part] = self.sizes.common[b.session, which] * self.roots[b.session][c]
        return np.hstack([b.moved, b.instrument, lacking])

    def _whiten(self, b: Block) -> tuple[Array, Array]:
        m = b.time_s.size
        scattered = np.hstack([b.moved, b.held]) * self.sizes.scatter
        own = np.diag(b.white) + scattered @ scattered.T + b.own @ b.own.T
        for c, which in enumerate(b.channels):
            part, root = slice(c * m, (c + 1) * m), self.roots[b.session][c]
            own[part, part] += self.sizes.own[b.session, which] ** 2 * (root @ root.T)
        lower = cholesky(own, lower=True)
        return lower, np.asarray(solve_triangular(lower, self.design(b), lower=True))

    def _projected(self, residuals: Sequence[Array]) -> tuple[Array, float]:
        """Xᵀ C⁻¹ r (q,) and rᵀ C⁻¹ r."""
        b, square = np.zeros(self.q), 0.0
        for (lower, x), r, block in zip(self.white, residuals, self.blocks, strict=True):
            w = solve_triangular(lower, r, lower=True)
            b[self.columns_of(block.session)] += x.T @ w
            square += float(w @ w)
        return b, square

    def mean(self, residuals: Sequence[Array]) -> Array:
        """Most probable value (q,) of every column, given residuals at z = 0 of the linear model."""
        return np.asarray(self.covariance @ self._projected(residuals)[0])

    def slope(self, residuals: Sequence[Array], z: Array) -> Array:
        """Half the negative derivative (p,) of the objective at z, given residuals there."""
        b, _ = self._projected(residuals)
        across = self.precision[: self.p, self.p :]
        return np.asarray(b[: self.p] - across @ cho_solve(self._rest, b[self.p :]) - z)

    def objective(self, residuals: Sequence[Array], z: Array) -> float:
        """Twice the negative log posterior at z, but for a constant; residuals at z, everything else taken out."""
        b, square = self._projected(residuals)
        rest = b[self.p :]
        return square - float(rest @ cho_solve(self._rest, rest)) + float(z @ z)

    def log_likelihood(self, residuals: Sequence[Array]) -> float:
        """Log marginal likelihood of residuals at z = 0 of the linear model, but for a constant."""
        b, square = self._projected(residuals)
        log_det = 2.0 * sum(float(np.log(np.diag(lower)).sum()) for lower, _ in self.white)
        log_det += float(np.linalg.slogdet(self.precision)[1])
        return -0.5 * (square - float(b @ self.covariance @ b) + log_det)

    def learnt(self, residuals: Sequence[Array], floor: float = FLOOR) -> Sizes:
        """Sizes after one round of learning from residuals at z = 0 of the linear model, none below the floor."""
        mean = self.mean(residuals)
        common = self.sizes.common.copy()
        variance = np.diag(self.covariance)
        for s, m in self.phases.items():
            for c, which in enumerate(self.channels[s]):
                a = self.starts[s] + c * m
                part = slice(a, a + m)
                common[s, which] *= _factor(float(mean[part] @ mean[part]), m - float(variance[part].sum()))
        found, expected = np.zeros(self.sizes.scatter.size), np.zeros(self.sizes.scatter.size)
        own = np.zeros((2, *self.sizes.own.shape))
        for (lower, x), r, b in zip(self.white, residuals, self.blocks, strict=True):
            mine, m = self.columns_of(b.session), b.time_s.size
            left = solve_triangular(lower, r, lower=True) - x @ mean[mine]
            score = solve_triangular(lower, left, lower=True, trans="T")  # V⁻¹ r of this trial
            back = solve_triangular(lower, np.hstack([np.eye(lower.shape[0]), x]), lower=True, trans="T")
            n = lower.shape[0]
            inverse, q = solve_triangular(lower, np.eye(n), lower=True), back[:, n:]
            p = inverse.T @ inverse - q @ self.covariance[np.ix_(mine, mine)] @ q.T
            laws = np.hstack([b.moved, b.held])
            found += (laws.T @ score) ** 2
            expected += np.einsum("ij,ij->j", laws, p @ laws)
            for c, which in enumerate(b.channels):
                part, root = slice(c * m, (c + 1) * m), self.roots[b.session][c]
                own[0, b.session, which] += float(((root.T @ score[part]) ** 2).sum())
                own[1, b.session, which] += float(np.einsum("ij,ij->", root, p[part, part] @ root))
        now = np.maximum(self.sizes.scatter, LEAST) ** 2
        found, expected = found + BELIEVED * USUAL**2 / now**2, expected + BELIEVED / now
        scatter = self.sizes.scatter * np.array([_factor(f, e) for f, e in zip(found, expected, strict=True)])
        shape = self.sizes.own.shape
        wander = np.array([_factor(f, e) for f, e in zip(own[0].ravel(), own[1].ravel(), strict=True)])
        return replace(
            self.sizes,
            scatter=np.where(self.sizes.scatter > 0, np.maximum(scatter, LEAST), 0.0),
            own=np.maximum(self.sizes.own * wander.reshape(shape), LEAST),
            common=np.where(self.sizes.common > 0.0, np.maximum(common, floor), 0.0),
        )


def box_step(marginal: Marginal, here: Sequence[Array], z: Array, box: tuple[Array, Array], damping: float) -> Array:
    """Step (p,) to the minimum of the linear model in a box, shortened by Marquardt's damping.

    Parameters
    ----------
    marginal : Marginal
        The linear model at z.
    here : residuals at z, of each trial
    z : (p,)
    box : lowest and highest z
    damping : of the diagonal of the curvature, that is added to it
    """
    low, high = box
    slope, curvature = marginal.slope(here, z), marginal.curvature
    damped = curvature + damping * np.diag(np.diag(curvature))
    free, step = np.ones(z.size, dtype=bool), np.zeros(z.size)
    for _ in range(MOST_BOUNDS):
        rest = slope[free] - damped[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(damped[np.ix_(free, free)], rest)
        out = free & ((z + step < low) | (z + step > high))
        if not out.any():
            break
        step[out] = np.clip(z + step, low, high)[out] - z[out]
        free &= ~out
    return np.clip(z + step, low, high) - z


def largest_step(marginal: Marginal, here: Sequence[Array], z: Array, box: tuple[Array, Array], asked: int) -> float:
    """Largest change of an asked parameter in the whole step from z, in its posterior standard uncertainties."""
    width = np.sqrt(np.diag(marginal.covariance)[: marginal.p])
    return float(np.max((np.abs(box_step(marginal, here, z, box, 0.0)) / width)[:asked]))


def dampings(last: float) -> list[float]:
    """Dampings to try in turn."""
    first = max(last, LEAST_DAMPING)
    return [last] + [first * 10.0**k for k in range(0 if last < LEAST_DAMPING else 1, 5)]


def _factor(found: float, expected: float) -> float:
    """Factor of a standard deviation whose square was found and was expected to be so large."""
    if not expected > 0.0:
        return 1.0
    return float(np.sqrt(np.clip(found / expected, 1.0 / CHANGE, CHANGE)))


def learn(
    blocks: Sequence[Block], residuals: Sequence[Array], sizes: Sizes, rounds: int, floor: float = FLOOR
) -> Marginal:
    """The model with sizes learnt in so many rounds, fewer when they no longer change."""
    marginal = Marginal(blocks, sizes)
    for _ in range(rounds):
        new = marginal.learnt(residuals, floor)
        marginal, old = Marginal(blocks, new), marginal.sizes
        if all(np.allclose(a, b, rtol=0.03, atol=1e-4) for a, b in ((new.own, old.own), (new.common, old.common))):
            break
    return marginal


def likeliest(
    blocks: Sequence[Block], residuals: Sequence[Array], sizes: Sizes, rounds: int, floor: float = FLOOR
) -> Marginal:
    """The model with sizes learnt for each of `FORMS_S`, of largest marginal likelihood."""
    tried = [learn(blocks, residuals, replace(sizes, correlated_s=t), rounds, floor) for t in FORMS_S]
    return max(tried, key=lambda m: m.log_likelihood(residuals))
