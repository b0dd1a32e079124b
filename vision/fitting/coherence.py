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

from vision.fitting.template import TILE_PX

BLOCK_PX = (TILE_PX, 2 * TILE_PX, 4 * TILE_PX)
"""Sides of the blocks."""
FAST = {"reassoc", "contract", "arcp", "nsz"}
N_LEVELS = len(BLOCK_PX)


class Ratios(NamedTuple):
    """Variance of (turn, x, y) from blocks over that from white noise, and the number of blocks that carry it, each
    (3, 3): size of block, direction."""

    ratio: NDArray[np.float64]
    blocks: NDArray[np.float64]


UNKNOWN = Ratios(np.full((N_LEVELS, 3), np.nan), np.full((N_LEVELS, 3), np.nan))


# short, so that releasing the lock of the interpreter would cost more than it gives other threads
@njit(cache=True, fastmath=FAST)
def block_ratios(
    columns: NDArray[np.float32],
    work: NDArray[np.float32],
    weight: NDArray[np.float32],
    first: NDArray[np.int64],
    groups: NDArray[np.int32],
    influence: NDArray[np.float64],
    white_variance: NDArray[np.float64],
    freedom: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Squares of what each block moves turn, x and y by, added and over ``white_variance`` (3,) and ``freedom``
    (sizes,); and, from their fourth powers, the number of blocks that carry them: each (sizes, 3).

    ``work`` holds visible pixels and residuals in rows 1 and 2; ``first`` (n_runs + 1) where each run of pixels of one
    block begins; ``groups`` (sizes, n_runs) says in which block of each size it lies.
    """
    n_sizes, n_runs = groups.shape
    moved, ratio, count = np.zeros((n_sizes, n_runs, 3)), np.empty((n_sizes, 3)), np.empty((n_sizes, 3))
    at, ax, ay, ref, visible, residual = columns[0], columns[1], columns[2], columns[3], work[1], work[2]
    for k in range(n_runs):
        # slices begin at zero, as the compiler needs to keep the sums in vector registers
        start, end = first[k], first[k + 1]
        w, seen, left = weight[start:end], visible[start:end], residual[start:end]
        a0, a1, a2, a3 = at[start:end], ax[start:end], ay[start:end], ref[start:end]
        s0 = s1 = s2 = s3 = s4 = np.float32(0.0)
        for i in range(w.size):
            r = w[i] * seen[i] * left[i]
            s0, s1, s2, s3, s4 = s0 + r * a0[i], s1 + r * a1[i], s2 + r * a2[i], s3 + r * a3[i], s4 + r
        for j in range(3):
            way = influence[j, 0] * s0 + influence[j, 1] * s1 + influence[j, 2] * s2
            way += influence[j, 3] * s3 + influence[j, 4] * s4
            for size in range(n_sizes):
                moved[size, groups[size, k], j] += way
    for size in range(n_sizes):
        for j in range(3):
            squares = fourth = 0.0
            for k in range(n_runs):
                square = moved[size, k, j] ** 2
                squares += square
                fourth += square * square
            ratio[size, j] = squares / white_variance[j] / freedom[size]
            # of normal numbers the fourth power has a mean of three
            count[size, j] = 3.0 * squares**2 / max(fourth, 1e-300)
    return ratio, count


class Blocks:
    """The blocks of one template."""

    def __init__(self, offset_px: NDArray[np.float32]) -> None:
        x, y = np.floor((offset_px - offset_px.min(axis=1, keepdims=True)) / TILE_PX).astype(np.int64)
        # runs of pixels in one square; in a template's order there is one run per square
        starts = np.flatnonzero((np.diff(x, prepend=-1) != 0) | (np.diff(y, prepend=-1) != 0))
        self._first = np.append(starts, x.size)
        row, column = y[starts], x[starts]
        groups = [
            np.unique(row // step * 4096 + column // step, return_inverse=True)[1]
            for step in (side // TILE_PX for side in BLOCK_PX)
        ]
        self._groups = np.array(groups, dtype=np.int32)
        # the scores of all blocks add up to zero in five directions
        count = self._groups.max(axis=1) + 1.0
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
        arrays = (columns, work, weight, self._first, self._groups, influence, white_variance, self._freedom)
        return Ratios(*block_ratios(*arrays))
