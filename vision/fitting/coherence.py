"""How far the residuals of a fit are from white noise, in the directions that matter to the pose.

White residuals move the pose by many small, independent amounts. Residuals that go together over many pixels (dust, a
shadow, a change of scale, the edge of something in front, noise smoothed by the camera) move it by more, and the
residual variance alone does not tell. Method: the influence of the residuals on the pose is summed over blocks of the
template; the blocks' squares, added, give the variance without assuming that pixels are independent (the sandwich
estimator with clusters: K.-Y. Liang and S. Zeger, Biometrika 73, 1986; T. Conley, J. Econometrics 92, 1999, for
clusters in space). Its ratio to the variance of white noise is one on a clean film. Blocks of several sizes, since a
block sees what is coherent over its own size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

BLOCK_PX = (8, 16, 32)
"""Sides of the blocks."""
N_LEVELS = len(BLOCK_PX)


class Ratios(NamedTuple):
    """Variance of (turn, x, y) from blocks over that from white noise, and the number of blocks that carry it, each
    (3, 3): size of block, direction."""

    ratio: NDArray[np.float64]
    blocks: NDArray[np.float64]


UNKNOWN = Ratios(np.full((N_LEVELS, 3), np.nan), np.full((N_LEVELS, 3), np.nan))


@njit(cache=True, nogil=True)
def block_scores(
    columns: NDArray[np.float32],
    residual: NDArray[np.float32],
    weight: NDArray[np.float32],
    visible: NDArray[np.float32],
    block: NDArray[np.int32],
    scores: NDArray[np.float64],
) -> None:
    """Sum of weight times residual times sensitivity (turn, x, y, gain, offset) over each block, into (n_blocks, 5)."""
    scores[:] = 0.0
    for i in range(block.size):
        k, r = block[i], np.float64(weight[i] * visible[i]) * np.float64(residual[i])
        scores[k, 0] += r * columns[0, i]
        scores[k, 1] += r * columns[1, i]
        scores[k, 2] += r * columns[2, i]
        scores[k, 3] += r * columns[3, i]
        scores[k, 4] += r


class Blocks:
    """The blocks of one template."""

    def __init__(self, offset_px: NDArray[np.float32]) -> None:
        x, y = (offset_px - offset_px.min(axis=1, keepdims=True)).astype(float)
        smallest, per_level = BLOCK_PX[0], []
        keys, number = np.unique(np.floor(y / smallest) * 4096 + np.floor(x / smallest), return_inverse=True)
        self.number: NDArray[np.int32] = np.ascontiguousarray(number, dtype=np.int32)
        row, column = np.divmod(keys, 4096)
        for side in BLOCK_PX[1:]:
            step = side // smallest
            per_level.append(np.unique(row // step * 4096 + column // step, return_inverse=True)[1])
        self._larger = per_level
        self._scores = np.zeros((keys.size, 5))

    def ratios(
        self,
        columns: NDArray[np.float32],
        work: NDArray[np.float32],
        weight: NDArray[np.float32],
        influence: NDArray[np.float64],
        white_variance: NDArray[np.float64],
    ) -> Ratios:
        """Ratios of one fit.

        Parameters
        ----------
        columns : ndarray, shape (4, n)
        work : ndarray, shape (3, n)
            Visible pixels and residuals in rows 1 and 2.
        weight : ndarray, shape (n,)
        influence : ndarray, shape (3, 5)
            Change of (turn, x, y) per score.
        white_variance : ndarray, shape (3,)
            Of (turn, x, y), by the residual variance.
        """
        block_scores(columns, work[2], weight, work[1], self.number, self._scores)
        moved = self._scores @ influence.T
        ratio, count = np.empty((N_LEVELS, 3)), np.empty((N_LEVELS, 3))
        for level in range(N_LEVELS):
            part = moved
            if level:
                group = self._larger[level - 1]
                part = np.stack([np.bincount(group, moved[:, k]) for k in range(3)], axis=1)
            square = part * part
            total = square.sum(axis=0)
            # of normal numbers the fourth power has a mean of three
            count[level] = 3.0 * total**2 / np.maximum((square * square).sum(axis=0), 1e-300)
            # the scores of all blocks add up to zero in five directions
            ratio[level] = total / white_variance / max(1.0 - 5.0 / len(part), 0.2)
        return Ratios(ratio, count)
