"""Forward pass through a film, backward pass that confirms it, and re-referencing of lost rows.

Why backward: an object that slides over a body is partly taken for the body just before the fit breaks down, and every
test on that frame alone may pass. The backward pass comes from the other side, with weights that grew on other frames.
Where both agree the frame stands. Where they differ by less than `SAME_PX` both hold the same pixels of the texture:
the better one stands, and their difference is in its uncertainty. Where they are further apart, or the backward pass
finds nothing, the frame is lost with the flag ``UNCONFIRMED``; where only the backward pass finds the body, its pose is
taken, flagged ``REACQUIRED``.

Rows that the reference no longer fits are fitted against a later frame of the film: a body that goes out of focus, or
is lit from elsewhere, stops looking like the still frames. Method: where a body is lost for some rows after it was
found without a flag, a template is made of the newest such frame, at the pose found there, and the body is followed
with it until it is found as before; where that template fails too, the next is made of the last frame it fitted. Each
change brings in the error of the pose it starts from: its covariance is added, so that u grows with the number of
templates. Such rows have the flag `RENEWED`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.angles import turn_matrix
from vision.bodies.masks import build_masks
from vision.errors import BodyError
from vision.fitting.frame_spline import FrameSpline
from vision.fitting.icgn import IcgnFitter
from vision.fitting.pose_covariance import predicted_u_angle
from vision.fitting.template import Template, build_template
from vision.frame_fit.judgement import COVERED_SHARE, SAME_INLIER
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FAILURE, FrameFlag
from vision.results.pose_table import PoseTable, pose_difference, rotate_covariance
from vision.tracking.body_tracker import BodyTracker
from vision.tracking.checkpoint import EVERY_ROWS, Checkpoint
from vision.tracking.film_tracker import FilmTracker, build_repeat_detector
from vision.tracking.segments import (
    SHARED_ROWS,
    fit_rows_forward,
    is_thread_safe,
    poses_agree,
    segment_starts,
    track_later_segments,
)
from vision.tracking.workers import wait_for_result, workers
from vision.uncertainty.coherence import inflate_covariance, variance_factor

BEFORE, AFTER = 12, 4  # rows before and after a doubtful row that are confirmed with it
SAME_PX = 0.5  # furthest that two fits of the same pixels are apart at the rim of a body


def track_forward(
    tracker: FilmTracker,
    table: PoseTable,
    checkpoint: Checkpoint | None = None,
    progress: Callable[[int, int], None] | None = None,
    n_still: int = 0,
    threads: int = 1,
    at_rest: Callable[[], None] | None = None,
) -> int:
    """Track all bodies forward and fill the table; returns the number of rows resumed from ``checkpoint``, which is
    written as rows are done. ``progress`` is called with rows done and all rows, ``at_rest`` once the still frames are
    tracked."""
    ready, n = tracker.ready, table.frame.size
    done = checkpoint.load(table, tracker) if checkpoint is not None else 0
    keeper = _ProgressRecorder(table, done, n_still, checkpoint, progress, at_rest)
    rows = segment_starts(ready.film, n)
    newest = tracker

    def go_on(start: int, end: int) -> None:
        repeats = build_repeat_detector(ready.film, ready.templates, n_still)
        row = max(start, done)
        while row < end:
            crew.check()
            new = fit_rows_forward(newest, repeats, table, range(row, end), row, n_still)
            row += new
            keeper.record_rows(row, newest, new)

    with workers(threads if len(rows) > 1 else 1) as crew:
        first = crew.submit(go_on, 0, rows[1] if len(rows) > 1 else n)
        later = track_later_segments(crew, ready, table.frame, n_still, done) if len(rows) > 1 else []
        wait_for_result(first)
        for start, end, future in later:
            stretch = None if future is None else wait_for_result(future)
            if stretch is None or not stretch.is_continuous(table):
                go_on(start, end)
                continue
            table.take(slice(start, end), stretch.table, slice(SHARED_ROWS, None))
            stretch.tracker.searches_before = newest.searches()
            newest = stretch.tracker
            keeper.record_rows(end, newest)
    tracker.searches_before += newest.searches() - tracker.searches()
    return done


@dataclass
class _ProgressRecorder:
    """Tells of the rows that are done, and keeps them."""

    _table: PoseTable
    _kept: int
    _n_still: int
    _checkpoint: Checkpoint | None
    _progress: Callable[[int, int], None] | None
    _at_rest: Callable[[], None] | None

    def __post_init__(self) -> None:
        self._call_at_rest(self._kept)

    def record_rows(self, rows: int, tracker: FilmTracker, new: int = 1) -> None:
        """Tell ``progress`` of the first ``rows`` rows, of which ``new`` are new, and save them in the checkpoint, with
        the tracker at their end, when it is due."""
        self._call_at_rest(rows)
        n, checkpoint = self._table.frame.size, self._checkpoint
        if self._progress is not None:
            for before in range(rows - new + 1, rows):
                self._progress(before, n)
        if checkpoint is not None and rows - self._kept >= EVERY_ROWS and rows < n:
            checkpoint.save(rows, self._table, tracker)
            self._kept = rows
        if self._progress is not None:
            self._progress(rows, n)

    def _call_at_rest(self, rows: int) -> None:
        if self._at_rest is not None and rows and int(self._table.frame[rows - 1]) + 1 >= self._n_still:
            at_rest, self._at_rest = self._at_rest, None
            at_rest()


def confirm_backward(ready: PreparedFilm, table: PoseTable, confirm: str, threads: int = 1) -> int:
    """Track backward through rows (``confirm``: "all", "doubtful" or "none") and correct the table where both passes
    differ; returns the number of rows tracked again."""
    n = table.frame.size
    stretches = [(0, n)] if confirm == "all" else doubtful_segments(table) if confirm == "doubtful" else []
    with workers(threads if len(stretches) > 1 and is_thread_safe(ready.film) else 1) as crew:
        backs = [crew.submit(_track_backward, ready, table, start, end) for start, end in stretches]
        found = [wait_for_result(back) for back in backs]
    for (start, end), back in zip(stretches, found, strict=True):
        for row in range(start, end):
            for body in range(len(ready.bodies)):
                _reconcile(table, back, row, body, ready.templates[body].radius_px)
    return sum(end - start for start, end in stretches)


def refit_row(ready: PreparedFilm, table: PoseTable, row: int, poses: Sequence[NDArray[np.float64]]) -> None:
    """Fit a row of the table again by itself, from ``poses`` (turn, x, y) of all bodies or, where that fails, from a
    search near them, and store what is found, or the failure, in it."""
    tracker = FilmTracker(ready)
    tracker.clear_histories()
    tracker.place(-1, poses)
    for body in tracker.trackers:
        body.looks_far = False  # near where it was said to be, or not at all
    tracker.fit_frame(int(table.frame[row]), 0)
    tracker.store(table, row)


def doubtful_segments(table: PoseTable) -> list[tuple[int, int]]:
    """Segments (start, end) of rows ``start..end-1`` around every row where a body is lost, reacquired, or freshly
    covered."""
    n = table.frame.size
    repeated = (table.flag & np.uint16(int(FrameFlag.REPEATED))) != 0
    doubt = (table.is_lost & ~repeated) | ((table.flag & np.uint16(int(FrameFlag.REACQUIRED))) != 0)
    seen = np.where(np.isfinite(table.inlier), table.inlier, 0.0)
    for row in np.flatnonzero(repeated.any(axis=1)):
        seen[row] = seen[row - 1]
    doubt[1:] |= np.abs(np.diff(seen, axis=0)) > COVERED_SHARE
    wide = np.zeros(n, dtype=bool)
    for row in np.flatnonzero(doubt.any(axis=1)):
        wide[max(0, row - BEFORE) : row + AFTER + 1] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[0], wide.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _track_backward(ready: PreparedFilm, table: PoseTable, start: int, end: int) -> PoseTable:
    """Track rows ``end - 1`` back to ``start``, from where the first pass has the bodies after them, into a new table
    of all rows, in which the others are lost."""
    tracker = FilmTracker(ready)
    back = PoseTable.empty(table.frame, len(ready.bodies))
    n = table.frame.size
    starts: dict[int, list[int]] = {}
    for i in tracker.order:
        known = np.flatnonzero(~table.is_lost[:, i])
        # placed where the forward pass has it after the stretch; without such rows, at the nearest one inside
        later = [row for row in range(min(n, end + 3) - 1, end - 1, -1) if not table.is_lost[row, i]]
        starts[i] = later or [int(row) for row in known[known < end][-1:]]
        if not starts[i]:
            continue
        body = tracker.trackers[i]
        body.clear()
        body.usual_quality[:] = table.zncc[starts[i][-1], i], table.gain[starts[i][-1], i]
    for back_ordinal in (-3, -2, -1):
        for i in tracker.order:
            row = end - 1 - back_ordinal
            if row in starts[i]:
                tracker.trackers[i].place(back_ordinal, table.pose[row, i])
            elif back_ordinal == -1 and starts[i] and starts[i][-1] < end:
                # a row within the stretch is only a place to start from
                tracker.trackers[i].place(-1, table.pose[starts[i][-1], i])
    for ordinal, row in enumerate(range(end - 1, start - 1, -1)):
        if np.any(table.flag[row] & np.uint16(int(FrameFlag.REPEATED))):
            tracker.skip(ordinal, FrameFlag.REPEATED)
        else:
            tracker.fit_frame(int(table.frame[row]), ordinal)
        tracker.store(back, row)
    return back


def _reconcile(table: PoseTable, back: PoseTable, row: int, body: int, radius_px: float) -> None:
    """Correct ``table`` for one body in a row by the backward pass ``back``: take its pose where the first lost the
    body; reject where ``back`` lost it or has it elsewhere; where they differ a little, keep the better, its covariance
    widened by that."""
    forward_lost, backward_lost = bool(table.is_lost[row, body]), bool(back.is_lost[row, body])
    if forward_lost and backward_lost:
        return
    if forward_lost:
        table.take((row, body), back, (row, body))
        table.flag[row, body] |= np.uint16(int(FrameFlag.REACQUIRED))
        return
    off = pose_difference(table.pose[row, body], back.pose[row, body])
    if backward_lost or abs(off[0]) * radius_px + np.hypot(off[1], off[2]) > SAME_PX:
        if backward_lost or not poses_agree(table, row, back, row, body, radius_px):
            table.reject(row, body, FrameFlag.UNCONFIRMED)
    elif not poses_agree(table, row, back, row, body, radius_px):
        if back.zncc[row, body] > table.zncc[row, body]:
            table.take((row, body), back, (row, body))
        table.covariance[row, body] += np.outer(off, off)


LEAST_ROWS = 3  # fewer lost rows are a flash or a passing hand, not a change of appearance
KEEPS = FrameFlag.IMPRECISE | FrameFlag.WIDENED | FrameFlag.REACQUIRED | FrameFlag.RENEWED
"""Flags that a frame may have to become a reference."""
OTHERWISE = np.uint16(int(FrameFlag.REPEATED))
"""Flag of rows that are lost for another reason than what the body looks like."""
UNCONFIRMED = np.uint16(int(FrameFlag.UNCONFIRMED))
"""Of rows that are lost for another reason, too, but before others: where a body leaves the plane of focus the backward
pass, which begins with lost rows, does not confirm the last that the forward pass could follow."""
F64 = NDArray[np.float64]


def rereference_lost_rows(ready: PreparedFilm, table: PoseTable) -> int:
    """Fill in lost rows by later references; returns the number of rows and bodies found."""
    return sum(
        _track_with_new_reference(ready, table, i, start)
        for i in range(len(ready.bodies))
        for start in _lost_run_starts(table, i)
    )


def _lost_run_starts(table: PoseTable, i: int) -> list[int]:
    """First rows of the runs of lost rows of the i-th body that are long enough and follow a row from which a template
    may be made."""
    lost = table.is_lost[:, i] & ((table.flag[:, i] & OTHERWISE) == 0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(np.int8), [0]])))
    usual = np.nanmedian(table.inlier[:, i]) if not table.is_lost[:, i].all() else np.nan
    return [
        int(start)
        for start, end in zip(edges[::2], edges[1::2], strict=True)
        if start > 1
        and np.count_nonzero((table.flag[start:end, i] & UNCONFIRMED) == 0) >= LEAST_ROWS
        and _can_be_reference(table, int(start) - 1, i, float(usual))
    ]


def _can_be_reference(table: PoseTable, row: int, i: int, usual: float) -> bool:
    """Whether a row shows the i-th body well enough; ``usual`` is the median share of its pixels that agree."""
    flag = FrameFlag(int(table.flag[row, i]))
    return not flag & ~KEEPS and bool(table.inlier[row, i] >= SAME_INLIER * usual)


def _track_with_new_reference(ready: PreparedFilm, table: PoseTable, i: int, start: int) -> int:
    """Follow the i-th body through the run of lost rows from ``start`` on, with a template made of the row before it,
    then of the last row found; fills ``table``, returns the number of rows found."""
    usual, found, n = float(np.nanmedian(table.inlier[:, i])), 0, table.frame.size
    while True:
        row = start - 1
        template = _build_row_template(ready, table, row, i) if _can_be_reference(table, row, i, usual) else None
        if template is None:
            break
        before = start
        start = _follow_lost_rows(ready, table, i, (row, template))
        found += start - before
        if start in (before, n) or not table.is_lost[start, i] or table.flag[start, i] & OTHERWISE:
            break
    return found


def _build_row_template(ready: PreparedFilm, table: PoseTable, row: int, i: int) -> Template | None:
    """Template of the i-th body from the single frame of a row; None where any body is lost in it, too little of this
    one is in view, or noise hides its texture."""
    if table.is_lost[row].any():
        return None
    bodies = []
    for body, template, pose in zip(ready.bodies, ready.templates, table.pose[row], strict=True):
        centre = np.array(template.centre_px)
        bodies.append(replace(body, polygon_px=(body.polygon_px - centre) @ turn_matrix(pose[0]).T + centre + pose[1:]))
    film, own, noise = ready.film, ready.templates[i], ready.reference.noise_grey
    picture = film.read(int(table.frame[row])).astype(np.float32)
    try:
        mask = build_masks(bodies, film.height, film.width)[i]
        template = build_template(own.name, picture, mask, 1, own.n_pixels, noise)
    except BodyError:
        return None
    # one frame has more noise than the still frames' mean: it may hide the texture
    return template if np.isfinite(predicted_u_angle(template, noise)) else None


def _follow_lost_rows(ready: PreparedFilm, table: PoseTable, i: int, reference: tuple[int, Template]) -> int:
    """Follow the i-th body through lost rows with a template made of a row, ``reference`` (row, template); fills
    ``table`` and returns the first row not found."""
    row, template = reference
    film, occlusion = ready.film, ready.occlusion
    templates = [template if k == i else other for k, other in enumerate(ready.templates)]
    occlusion = occlusion.with_templates(templates)
    tracker = BodyTracker.create_single(IcgnFitter(template, FrameSpline(film)))
    if not table.is_lost[row - 1, i]:
        tracker.clear()
        tracker.place(-2, _convert_pose(ready.templates[i], template, table.pose[row, i], table.pose[row - 1, i]))
        tracker.place(-1, np.zeros(3))
    # what is coherent in the residuals of the frame that becomes the reference moves all that are fitted to it
    factor = variance_factor(table.ratio[: row + 1, i : i + 1], table.blocks[: row + 1, i : i + 1])[-1:]
    drift = inflate_covariance(table.covariance[row : row + 1, i : i + 1], factor)[0, 0]
    for ordinal, now in enumerate(range(row + 1, table.frame.size)):
        if not table.is_lost[now, i] or table.flag[now, i] & OTHERWISE:
            return now
        others = {j: table.pose[now, j] for j in occlusion.in_front[i] if not table.is_lost[now, j]}
        expected = tracker.predict(ordinal)
        covered = occlusion.hidden_pixels(i, expected, others) if others else None
        fit = tracker.fit_frame(film, int(table.frame[now]), ordinal, expected, covered, search=False)
        if tracker.flag & FAILURE:
            return now
        pose = _convert_pose(template, ready.templates[i], None, fit.pose, table.pose[row, i])
        # the axes of the template are the picture's of that row
        own = rotate_covariance(fit.covariance, -table.pose[row, i, 0]) + drift
        table.store(now, i, replace(fit, pose=pose, covariance=own), tracker.flag | FrameFlag.RENEWED)
    return table.frame.size


def _convert_pose(template: Template, other: Template, at: F64 | None, pose: F64, reference: F64 | None = None) -> F64:
    """``pose`` of ``template`` as that of ``other``, of the same body: ``other`` was made where ``template`` was at
    ``at``, or ``template`` where ``other`` was at ``reference``."""
    mine, its = np.array(template.centre_px), np.array(other.centre_px)
    if at is not None:
        turn, place = pose[0] - at[0], mine + pose[1:]
        return np.array([turn, *(place + turn_matrix(turn) @ (its - mine - at[1:]) - its)])
    assert reference is not None
    place = mine + pose[1:] + turn_matrix(pose[0]) @ (its + reference[1:] - mine)
    return np.array([reference[0] + pose[0], *(place - its)])
