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
def block_moments(
    columns: NDArray[np.float32],
    work: NDArray[np.float32],
    weight: NDArray[np.float32],
    block: NDArray[np.int32],
    groups: NDArray[np.int32],
    influence: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Sums of the squares and of the fourth powers of what each block moves turn, x and y by: (2, sizes, 3).

    ``work`` holds visible pixels and residuals in rows 1 and 2; ``groups`` (sizes, n_blocks) says in which larger block
    each smallest one lies.
    """
    n_sizes, n_blocks = groups.shape
    scores, moments = np.zeros((n_blocks, 5)), np.zeros((2, n_sizes, 3))
    for i in range(block.size):
        k, r = block[i], np.float64(weight[i] * work[1, i]) * np.float64(work[2, i])
        for j in range(4):
            scores[k, j] += r * columns[j, i]
        scores[k, 4] += r
    for size in range(n_sizes):
        moved = np.zeros((n_blocks, 3))
        for k in range(n_blocks):
            for j in range(3):
                for p in range(5):
                    moved[groups[size, k], j] += influence[j, p] * scores[k, p]
        for k in range(n_blocks):
            for j in range(3):
                square = moved[k, j] ** 2
                moments[0, size, j] += square
                moments[1, size, j] += square * square
    return moments


class Blocks:
    """The blocks of one template."""

    def __init__(self, offset_px: NDArray[np.float32]) -> None:
        x, y = (offset_px - offset_px.min(axis=1, keepdims=True)).astype(float)
        smallest = BLOCK_PX[0]
        keys, number = np.unique(np.floor(y / smallest) * 4096 + np.floor(x / smallest), return_inverse=True)
        self._block: NDArray[np.int32] = np.ascontiguousarray(number, dtype=np.int32)
        row, column = np.divmod(keys, 4096)
        groups = [
            np.unique(row // step * 4096 + column // step, return_inverse=True)[1]
            for step in (side // smallest for side in BLOCK_PX)
        ]
        self._groups = np.array(groups, dtype=np.int32)
        # the scores of all blocks add up to zero in five directions
        count = self._groups.max(axis=1, keepdims=True) + 1.0
        self._freedom = np.maximum(1.0 - 5.0 / count, 0.2)

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
        square, fourth = block_moments(columns, work, weight, self._block, self._groups, influence)
        # of normal numbers the fourth power has a mean of three
        return Ratios(square / white_variance / self._freedom, 3.0 * square**2 / np.maximum(fourth, 1e-300))
