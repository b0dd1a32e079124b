"""Widen the stated uncertainty where the residuals of the fits are not white noise.

Method: the ratios of `vision.fitting.coherence` scatter by ``sqrt(2 / blocks)`` even on white noise. They are therefore
averaged over neighbouring rows, since what disturbs a film seldom lasts for one frame, and count only where they exceed
what white noise gives by `SIGNIFICANT` standard deviations; a single row counts by itself when it exceeds by `ALONE`. A
clean film keeps its uncertainty to the last digit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

WHITE = np.array([0.66, 0.72, 1.12])
"""Ratio on white noise per size of block: spline samples are correlated across the edges of blocks. Measured
on clean films of speckle, wood and felt (0.61 to 0.66, 0.65 to 0.72, 1.08 to 1.20; 46 rows each)."""
HALF_WINDOW = 8
SIGNIFICANT, ALONE = 4.0, 7.0


def variance_factor(ratio: NDArray[np.float64], blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factor of the variance of (turn, x, y), at least one.

    Parameters
    ----------
    ratio, blocks : ndarray, shape (n, m, 3, 3)
        As in `vision.fitting.coherence.Ratios`, per row and body; NaN where lost.

    Returns
    -------
    ndarray, shape (n, m, 3)
    """
    over = ratio / WHITE[:, None]
    known = np.isfinite(over)
    total = _window_sum(np.where(known, over, 0.0))
    share = _window_sum(np.where(known, blocks, 0.0))
    count = _window_sum(known.astype(float))
    mean = np.divide(total, count, out=np.ones_like(total), where=count > 0)
    spread = np.sqrt(2.0 / np.maximum(share, 1.0))
    factor = np.where(mean > 1.0 + SIGNIFICANT * spread, mean, 1.0)
    single = np.sqrt(2.0 / np.maximum(np.where(known, blocks, 1.0), 1.0))
    factor = np.maximum(factor, np.where(known & (over > 1.0 + ALONE * single), over, 1.0))
    return np.asarray(factor.max(axis=2))


def widened(covariance: NDArray[np.float64], factor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariances (n, m, 3, 3) with their variances multiplied by ``factor`` (n, m, 3), correlations kept."""
    root = np.sqrt(factor)
    return covariance * root[..., :, None] * root[..., None, :]


def _window_sum(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum over up to ``2 * HALF_WINDOW + 1`` rows around each."""
    n = len(values)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    rows = np.arange(n)
    return np.asarray(total[np.minimum(rows + HALF_WINDOW + 1, n)] - total[np.maximum(rows - HALF_WINDOW, 0)])
