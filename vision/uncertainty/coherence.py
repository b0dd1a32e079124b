"""Coherent residuals: the variance inflation they imply, and the part a calibrated camera explains.

The stated uncertainty is widened where residuals are not white noise: the ratios of `vision.fitting.assessment` scatter
by ``sqrt(2 / blocks)`` even on white noise. They are therefore averaged over neighbouring rows, since what disturbs a
film seldom lasts for one frame, and count only where they exceed what white noise gives by `SIGNIFICANT_SCORE` standard
deviations; a single row counts by itself when it exceeds by `ALONE`. A clean film keeps its uncertainty to the last
digit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.camera.model import Projection
from vision.fitting.assessment import N_LEVELS, coherence_ratios, template_blocks
from vision.fitting.template import Template, invert_normal
from vision.uncertainty.budget_terms import displacement

WHITE = np.array([0.66, 0.72, 1.12])
"""Ratio on white noise per size of block: spline samples are correlated across the edges of blocks. Measured
on clean films of speckle, wood and felt (0.61 to 0.66, 0.65 to 0.72, 1.08 to 1.20; 46 rows each)."""
HALF_WINDOW = 8  # rows to each side over which coherence is averaged
SIGNIFICANT_SCORE, ALONE = 4.0, 7.0  # standard deviations, of a mean over rows and of one: chi-squared has long tails


def variance_factor(ratio: NDArray[np.float64], blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factor of the variance of (turn, x, y), (n, m, 3), at least one, by ``ratio`` and ``blocks`` of
    `vision.fitting.assessment.Ratios`, (n, m, 3, 3; block size, direction) each, of rows around each and its own; both
    are NaN where lost."""
    over = ratio / WHITE[:, None]
    known = np.isfinite(over)
    total = _window_sum(np.where(known, over, 0.0))
    share = _window_sum(np.where(known, blocks, 0.0))
    count = _window_sum(known.astype(float))
    mean = np.divide(total, count, out=np.ones_like(total), where=count > 0)
    spread = np.sqrt(2.0 / np.maximum(share, 1.0))
    factor = np.where(mean > 1.0 + SIGNIFICANT_SCORE * spread, mean, 1.0)
    single = np.sqrt(2.0 / np.maximum(np.where(known, blocks, 1.0), 1.0))
    factor = np.maximum(factor, np.where(known & (over > 1.0 + ALONE * single), over, 1.0))
    return np.asarray(factor.max(axis=2))


def inflate_covariance(covariance: NDArray[np.float64], factor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariances (n, m, 3, 3) with their variances multiplied by ``factor`` (n, m, 3), correlations kept."""
    root = np.sqrt(factor)
    return covariance * root[..., :, None] * root[..., None, :]


def _window_sum(values: NDArray[np.float64]) -> NDArray[np.float64]:
    n = len(values)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    rows = np.arange(n)
    return np.asarray(total[np.minimum(rows + HALF_WINDOW + 1, n)] - total[np.maximum(rows - HALF_WINDOW, 0)])


MOST_ROWS = 60  # for which it is computed; others lie between them


def expected_ratio(
    template: Template, camera: Projection, pose: NDArray[np.float64], white_variance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What a calibrated camera adds to the ratio of each row, (n, 3, 3): by size of block and direction, zero where
    nothing is known; ``pose`` (n, 3) and its variance by white noise are NaN where a body is lost."""
    added = np.zeros((len(pose), N_LEVELS, 3))
    known = np.flatnonzero(np.all(np.isfinite(pose), axis=1) & np.all(white_variance > 0.0, axis=1))
    inverse = invert_normal(template.normal)
    if not known.size or inverse is None:
        return added
    rows = known[np.unique(np.linspace(0, known.size - 1, MOST_ROWS).astype(int))]
    design = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
    blocks = template.get_or_make(template_blocks)
    work, weight = np.ones((3, template.n_pixels), dtype=np.float32), np.ones(template.n_pixels, dtype=np.float32)
    found = np.empty((rows.size, N_LEVELS, 3))
    for k, row in enumerate(rows):
        along, across = displacement(template, camera, pose[row])
        residual = design[1] * along + design[2] * across
        residual -= (inverse @ (design @ residual)) @ design
        work[2] = residual
        found[k] = coherence_ratios(blocks, template.columns, work, weight, inverse[:3], white_variance[row]).ratio
    for level in range(N_LEVELS):
        for axis in range(3):
            added[:, level, axis] = np.interp(np.arange(len(pose)), rows, found[:, level, axis])
    return added
