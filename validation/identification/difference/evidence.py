"""How well a set of changes explains the trials: its marginal likelihood, every size of noise weighed.

Conventions: all trials hold the same changes, so that their mean tells of them, and how the trials differ among
themselves tells of the noise alone. Sizes of a trial's own wandering, its correlation time, and (for "the model lacks
something") of a discrepancy are not chosen but averaged over a grid, each with the weight the trials give it. Laws
scatter by 2 % from trial to trial. Parts of the noise: `validation.identification.noise`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.special import logsumexp

from validation.conventions import Array
from validation.identification.blocks import Block
from validation.identification.noise.parts import smooth
from validation.identification.observations import CHANNELS

TIMES_S = (3e-3, 1e-2, 3e-2)
OWN = (3e-3, 1e-2, 3e-2, 1e-1)
"""Sizes of a trial's own wandering, of what all laws together could do."""
FLOOR, LACKS = 5e-3, (2e-2, 1e-1, 5e-1)
"""Sizes of what the model lacks, of the same: where nothing is lacking, and else."""
SCATTER = 0.07  # of a law from trial to trial, of its prior's standard uncertainty: 2 % of 30 %


@dataclass(frozen=True)
class _Theta:
    """One size of the noise: of the mean, for each size of what is lacking, root of the covariance, its inverse, and
    half the log of its determinant; log weight."""

    roots: tuple[Array, ...]
    inverses: tuple[Array, ...]
    half_logs: tuple[float, ...]
    log_weight: float


class Evidence:
    """Marginal likelihood of the mean difference.

    Parameters
    ----------
    block : Block
        The linear model of the trial that stands for all.
    laws : (p,) bool, which of its columns are laws
    known : (p, k) root of the covariance of what is known of its columns' amounts
    apart : (trials - 1, 3 m) contrasts between the trials
    """

    def __init__(self, block: Block, laws: NDArray[np.bool_], known: Array, apart: Array) -> None:
        trials = len(apart) + 1
        scattered = block.moved[:, laws] * SCATTER
        known_columns = block.moved @ known
        shared = known_columns @ known_columns.T + block.instrument @ block.instrument.T
        alone = np.diag(block.white) + scattered @ scattered.T + block.own @ block.own.T
        self._thetas = []
        for time_s in TIMES_S:
            wander = _blockwise(block, time_s)
            for own in OWN:
                each = alone + own**2 * wander
                weight = _log_density(cholesky(each, lower=True), apart)
                means = [each / trials + shared + size**2 * wander for size in (FLOOR, *LACKS)]
                self._thetas.append(_theta(means, weight))
        total = logsumexp([theta.log_weight for theta in self._thetas])
        self._weights = np.array([theta.log_weight - total for theta in self._thetas])
        self._likeliest = int(np.argmax(self._weights))

    def log_evidence(self, linear: Array, columns: Array, lacking: bool = False) -> float:
        """Log marginal likelihood of a set.

        Parameters
        ----------
        linear : (3 m,) difference that the linear model at the set's values would have without the set
        columns : (3 m, k) of the set, there
        lacking : whether the model may lack something beside it
        """
        sizes = range(1, 1 + len(LACKS)) if lacking else (0,)
        both = np.column_stack([linear, columns])
        parts = [
            weight - np.log(len(sizes)) + _marginal(theta, k, both)
            for theta, weight in zip(self._thetas, self._weights, strict=True)
            for k in sizes
        ]
        return float(logsumexp(parts))

    def objective(self, difference: Array, z: Array) -> float:
        """Twice the negative log posterior of a set's amounts, at the likeliest size of the noise, but for a constant.

        ``difference`` (3 m,) is that at ``z`` (k,).
        """
        w = self.whiten(difference)
        return float(np.sum(w * w)) + float(z @ z)

    def whiten(self, columns: Array, lacking: int = 0) -> Array:
        """Columns in units of the noise, at its likeliest size."""
        root = self._thetas[self._likeliest].roots[lacking]
        return np.asarray(solve_triangular(root, columns, lower=True))

    def amounts(self, linear: Array, columns: Array) -> tuple[Array, Array]:
        """Most probable amounts (k,) of a set, and their covariance (k, k), every size of the noise weighed."""
        parts, means, spreads = [], [], []
        both = np.column_stack([linear, columns])
        for theta, weight in zip(self._thetas, self._weights, strict=True):
            gram = both.T @ theta.inverses[0] @ both
            spread = np.linalg.inv(np.eye(columns.shape[1]) + gram[1:, 1:])
            parts.append(weight + _marginal(theta, 0, both))
            means.append(spread @ gram[1:, 0])
            spreads.append(spread)
        share = np.exp(np.array(parts) - logsumexp(parts))
        mean = np.einsum("t,ti->i", share, np.array(means))
        off = np.array(means) - mean
        return mean, np.einsum("t,tij->ij", share, np.array(spreads)) + np.einsum("t,ti,tj->ij", share, off, off)


def _blockwise(block: Block, time_s: float) -> Array:
    """Covariance (3 m, 3 m) of a wandering as large as the response, channel by channel."""
    roots = [smooth(block, c, time_s) for c in range(CHANNELS)]
    return np.asarray(sum(root @ root.T for root in roots))


def _log_density(root: Array, rows: Array) -> float:
    """Log density of rows, each normal with the covariance of a root, but for a constant."""
    if not len(rows):
        return 0.0
    w = solve_triangular(root, rows.T, lower=True)
    return float(-0.5 * np.sum(w * w) - len(rows) * np.log(np.diag(root)).sum())


def _theta(covariances: Sequence[Array], weight: float) -> _Theta:
    roots = tuple(cholesky(v, lower=True) for v in covariances)
    inverses = tuple(np.asarray(cho_solve((root, True), np.eye(len(root)))) for root in roots)
    return _Theta(roots, inverses, tuple(float(np.log(np.diag(root)).sum()) for root in roots), weight)


def _marginal(theta: _Theta, k: int, both: Array) -> float:
    """Log density of a difference, the first column, when the others have standard normal amounts, but for a constant.

    ``k`` is the size of what is lacking.
    """
    gram = both.T @ theta.inverses[k] @ both
    out = -0.5 * float(gram[0, 0]) - theta.half_logs[k]
    if len(gram) > 1:
        inner, b = np.eye(len(gram) - 1) + gram[1:, 1:], gram[1:, 0]
        out += 0.5 * float(b @ np.linalg.solve(inner, b)) - 0.5 * float(np.linalg.slogdet(inner)[1])
    return out
