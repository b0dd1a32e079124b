"""The pass forward through a film, and the pass backward that confirms it.

Why backward: an object that slides over a body is partly taken for the body just before the fit breaks down, and every
test on that frame alone may pass. The backward pass comes from the other side, with weights that grew on other frames.
Where both agree the frame stands; where they do not, or the backward pass finds nothing, the frame is lost with the
flag ``UNCONFIRMED``; where only the backward pass finds the body, its pose is taken, flagged ``REACQUIRED``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FrameFlag
from vision.results.pose_table import PoseTable
from vision.tracking.checkpoint import EVERY_ROWS, Checkpoint
from vision.tracking.film_tracker import FilmTracker

BEFORE, AFTER = 12, 4
"""Rows before and after a doubtful row that are confirmed with it."""
AGREE_SIGMA = 2.0
"""Both passes fit the same pixels, so they differ by how far each has converged, not by noise."""
AGREE_PX = 0.02
INLIER_CHANGE = 0.12
"""Share of the pixels that may stop agreeing from one row to the next; more means that something covers the body."""


def track_forward(
    tracker: FilmTracker,
    table: PoseTable,
    checkpoint: Checkpoint | None = None,
    progress: Callable[[int, int], None] | None = None,
    n_still: int = 0,
) -> int:
    """Track all bodies forward and fill the table; returns the number of rows resumed from a checkpoint.

    Frames that repeat the one before are lost, beyond the first ``n_still``: at rest they are right all the same.
    """
    n = table.frame.size
    repeats = tracker.repeats()
    done = checkpoint.load(table, tracker) if checkpoint is not None else 0
    for row in range(done, n):
        if int(table.frame[row]) >= n_still and repeats.at(int(table.frame[row])):
            table.flag[row] = np.uint16(int(FrameFlag.REPEATED))
        _step(tracker, table, row, row, table.flag[row])
        if checkpoint is not None and (row + 1) % EVERY_ROWS == 0 and row + 1 < n:
            checkpoint.save(row + 1, table, tracker)
        if progress is not None:
            progress(row + 1, n)
    return done


def confirm_backward(ready: PreparedFilm, table: PoseTable, confirm: str) -> int:
    """Track backward through the doubtful rows and correct the table; returns the number of rows tracked again."""
    n = table.frame.size
    stretches = [(0, n)] if confirm == "all" else doubtful_stretches(table) if confirm == "doubtful" else []
    for start, end in stretches:
        back = _backward(ready, table, start, end)
        for row in range(start, end):
            for body in range(len(ready.bodies)):
                _reconcile(table, back, row, body, ready.templates[body].radius_px)
    return sum(end - start for start, end in stretches)


def fit_alone(ready: PreparedFilm, table: PoseTable, row: int, poses: Sequence[NDArray[np.float64]]) -> None:
    """Fit one row of the table from given poses, one per body, without its neighbours."""
    tracker = FilmTracker(ready)
    tracker.clear_histories()
    for i in tracker.order:
        tracker.trackers[i].place(-1, poses[i])
    _step(tracker, table, row, 0)


def doubtful_stretches(table: PoseTable) -> list[tuple[int, int]]:
    """Stretches of rows ``start..end-1`` around every row where a body is lost, reacquired, or freshly covered."""
    n = table.frame.size
    repeated = (table.flag & np.uint16(int(FrameFlag.REPEATED))) != 0
    doubt = (table.failed & ~repeated) | ((table.flag & np.uint16(int(FrameFlag.REACQUIRED))) != 0)
    seen = np.where(np.isfinite(table.inlier), table.inlier, 0.0)
    for row in np.flatnonzero(repeated.any(axis=1)):
        seen[row] = seen[row - 1]
    doubt[1:] |= np.abs(np.diff(seen, axis=0)) > INLIER_CHANGE
    wide = np.zeros(n, dtype=bool)
    for row in np.flatnonzero(doubt.any(axis=1)):
        wide[max(0, row - BEFORE) : row + AFTER + 1] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[0], wide.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _step(tracker: FilmTracker, table: PoseTable, row: int, step: int, known: NDArray[np.uint16] | None = None) -> None:
    """Fit the frame of one row, the ``step``-th tracked one, and store the fits; a repeated one, by the flags that are
    ``known`` of it, is passed over."""
    if known is not None and np.any(known & np.uint16(int(FrameFlag.REPEATED))):
        tracker.skip(step, FrameFlag.REPEATED)
    else:
        tracker.step(int(table.frame[row]), step)
    for i, body in enumerate(tracker.trackers):
        table.store(row, i, body.fit, body.flag)


def _backward(ready: PreparedFilm, table: PoseTable, start: int, end: int) -> PoseTable:
    """Poses of the same rows, tracked from row ``end - 1`` back to ``start``."""
    tracker = FilmTracker(ready)
    back = PoseTable.empty(table.frame, len(ready.bodies))
    n = table.frame.size
    starts: dict[int, list[int]] = {}
    for i in tracker.order:
        known = np.flatnonzero(~table.failed[:, i])
        # placed where the forward pass has it after the stretch; without such rows, at the nearest one inside
        later = [row for row in range(min(n, end + 3) - 1, end - 1, -1) if not table.failed[row, i]]
        starts[i] = later or [int(row) for row in known[known < end][-1:]]
        if not starts[i]:
            continue
        body = tracker.trackers[i]
        body.absolute.clear()
        body.relative.clear()
        body.usual_zncc = float(table.zncc[starts[i][-1], i])
        body.usual_gain = float(table.gain[starts[i][-1], i])
    for back_step in (-3, -2, -1):
        for i in tracker.order:
            row = end - 1 - back_step
            if row in starts[i]:
                tracker.trackers[i].place(back_step, table.pose[row, i])
            elif back_step == -1 and starts[i] and starts[i][-1] < end:
                # a row within the stretch is only a place to start from
                tracker.trackers[i].place(-1, table.pose[starts[i][-1], i])
    for step, row in enumerate(range(end - 1, start - 1, -1)):
        _step(tracker, back, row, step, table.flag[row])
    return back


def _reconcile(table: PoseTable, back: PoseTable, row: int, body: int, radius_px: float) -> None:
    """Decide between the two passes for one body in one row."""
    forward_lost, backward_lost = bool(table.failed[row, body]), bool(back.failed[row, body])
    if forward_lost and backward_lost:
        return
    if forward_lost:
        table.copy_from(back, row, body)
        table.flag[row, body] |= np.uint16(int(FrameFlag.REACQUIRED))
    elif backward_lost or not _agree(table, back, row, body, radius_px):
        table.reject(row, body, FrameFlag.UNCONFIRMED)


def _agree(table: PoseTable, back: PoseTable, row: int, body: int, radius_px: float) -> bool:
    apart: NDArray[np.float64] = np.abs(table.pose[row, body] - back.pose[row, body])
    u = np.sqrt(np.diag(table.covariance[row, body]))
    least = np.array([AGREE_PX / radius_px, AGREE_PX, AGREE_PX])
    return bool(np.all(apart <= np.maximum(AGREE_SIGMA * u, least)))
