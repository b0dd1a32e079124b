"""One row of a film's table at a time: fit its frame, store what was found, compare two trackings of it."""

from __future__ import annotations

import numpy as np

from vision.film.repeats import Repeats
from vision.results.flags import FrameFlag
from vision.results.pose_table import PoseTable
from vision.tracking.film_tracker import FilmTracker

AGREE_SIGMA = 2.0
"""Two trackings fit the same pixels, so they differ by how far each has converged, not by noise."""
AGREE_PX = 0.02


def forward_step(tracker: FilmTracker, repeats: Repeats, table: PoseTable, row: int, step: int, n_still: int) -> None:
    """Fit the frame of one row, the ``step``-th tracked one, and store the fits.

    A frame that repeats the one before is lost, beyond the first ``n_still``: at rest it is right all the same. Among
    those bodies are not searched for: they have not moved.
    """
    index = int(table.frame[row])
    if index >= n_still and repeats.at(index):
        tracker.skip(step, FrameFlag.REPEATED)
    else:
        tracker.step(index, step, search=index >= n_still)
    store(tracker, table, row)


def store(tracker: FilmTracker, table: PoseTable, row: int) -> None:
    """Store the newest fits of all bodies."""
    for i, body in enumerate(tracker.trackers):
        table.store(row, i, body.fit, body.flag)


def agree(one: PoseTable, row: int, other: PoseTable, other_row: int, body: int, radius_px: float) -> bool:
    """Whether two tables have a body at the same place; never where one of them lost it."""
    apart = np.abs(one.pose[row, body] - other.pose[other_row, body])
    u = np.sqrt(np.diag(one.covariance[row, body]))
    least = np.array([AGREE_PX / radius_px, AGREE_PX, AGREE_PX])
    return bool(np.all(apart <= np.maximum(AGREE_SIGMA * u, least)))
