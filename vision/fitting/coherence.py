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
from numpy.typing import NDArray

from vision.fitting.assessment import Blocks, block_ratios
from vision.fitting.template import TILE_PX

BLOCK_PX = (TILE_PX, 2 * TILE_PX, 4 * TILE_PX)
"""Sides of the blocks."""
N_LEVELS = len(BLOCK_PX)
N_PARAMETERS = 5
LEAST_BLOCKS = N_PARAMETERS + 3
"""The fit makes the sums of all blocks vanish in as many directions as it has parameters; of fewer blocks too little is
left to tell anything."""


class Ratios(NamedTuple):
    """Variance of (turn, x, y) from blocks over that from white noise, and the number of blocks that carry it, each
    (3, 3): size of block, direction."""

    ratio: NDArray[np.float64]
    blocks: NDArray[np.float64]


UNKNOWN = Ratios(np.full((N_LEVELS, 3), np.nan), np.full((N_LEVELS, 3), np.nan))


def blocks_of(offset_px: NDArray[np.float32]) -> Blocks:
    """The blocks of a template's pixels at ``offset_px`` (2, n)."""
    x, y = np.floor((offset_px - offset_px.min(axis=1, keepdims=True)) / TILE_PX).astype(np.int64)
    # runs of pixels in one square; in a template's order there is one run per square
    starts = np.flatnonzero((np.diff(x, prepend=-1) != 0) | (np.diff(y, prepend=-1) != 0))
    first = np.append(starts, x.size)
    row, column = y[starts], x[starts]
    numbers = [
        np.unique(row // step * 4096 + column // step, return_inverse=True)[1]
        for step in (side // TILE_PX for side in BLOCK_PX)
    ]
    groups = np.array(numbers, dtype=np.int32)
    count = groups.max(axis=1) + 1.0
    for level in range(1, N_LEVELS):
        if count[level] < LEAST_BLOCKS:  # a small body has nothing so large: the largest it has stands for them
            groups[level], count[level] = groups[level - 1], count[level - 1]
    # where not even the smallest tell anything their ratio is zero
    return Blocks(first, groups, np.where(count < LEAST_BLOCKS, np.inf, 1.0 - N_PARAMETERS / count))


def ratios_of(
    blocks: Blocks,
    columns: NDArray[np.float32],
    work: NDArray[np.float32],
    weight: NDArray[np.float32],
    influence: NDArray[np.float64],
    white_variance: NDArray[np.float64],
) -> Ratios:
    """Ratios of one fit.

    Parameters
    ----------
    blocks : Blocks
    columns : ndarray, shape (4, n)
    work : ndarray, shape (3, n)
        Visible pixels and residuals in rows 1 and 2.
    weight : ndarray, shape (n,)
    influence : ndarray, shape (3, 5)
        Change of (turn, x, y) per score.
    white_variance : ndarray, shape (3,)
        Of (turn, x, y), by the residual variance.
    """
    found = Ratios(np.empty((N_LEVELS, 3)), np.empty((N_LEVELS, 3)))
    block_ratios(blocks, columns, work, weight, influence, white_variance, *found)
    return found
