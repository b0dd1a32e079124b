"""Gaussian model of all trials with given sizes: everything linear taken out in closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky
from scipy.linalg.lapack import dtrtrs

from validation.conventions import Array
from validation.identification.blocks import INSTRUMENT, Block
from validation.identification.noise.parts import TINY, Columns, common_parts, own_parts, reached
from validation.identification.noise.sizes import Sizes

Parts = tuple[Mapping[int, Columns], Sequence[Columns]]


def parts_of(blocks: Sequence[Block], sizes: Sizes) -> Parts:
    """Columns of the discrepancy by session, and of what each trial has of its own; no size enters."""
    sessions = sorted({b.session for b in blocks})
    common = {s: common_parts([b for b in blocks if b.session == s], sizes) for s in sessions}
    return common, [own_parts(b, sizes) for b in blocks]


def solved(lower: Array, right: Array) -> Array:
    """Solution x of ``lower x = right``, ``lower`` of `scipy.linalg.cholesky`.

    LAPACK's, as `scipy.linalg.solve_triangular` calls it; its checks take as long as the small systems here.
    """
    return np.asarray(dtrtrs(lower, right, lower=1)[0])


class Marginal:
    """The model of all trials.

    Parameters
    ----------
    blocks : sequence of Block
    sizes : Sizes
    parts : as of `parts_of` with the same blocks, if known already
    """

    def __init__(self, blocks: Sequence[Block], sizes: Sizes, parts: Parts | None = None) -> None:
        self.blocks, self.sizes = list(blocks), sizes
        self.parts = parts_of(blocks, sizes) if parts is None else parts
        self.p = blocks[0].moved.shape[1]
        self.shared = self.p + len(INSTRUMENT)
        size = np.exp(sizes.log())
        self.starts: dict[int, int] = {}
        self.roots: dict[int, Array] = {}
        at = self.shared
        for s, common in self.parts[0].items():
            covariance = common.covariance(size)
            lift = TINY * np.diag(covariance) + 1e-30
            self.roots[s] = cholesky(covariance + np.diag(lift), lower=True)
            self.starts[s], at = at, at + len(covariance)
        self.q = at
        self.white = [self._whiten(b, own.covariance(size)) for b, own in zip(self.blocks, self.parts[1], strict=True)]
        self.precision = np.eye(self.q)
        for (_, x), b in zip(self.white, self.blocks, strict=True):
            mine = self.columns_of(b.session)
            self.precision[np.ix_(mine, mine)] += x.T @ x
        factor = cho_factor(self.precision)
        self.log_det = 2.0 * float(np.log(np.diag(factor[0])).sum())
        self.covariance = np.asarray(cho_solve(factor, np.eye(self.q)))
        self._asked: Sequence[Array] | None = None
        self._projected: tuple[Array, float] = np.zeros(self.q), 0.0

    @cached_property
    def rest(self) -> tuple[Array, bool]:
        """Cholesky factor of the precision of all columns but z."""
        found: tuple[Array, bool] = cho_factor(self.precision[self.p :, self.p :])
        return found

    @cached_property
    def curvature(self) -> Array:
        """Half the second derivative (p, p) of the objective with respect to z."""
        across = self.precision[: self.p, self.p :]
        return np.asarray(self.precision[: self.p, : self.p] - across @ cho_solve(self.rest, across.T))

    def columns_of(self, session: int) -> NDArray[np.intp]:
        """Indices of the columns that a trial of this session has."""
        a = self.starts[session]
        return np.concatenate([np.arange(self.shared), np.arange(a, a + len(self.roots[session]))])

    def design(self, b: Block) -> Array:
        """Columns (n, …) of one trial: moved, instrument, discrepancy of its session."""
        return np.hstack([b.moved, b.instrument, reached(b, self.sizes, self.roots[b.session])])

    def _whiten(self, b: Block, own: Array) -> tuple[Array, Array]:
        lower = cholesky(np.diag(b.white) + b.own @ b.own.T + own, lower=True)
        return lower, solved(lower, self.design(b))

    def projected(self, residuals: Sequence[Array]) -> tuple[Array, float]:
        """Xᵀ C⁻¹ r (q,) and rᵀ C⁻¹ r; those of the residuals asked for last are kept."""
        if self._asked is residuals:
            return self._projected
        b, square = np.zeros(self.q), 0.0
        for (lower, x), r, block in zip(self.white, residuals, self.blocks, strict=True):
            w = solved(lower, np.asarray_chkfinite(r))
            b[self.columns_of(block.session)] += x.T @ w
            square += float(w @ w)
        self._asked, self._projected = residuals, (b, square)
        return self._projected

    def mean(self, residuals: Sequence[Array]) -> Array:
        """Most probable value (q,) of every column, given residuals at z = 0 of the linear model."""
        return np.asarray(self.covariance @ self.projected(residuals)[0])

    def slope(self, residuals: Sequence[Array], z: Array) -> Array:
        """Half the negative derivative (p,) of the objective at z, given residuals there."""
        b, _ = self.projected(residuals)
        across = self.precision[: self.p, self.p :]
        return np.asarray(b[: self.p] - across @ cho_solve(self.rest, b[self.p :]) - z)

    def objective(self, residuals: Sequence[Array], z: Array) -> float:
        """Twice the negative log posterior at z, but for a constant; residuals at z, everything else taken out."""
        b, square = self.projected(residuals)
        rest = b[self.p :]
        return square - float(rest @ cho_solve(self.rest, rest)) + float(z @ z)

    def log_likelihood(self, residuals: Sequence[Array]) -> float:
        """Log marginal likelihood of residuals at z = 0 of the linear model, but for a constant."""
        b, square = self.projected(residuals)
        log_det = self.log_det + 2.0 * sum(float(np.log(np.diag(lower)).sum()) for lower, _ in self.white)
        return -0.5 * (square - float(b @ self.covariance @ b) + log_det)

    def log_evidence(self, residuals: Sequence[Array]) -> float:
        """The same with what is believed of the sizes beforehand."""
        middle, spread = self.sizes.belief()
        return self.log_likelihood(residuals) - 0.5 * float((((self.sizes.log() - middle) / spread) ** 2).sum())
