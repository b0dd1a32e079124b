"""Detect frames that a predicting codec repeats: similar to the one before, not equal to it.

Method: likelihood ratio of the step of all bodies from row to row, along the direction in which each moves: normal
about zero where the frame is repeated, about the median of the `NEAR` steps around it where not. The standard deviation
is that of all steps about these medians, from their median absolute deviation. The threshold is Bonferroni's for
`LEVEL` a film. Bodies at rest tell nothing, and a repeated frame in which nothing moves is right all the same.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vision.fitting.base import region_of
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FrameFlag
from vision.results.pose_table import PoseTable

LEVEL = 1e-3  # probability that a film of smooth motion loses a row by this test
NEAR = 4  # rows to each side
LESS_CHANGED = 0.7
"""Change of the picture in a repeated frame over the median of those around it, at most; with it the test is stricter
than its level."""
MOVES_ON = 0.3
"""Of the median step, that bodies move at least before and after a repeated frame: what stops or turns back does not
pass for one."""


def reject_repeated(ready: PreparedFilm, table: PoseTable) -> None:
    """Lose, as `FrameFlag.REPEATED`, all bodies in rows in which they stand still and the picture hardly changes while
    they move before and after; only of films with predicted frames all of which are tracked."""
    compression = ready.film.compression
    is_predicted = ready.skips_blocks or (compression is not None and compression.steps is None)
    if not is_predicted or table.frame.size < 2 * NEAR + 2 or np.any(np.diff(table.frame) != 1):
        return
    score = np.zeros(table.frame.size)
    moves_on = np.ones(table.frame.size, dtype=bool)
    for i, template in enumerate(ready.templates):
        pose = table.pose[:, i] * (template.radius_px / math.sqrt(2.0), 1.0, 1.0)
        step = np.vstack([np.full((1, 3), np.nan), np.diff(pose, axis=0)])
        usual = _running_median(step)
        size = np.linalg.norm(usual, axis=1)
        along = np.einsum("ij,ij->i", step, usual) / np.maximum(size, 1e-9)
        sigma = 1.4826 * float(np.nanmedian(np.abs(along - size)))
        if not sigma > 0.0:
            continue
        score += np.nan_to_num(size * (size - 2.0 * along) / (2.0 * sigma**2))
        before, after = _mean_of_two(along, -2), _mean_of_two(along, 1)
        moves = size > sigma
        moves_on &= ~moves | ((before > MOVES_ON * size) & (after > MOVES_ON * size))
    likely = np.flatnonzero((score > math.log(table.frame.size / LEVEL)) & moves_on)
    if not likely.size:
        return
    change = _picture_changes(ready, table)
    for row in likely.tolist():
        around = np.delete(change[max(row - NEAR, 0) : row + NEAR + 1], min(row, NEAR))
        if change[row] < LESS_CHANGED * float(np.nanmedian(around)):
            for i in range(len(ready.templates)):
                table.reject(row, i, FrameFlag.REPEATED)


def _running_median(step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median over `NEAR` rows to each side of every column, (n, k); NaN where few are known."""
    padded = np.pad(step, ((NEAR, NEAR), (0, 0)), constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEAR + 1, axis=0)  # (n, k, window)
    known = np.isfinite(windows).sum(axis=2) > NEAR
    filled = np.where(known[..., None], windows, 0.0)
    return np.where(known, np.nanmedian(filled, axis=2), np.nan)


def _mean_of_two(values: NDArray[np.float64], first: int) -> NDArray[np.float64]:
    """Mean of the values ``first`` and ``first + 1`` rows on; NaN beyond the ends."""
    padded = np.pad(values, 3, constant_values=np.nan)
    n = values.size
    return np.asarray(0.5 * (padded[3 + first : 3 + first + n] + padded[4 + first : 4 + first + n]))


def _picture_changes(ready: PreparedFilm, table: PoseTable) -> NDArray[np.float64]:
    """Root mean square difference, grey, (n,), of each row's frame from that of the row before, in a rectangle around
    all bodies; NaN in the first row."""
    film = ready.film
    boxes = [region_of(template, np.zeros(3), film.height, film.width, 0) for template in ready.templates]
    known = np.array([box for box in boxes if box is not None] or [(0, film.height, 0, film.width)])
    box = (*known.min(axis=0)[[0]], *known.max(axis=0)[[1]], *known.min(axis=0)[[2]], *known.max(axis=0)[[3]])
    y0, y1, x0, x1 = (int(edge) for edge in box)
    change = np.full(table.frame.size, np.nan)
    before = None
    for row, index in enumerate(table.frame.tolist()):
        here = np.array(film.read_region(index, y0, y1, x0, x1), dtype=np.float32)
        if before is not None:
            change[row] = math.sqrt(float(np.mean((here - before) ** 2)))
        before = here
    return change
