"""Track all bodies of one film from frame to frame, parents before children."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import sort_parents_first
from vision.film.source import FIRST_FRAMES, FrameSource, Repeats, saturated_grey
from vision.fitting.base import Fit, region_of
from vision.fitting.frame_spline import NO_PART, FrameSpline
from vision.fitting.icgn import IcgnFitter
from vision.fitting.template import Template
from vision.frame_fit.compiled import DOUBTFUL, OUTSIDE, Film, Rows
from vision.frame_fit.frame_fit import FrameFit, Watch, read_frames_around
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FAILURE, FrameFlag
from vision.results.pose_table import PoseTable
from vision.tracking.body_tracker import BodyTracker


class FilmTracker:
    """The bodies of one film, first at their places in the reference."""

    def __init__(self, ready: PreparedFilm) -> None:
        self.ready = ready
        self.order, self._parents = sort_parents_first(ready.bodies), ready.parents
        self._frames = FrameSpline(ready.film)
        self.trackers: list[BodyTracker] = []
        self.restart()

    def restart(self) -> None:
        """Forget all weights, fits, standards and searches, and place every body where it is in the reference."""
        self.searches_before = 0  # of trackers whose work this one goes on with
        templates = self.ready.templates
        together = self._together = FrameFit(templates, self.ready.occlusion, self.order, self._parents)
        self.fitters = [IcgnFitter(one, self._frames, together.memory(i)) for i, one in enumerate(templates)]
        motion, standards = together.states.motion, together.states.standards
        self.trackers = [BodyTracker(fitter, motion, standards, i) for i, fitter in enumerate(self.fitters)]
        self.place(-1, np.zeros((len(templates), 3)))

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays, by name, of all that the next frame's fit depends on: placements, weights, usual quality."""
        motion, usual = self._together.states.motion, self._together.states.standards.usual
        arrays = {"usual": usual, "lost_in_a_row": np.array([body.lost_in_a_row for body in self.trackers])}
        for name, history in (("absolute", motion.absolute), ("relative", motion.relative)):
            arrays |= {f"{name}_{part}": values for part, values in history._asdict().items()}
        for i, fitter in enumerate(self.fitters):
            arrays |= {f"body{i}_{name}": values for name, values in fitter.state().items()}
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from the arrays that `state` gave."""
        motion = self._together.states.motion
        self._together.states.standards.usual[:] = arrays["usual"]
        for name, history in (("absolute", motion.absolute), ("relative", motion.relative)):
            for part, values in history._asdict().items():
                values[:] = arrays[f"{name}_{part}"]
        for i, (body, fitter) in enumerate(zip(self.trackers, self.fitters, strict=True)):
            body.lost_in_a_row, start = int(arrays["lost_in_a_row"][i]), f"body{i}_"
            fitter.restore({n.removeprefix(start): v for n, v in arrays.items() if n.startswith(start)})

    def clear_histories(self) -> None:
        """Forget where the bodies were; they are placed anew before the next frame is fitted."""
        for tracker in self.trackers:
            tracker.clear()

    def place(self, ordinal: int, poses: Sequence[NDArray[np.float64]] | NDArray[np.float64]) -> None:
        for i in self.order:
            self.trackers[i].place(ordinal, poses[i])

    def fit_frame(self, index: int, ordinal: int, search: bool = True) -> None:
        """Fit all bodies in frame ``index``, the ``ordinal``-th tracked one, parents first; lost ones are searched for
        if ``search``. The trackers keep the fits."""
        together = self._together
        self._frames.expect(index, together.expect(ordinal))
        first = together.region(self.order[0])
        if first is not None:
            self._frames.filtered_part(index, first)
        self._finish(index, ordinal, search)

    def _finish(self, index: int, ordinal: int, search: bool, position: int = 0, ended: int | None = None) -> None:
        """Fit the bodies of frame ``index`` that are left, from the ``position``-th in order on, where compiled code
        ``ended`` with a reason (None: it has not begun)."""
        together = self._together
        while position < len(self.order):
            if ended is None:
                start = position
                position, ended = together.fit_from(self._frames.newest(index) or NO_PART, start, ordinal)
                self._accept_compiled_fits(self.order[start:position])
            box = together.region(self.order[position]) if ended == OUTSIDE else None
            if box is not None:
                self._frames.filtered_part(index, box)
            elif position < len(self.order):
                self._fit_in_python(self.order[position], index, ordinal, search, ended == DOUBTFUL)
                position += 1
            ended = None

    def _accept_compiled_fits(self, bodies: Sequence[int]) -> None:
        """Let trackers know of fits that compiled code has accepted."""
        for i in bodies:
            self.trackers[i].take_fit(partial(self._together.accepted_fit, i), int(self._together.found.flag[i]))

    def track_rows(self, table: PoseTable, rows: range, first_ordinal: int, watch: Watch, search: bool = True) -> int:
        """Track and store ``rows`` of a table in compiled code, the first as the ``first_ordinal``-th tracked frame;
        returns how many, 0 where that cannot be. ``watch`` tells repeated frames; lost bodies are looked for if
        ``search``."""
        index = table.frame[rows.start : rows.stop]
        span = read_frames_around(self.ready.film, index)
        if span is None or self._frames.newest(int(index[0])) is not None:
            return 0
        together, (first, frames, n), stop = self._together, span, self._together.stop
        n_still, watched_from, line = watch
        film = Film(frames, first, saturated_grey(self.ready.film), watched_from, *line)
        columns = (getattr(table, name) for name in Rows._fields[3:])
        done = together.track_rows(film, Rows(index[:n], rows.start, first_ordinal, *columns))
        if done:
            self._accept_compiled_fits(self.order)
        ended, position = int(stop.begun[0]), int(stop.at[0])
        if done < n and ended:
            now, box, expected = int(index[done]), tuple(stop.box.tolist()), tuple(stop.expected.tolist())
            self._accept_compiled_fits(self.order[:position])
            self._frames.expect(now, expected)
            self._frames.take(now, box, together.states.coefficient, int(stop.n_saturated[0]))
            self._finish(now, first_ordinal + done, search and now >= n_still, position, ended)
            self.store(table, rows.start + done)
            done += 1
        return done

    def _fit_in_python(self, i: int, index: int, ordinal: int, search: bool, has_first_fit: bool) -> None:
        """Fit the i-th body of frame ``index`` in Python, from the compiled first fit if it ``has_first_fit``, and
        expect its children anew."""
        film, tracker, found = self.ready.film, self.trackers[i], self._together.found
        expected, covered = found.expected[i].copy(), self._together.hidden_pixels(i)
        begun: Callable[[], Fit] | None = None
        if has_first_fit:
            begun = partial(self.fitters[i].fit, film, index, expected, covered, self._together.first_fit(i))
        found.pose[i] = tracker.fit_frame(film, index, ordinal, expected, covered, search, begun).pose
        for child, parent in enumerate(self._parents):
            if parent == i:
                # now through the parent's pose in this frame
                found.expected[child] = self.trackers[child].predict(ordinal)

    def skip(self, ordinal: int, flag: FrameFlag) -> None:
        for i in self.order:
            self.trackers[i].skip(ordinal, flag)

    def store(self, table: PoseTable, row: int) -> None:
        for i, body in enumerate(self.trackers):
            table.store(row, i, body.fit, body.flag)

    def searches(self) -> int:
        return self.searches_before + sum(tracker.searches for tracker in self.trackers)

    def info(self) -> dict[str, Any]:
        return {
            "pixels": {template.name: template.n_pixels for template in self.ready.templates},
            "noise_grey": self.ready.reference.noise_grey,
            "wide_searches": self.searches(),
        }


def build_repeat_detector(film: FrameSource, templates: Sequence[Template], n_still: int) -> Repeats:
    """Detector of frames that repeat the one before, by the pixels around the templates' places in the reference; it
    never says so of a film whose still frames are equal."""
    boxes = [region_of(t, np.zeros(3), film.height, film.width, 0) for t in templates]
    known = np.array([box for box in boxes if box is not None] or [(0, film.height, 0, film.width)])
    low, high = known.min(axis=0), known.max(axis=0)
    repeats = Repeats(film, (int(low[0]), int(high[1]), int(low[2]), int(high[3])))
    # still frames that are equal show that the film has no noise by which exposures would differ
    first = range(1, min(n_still, FIRST_FRAMES))
    if any(repeats.is_repeat(index) for index in first) and all(repeats.is_repeat(index) for index in first):
        repeats.meaningful = False
    return repeats


def track_first_frames(tracker: FilmTracker, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses and their standard uncertainties in the first n frames, each (n, n_bodies, 3), NaN where lost."""
    pose, u = (np.full((n, len(tracker.trackers), 3), np.nan) for _ in range(2))
    for ordinal in range(n):
        tracker.fit_frame(ordinal, ordinal, search=False)
        for i, body in enumerate(tracker.trackers):
            if not body.flag & FAILURE:
                pose[ordinal, i], u[ordinal, i] = body.fit.pose, np.sqrt(np.diag(body.fit.covariance))
    return pose, u
