"""Segments of a film that threads track at the same time, and how they are joined.

A film is cut into stretches that are tracked at the same time. Each starts some rows before its own first one, from
where a quick walk found the bodies. The rows it shares with the stretch before must agree;
where they do not, the tracker of the stretch before goes on through it instead. Which rows make a stretch depends on
the film alone, so that the result is the same to the bit however many threads there are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.film.source import Film, FrameSource, Repeats
from vision.fitting.template import thin_template
from vision.frame_fit.frame_fit import build_repeat_watch
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FAILURE, FrameFlag
from vision.results.pose_table import PoseTable, pose_difference
from vision.tracking.film_tracker import FilmTracker, build_repeat_detector
from vision.tracking.workers import Workers

PIXELS = 1500  # of a body in the quick pass that finds the starts of segments
MOST_ROWS = 16  # longest step of that pass
NEAR_PX, FAR_PX = 1.0, 4.0  # distance from the expected place below which the steps grow, and above which they shrink

Poses = NDArray[np.float64]
"""Of all bodies, (m, 3)."""


def find_segment_starts(
    ready: PreparedFilm, frame: NDArray[np.int64], rows: Sequence[int]
) -> Iterator[tuple[Poses, Poses]]:
    """Yield, for each of ``rows`` in order, the poses (m, 3) of all bodies two rows before it and one row before it,
    until a quick walk loses a body; ``frame`` (n,): frame number of every row."""
    templates = [thin_template(template, PIXELS) for template in ready.templates]
    light = replace(ready, templates=templates, occlusion=ready.occlusion.with_templates(templates))
    walk = _ForwardPass(FilmTracker(light), frame)
    for row in rows:
        if not walk.advance_to(row - 2):
            return
        before = walk.pose
        if not walk.advance_to(row - 1):
            return
        yield before, walk.pose


class _ForwardPass:
    """Where the walk is: ``row``, the ``pose`` of all bodies, and how far they move per row."""

    def __init__(self, tracker: FilmTracker, frame: NDArray[np.int64]) -> None:
        self._tracker, self._frame = tracker, frame
        self._radius = np.array([body.template.radius_px for body in tracker.trackers])
        self.row, self.pose = 0, np.zeros((len(tracker.trackers), 3))
        self._speed, self._stride = np.zeros_like(self.pose), 4

    def advance_to(self, row: int) -> bool:
        """Go on to a row, updating ``row`` and ``pose``; False where a body is lost."""
        while self.row < row:
            step = min(self._stride, row - self.row)
            expected = self.pose + step * self._speed
            found = self._fit_bodies(int(self._frame[self.row + step]), expected)
            if found is None:
                if step == 1:
                    return False
                self._stride = max(1, step // 2)
                continue
            off = np.abs(found - expected)
            off[:, 0] *= self._radius
            if off.max() < NEAR_PX:
                self._stride = min(2 * self._stride, MOST_ROWS)
            elif off.max() > FAR_PX:
                self._stride = max(1, self._stride // 2)
            self._speed, self.pose = (found - self.pose) / step, found
            self.row += step
        return True

    def _fit_bodies(self, index: int, expected: Poses) -> Poses | None:
        """Poses of all bodies in a frame, None where one is not found."""
        tracker = self._tracker
        tracker.place(-1, expected)
        tracker.fit_frame(index, 0, search=False)
        if any(body.flag & FAILURE for body in tracker.trackers):
            return None
        return np.array([body.fit.pose for body in tracker.trackers])


STRETCH_ROWS = 150  # a film of fewer than twice as many rows is one stretch
SHARED_ROWS = 6  # rows that a stretch has in common with the one before; the weights have settled after the first few
COMPARED_ROWS = SHARED_ROWS // 2  # the last of them
AGREE_SIGMA = 2.0  # two trackings fit the same pixels, so they differ by how far each has converged, not by noise
AGREE_PX = 0.02  # up to which two places are the same: of two trackings, steps of a fit, motion from frame to frame


def fit_rows_forward(
    tracker: FilmTracker, repeats: Repeats, table: PoseTable, rows: range, first: int, n_still: int, search: bool = True
) -> int:
    """Fit, and store in the table, as many of ``rows`` as one compiled call fits, at least one; returns how many.
    ``first``: ordinal of the first among the tracked frames; ``n_still``: frames before which none is taken for a
    repeat.

    A frame that repeats the one before is lost, beyond the first ``n_still``: at rest it is right all the same. Among
    those bodies are not searched for: they have not moved. Nor are they where ``search`` is False.
    """
    if done := tracker.track_rows(table, rows, first, build_repeat_watch(repeats, n_still), search):
        return done
    index = int(table.frame[rows.start])
    if index >= n_still and repeats.is_repeat(index):
        tracker.skip(first, FrameFlag.REPEATED)
    else:
        tracker.fit_frame(index, first, search=search and index >= n_still)
    tracker.store(table, rows.start)
    return 1


def poses_agree(one: PoseTable, row: int, other: PoseTable, other_row: int, body: int, radius_px: float) -> bool:
    """Whether two tables have a body at the same place in these rows; False where either lost it."""
    off = np.abs(pose_difference(one.pose[row, body], other.pose[other_row, body]))
    u = np.sqrt(np.diag(one.covariance[row, body]))
    least = np.array([AGREE_PX / radius_px, AGREE_PX, AGREE_PX])
    return bool(np.all(off <= np.maximum(AGREE_SIGMA * u, least)))


@dataclass(frozen=True)
class Segment:
    """Rows ``first..end-1`` after the `SHARED_ROWS` before them, and the tracker as it was left at the end."""

    first: int
    end: int
    table: PoseTable
    tracker: FilmTracker

    def is_continuous(self, table: PoseTable) -> bool:
        """Whether the stretch before, whose rows are in ``table``, found all bodies in the same places."""
        return all(
            poses_agree(table, self.first - k, self.table, SHARED_ROWS - k, i, body.template.radius_px)
            for k in range(1, COMPARED_ROWS + 1)
            for i, body in enumerate(self.tracker.trackers)
        )


def is_thread_safe(film: FrameSource) -> bool:
    """Whether threads may read frames in any order; False for films of other classes."""
    return isinstance(film, Film) and not film.in_order


def segment_starts(film: FrameSource, n_rows: int) -> list[int]:
    count = max(1, n_rows // STRETCH_ROWS) if is_thread_safe(film) else 1
    return [k * n_rows // count for k in range(count)]


def track_later_segments(
    crew: Workers, ready: PreparedFilm, frame: NDArray[np.int64], n_still: int, done: int
) -> list[tuple[int, int, Future[Segment] | None]]:
    """(First row, end, future) of the segments after the first that are not among the ``done`` rows, submitted to the
    crew; None without poses to start from. ``frame`` (n,): frame number of every row."""
    rows = segment_starts(ready.film, frame.size)
    found = find_segment_starts(ready, frame, [row - SHARED_ROWS for row in rows[1:]])
    stretches: list[tuple[int, int, Future[Segment] | None]] = []
    for first, end in zip(rows[1:], [*rows[2:], frame.size], strict=True):
        start = next(found, None)
        if end > done:
            work = (
                None if start is None else crew.submit(_track_segment, crew, ready, frame[:end], first, n_still, start)
            )
            stretches.append((first, end, work))
    return stretches


def _track_segment(
    crew: Workers, ready: PreparedFilm, frame: NDArray[np.int64], first: int, n_still: int, start: tuple[Poses, Poses]
) -> Segment:
    """Track rows from ``first`` to the last of ``frame`` (n,) into a segment, from the poses in the two rows before
    those it shares with the segment before; it ends there where a body is lost in these, as it cannot join."""
    from_row = first - SHARED_ROWS
    tracker = FilmTracker(ready)
    tracker.clear_histories()
    for back, pose in zip((2, 1), start, strict=True):
        tracker.place(from_row - back, pose)
    table = PoseTable.empty(frame[from_row:], len(ready.bodies))
    repeats = build_repeat_detector(ready.film, ready.templates, n_still)
    row, joining = 0, slice(SHARED_ROWS - COMPARED_ROWS, SHARED_ROWS)
    while row < table.frame.size:
        crew.check()
        rows = range(row, SHARED_ROWS if row < SHARED_ROWS else table.frame.size)
        row += fit_rows_forward(tracker, repeats, table, rows, from_row + row, n_still, search=row >= SHARED_ROWS)
        if row == SHARED_ROWS and table.is_lost[joining].any():
            break  # it cannot join the stretch before, which goes on through it
    return Segment(first, frame.size, table, tracker)
