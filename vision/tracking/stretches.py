"""Which rows of a film are tracked together, and how stretches of them are joined.

A film is cut into stretches that are tracked at the same time. Each starts some rows before its own first one, from
where a quick walk (`vision.tracking.scout`) found the bodies. The rows it shares with the stretch before must agree;
where they do not, the tracker of the stretch before goes on through it instead. Which rows make a stretch depends on
the film alone, so that the result is the same to the bit however many threads there are.
"""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.film.repeats import Repeats
from vision.film.source import Film, FrameSource
from vision.frame_fit.in_memory import watch
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FrameFlag
from vision.results.pose_table import PoseTable
from vision.tracking.film_tracker import FilmTracker
from vision.tracking.scout import Poses, starts
from vision.tracking.workers import Workers

STRETCH_ROWS = 150
"""A film of fewer than twice as many rows is one stretch."""
SHARED_ROWS = 6
"""Rows that a stretch has in common with the one before; the weights have settled after the first few."""
COMPARED_ROWS = 3


AGREE_SIGMA = 2.0
"""Two trackings fit the same pixels, so they differ by how far each has converged, not by noise."""
AGREE_PX = 0.02


def forward_step(
    tracker: FilmTracker, repeats: Repeats, table: PoseTable, row: int, step: int, n_still: int, search: bool = True
) -> None:
    """Fit the frame of one row, the ``step``-th tracked one, and store the fits.

    A frame that repeats the one before is lost, beyond the first ``n_still``: at rest it is right all the same. Among
    those bodies are not searched for: they have not moved. Nor are they where ``search`` is False.
    """
    index = int(table.frame[row])
    if index >= n_still and repeats.at(index):
        tracker.skip(step, FrameFlag.REPEATED)
    else:
        tracker.step(index, step, search=search and index >= n_still)
    store(tracker, table, row)


def forward_rows(
    tracker: FilmTracker, repeats: Repeats, table: PoseTable, rows: range, step: int, n_still: int, search: bool = True
) -> int:
    """As `forward_step` for as many of the rows as one compiled call fits, at least one; returns how many. The first of
    them is the ``step``-th tracked."""
    done = tracker.walk(table, rows, step, watch(repeats, n_still), search)
    if done:
        return done
    forward_step(tracker, repeats, table, rows.start, step, n_still, search)
    return 1


def store(tracker: FilmTracker, table: PoseTable, row: int) -> None:
    """Store the newest fits of all bodies."""
    tracker.store(table, row)


def agree(one: PoseTable, row: int, other: PoseTable, other_row: int, body: int, radius_px: float) -> bool:
    """Whether two tables have a body at the same place; never where one of them lost it."""
    apart = np.abs(one.pose[row, body] - other.pose[other_row, body])
    u = np.sqrt(np.diag(one.covariance[row, body]))
    least = np.array([AGREE_PX / radius_px, AGREE_PX, AGREE_PX])
    return bool(np.all(apart <= np.maximum(AGREE_SIGMA * u, least)))


@dataclass(frozen=True)
class Stretch:
    """Rows ``first..end-1`` after the `SHARED_ROWS` before them, and the tracker as it was left at the end."""

    first: int
    end: int
    table: PoseTable
    tracker: FilmTracker

    def joins(self, table: PoseTable) -> bool:
        """Whether the stretch before, whose rows are in ``table``, found all bodies in the same places."""
        return all(
            agree(table, self.first - k, self.table, SHARED_ROWS - k, i, body.template.radius_px)
            for k in range(1, COMPARED_ROWS + 1)
            for i, body in enumerate(self.tracker.trackers)
        )


def several_may_read(film: FrameSource) -> bool:
    """Whether threads may ask for frames in any order; of films that are not ours nobody knows."""
    return isinstance(film, Film) and not film.in_order


def first_rows(film: FrameSource, n_rows: int) -> list[int]:
    """First row of every stretch, beginning with 0."""
    count = max(1, n_rows // STRETCH_ROWS) if several_may_read(film) else 1
    return [k * n_rows // count for k in range(count)]


def later_stretches(
    crew: Workers, ready: PreparedFilm, frame: NDArray[np.int64], n_still: int, done: int
) -> list[tuple[int, int, Future[Stretch] | None]]:
    """First row, end and future of the stretches after the first that are not ``done``; None where no place to start
    from was found. ``frame`` (n,) of every row.
    """
    rows = first_rows(ready.film, frame.size)
    found = starts(ready, frame, [row - SHARED_ROWS for row in rows[1:]])
    stretches: list[tuple[int, int, Future[Stretch] | None]] = []
    for first, end in zip(rows[1:], [*rows[2:], frame.size], strict=True):
        start = next(found, None)
        if end > done:
            work = None if start is None else crew.submit(_tracked, crew, ready, frame[:end], first, n_still, start)
            stretches.append((first, end, work))
    return stretches


def _tracked(
    crew: Workers, ready: PreparedFilm, frame: NDArray[np.int64], first: int, n_still: int, start: tuple[Poses, Poses]
) -> Stretch:
    """Track the rows from ``first`` to the last from the poses in the two rows before the shared ones."""
    from_row = first - SHARED_ROWS
    tracker = FilmTracker(ready)
    tracker.clear_histories()
    for back, pose in zip((2, 1), start, strict=True):
        tracker.place(from_row - back, pose)
    table = PoseTable.empty(frame[from_row:], len(ready.bodies))
    repeats = tracker.repeats()
    row, joining = 0, slice(SHARED_ROWS - COMPARED_ROWS, SHARED_ROWS)
    while row < table.frame.size:
        crew.check()
        rows = range(row, SHARED_ROWS if row < SHARED_ROWS else table.frame.size)
        row += forward_rows(tracker, repeats, table, rows, from_row + row, n_still, search=row >= SHARED_ROWS)
        if row == SHARED_ROWS and table.failed[joining].any():
            break  # it cannot join the stretch before, which goes on through it
    return Stretch(first, frame.size, table, tracker)
