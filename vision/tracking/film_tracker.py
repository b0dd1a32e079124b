"""All bodies of one film, stepped from frame to frame, parents first.

Holds one `BodyTracker` per body and decides in which order they are fitted and which template pixels are left out
because another body is in front.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import parents_first
from vision.film.source import FrameSource, Repeats, saturated_grey
from vision.fitting.base import Fit, region_of
from vision.fitting.frame_spline import FrameSpline
from vision.fitting.icgn import Begun, IcgnFitter
from vision.fitting.template import Template
from vision.frame_fit.compiled import DOUBTFUL, NOT_BEGUN, OUTSIDE, Film, History, Rows
from vision.frame_fit.frame_fit import FrameFit, Watch, frames_around
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FAILURE, FrameFlag
from vision.results.pose_table import PoseTable
from vision.tracking.body_tracker import BodyTracker, PlacementHistory

NOISE_SHOWN_BY = 5
"""Still frames compared to see whether the film has noise."""


class FilmTracker:
    """The bodies of one film, first at their places in the reference."""

    def __init__(self, ready: PreparedFilm) -> None:
        self.ready = ready
        self.order, self._parents = parents_first(ready.bodies), ready.parents
        self._frames = FrameSpline(ready.film)
        self.trackers: list[BodyTracker] = []
        self.restart()

    def restart(self) -> None:
        """Put every body back to its place in the reference."""
        self.searches_before = 0  # of trackers whose work this one goes on with
        parents = self._parents
        self._together = FrameFit(self.ready.templates, self.ready.occlusion, self.order, parents)
        self.trackers = trackers_in(self._together, self._frames)
        for i in self.order:
            parent = parents[i]
            self.trackers[i].parent = None if parent is None else self.trackers[parent]
            self.trackers[i].start()

    def clear_histories(self) -> None:
        """Forget where the bodies were; they are placed anew before the next step."""
        for tracker in self.trackers:
            tracker.absolute.clear()
            tracker.relative.clear()

    def place(self, step: int, poses: Sequence[NDArray[np.float64]] | NDArray[np.float64]) -> None:
        """Record where all bodies are at a step."""
        for i in self.order:
            self.trackers[i].place(step, poses[i])

    def step(self, index: int, step: int, search: bool = True) -> None:
        """Fit all bodies in frame ``index``, the ``step``-th tracked one, parents first."""
        film, together = self.ready.film, self._together
        expected = [tracker.predict(step) for tracker in self.trackers]
        boxes = [
            region_of(body.template, pose, film.height, film.width)
            for body, pose in zip(self.trackers, expected, strict=True)
        ]
        self._frames.expect(index, [box for box in boxes if box is not None])
        # in one compiled call while every body's fit is good
        together.expect(expected, boxes)
        first = boxes[self.order[0]]
        if first is not None:
            self._frames.part(index, first)
        self._finish(together, index, step, search)

    def _finish(
        self, together: FrameFit, index: int, step: int, search: bool, position: int = 0, ended: int | None = None
    ) -> None:
        """Fit the bodies of a frame from the ``position``-th in order on, where compiled code ``ended``."""
        expected = list(together.found.expected)
        while position < len(self.order):
            if ended is None:
                part, start, ended = self._frames.newest(index), position, NOT_BEGUN
                if part is not None:
                    position, ended = together.go_on(part, start, step)
                self._fitted(together, self.order[start:position])
            if ended == OUTSIDE:
                self._frames.part(index, tuple(together.found.region[self.order[position]].tolist()))
            elif position < len(self.order):
                i = self.order[position]
                self._step_alone(i, index, step, search, expected, together.begun(i) if ended == DOUBTFUL else None)
                together.found.pose[i] = self.trackers[i].fit.pose
                position += 1
            ended = None

    def _fitted(self, together: FrameFit, bodies: Sequence[int]) -> None:
        """Let trackers know of fits that compiled code has accepted."""
        for i in bodies:
            self.trackers[i].fitted(partial(together.fit_of, i), bool(together.found.flag[i]))

    def walk(self, table: PoseTable, rows: range, first_step: int, watch: Watch, search: bool = True) -> int:
        """Track and store rows of a table in compiled code; returns how many are done.

        0 where the film or the next row is not for compiled code. The first row is the ``first_step``-th tracked.
        """
        index = table.frame[rows.start : rows.stop]
        span = frames_around(self.ready.film, index)
        if span is None or self._frames.newest(int(index[0])) is not None:
            return 0
        together, (first, frames, n), stop = self._together, span, self._together.stop
        n_still, watched_from, line = watch
        film = Film(frames, first, saturated_grey(self.ready.film), watched_from, *line)
        columns = (getattr(table, name) for name in Rows._fields[3:])
        done = together.walk(film, Rows(index[:n], rows.start, first_step, *columns))
        if done:
            self._fitted(together, self.order)
        ended, position = int(stop.begun[0]), int(stop.at[0])
        if done < n and ended:
            now, box, expected = int(index[done]), tuple(stop.box.tolist()), tuple(stop.expected.tolist())
            self._fitted(together, self.order[:position])
            self._frames.expect(now, [expected])
            self._frames.take(now, box, together.states.coefficient, int(stop.n_saturated[0]))
            self._finish(together, now, first_step + done, search and now >= n_still, position, ended)
            self.store(table, rows.start + done)
            done += 1
        return done

    def _step_alone(
        self,
        i: int,
        index: int,
        step: int,
        search: bool,
        expected: list[NDArray[np.float64]],
        begun: Begun | None = None,
    ) -> None:
        """Fit one body from its ``expected`` pose, ``begun`` or not, and expect its children anew."""
        film, tracker, covered = self.ready.film, self.trackers[i], self._covered(i, step, expected)
        started: Callable[[], Fit] | None = None
        if begun is not None and isinstance(tracker.fitter, IcgnFitter):
            started = partial(tracker.fitter.fit, film, index, expected[i], covered, begun)
        tracker.step(film, index, step, expected[i], covered, search, started)
        for child, parent in enumerate(self._parents):
            if parent == i:
                # now through the parent's pose in this frame
                expected[child][:] = self.trackers[child].predict(step)

    def skip(self, step: int, flag: FrameFlag) -> None:
        """Pass over a frame that says nothing, with a flag for all bodies."""
        for i in self.order:
            self.trackers[i].skip(step, flag)

    def _covered(self, i: int, step: int, expected: list[NDArray[np.float64]]) -> NDArray[np.uint8] | None:
        """Template pixels of a body that the bodies in front hide, at their poses where known, else as expected."""
        in_front = self.ready.occlusion.in_front[i]
        if not in_front:
            return None
        others = {j: self.trackers[j] for j in in_front}
        poses = {j: o.fit.pose if o.absolute.newest_step() == step else expected[j] for j, o in others.items()}
        return self.ready.occlusion.covered(i, expected[i], poses)

    def store(self, table: PoseTable, row: int) -> None:
        """Store the newest fits of all bodies in a row of a table."""
        for i, body in enumerate(self.trackers):
            table.store(row, i, body.fit, body.flag)

    def searches(self) -> int:
        """Number of wide searches."""
        return self.searches_before + sum(tracker.searches for tracker in self.trackers)

    def info(self) -> dict[str, Any]:
        """Counts and settings that go into the result."""
        return {
            "pixels": {template.name: template.n_pixels for template in self.ready.templates},
            "noise_grey": self.ready.reference.noise_grey,
            "wide_searches": self.searches(),
        }


def trackers_in(together: FrameFit, frames: FrameSpline) -> list[BodyTracker]:
    """Trackers of all bodies, whose state is in the arrays of the compiled frame fit."""
    trackers, facts, states = [], [], together.states
    for i, template in enumerate(together.templates):
        one = slice(i, i + 1)
        absolute, relative = (
            PlacementHistory(History(history.known[one], history.step[one], history.place[one]))
            for history in (states.absolute, states.relative)
        )
        fitter = IcgnFitter(template, frames, together.memory(i))
        tracker = BodyTracker(fitter, absolute=absolute, relative=relative, usual=states.usual[i])
        trackers.append(tracker)
        facts.append((fitter.blocks, tracker.least_zncc, tracker.common_contrast))
    together.know(facts)
    return trackers


def repeats_around(film: FrameSource, templates: Sequence[Template], n_still: int) -> Repeats:
    """Finds frames that repeat the one before, by the pixels around the templates' places in the reference."""
    boxes = [region_of(t, np.zeros(3), film.height, film.width, 0) for t in templates]
    known = np.array([box for box in boxes if box is not None] or [(0, film.height, 0, film.width)])
    low, high = known.min(axis=0), known.max(axis=0)
    repeats = Repeats(film, (int(low[0]), int(high[1]), int(low[2]), int(high[3])))
    # still frames that are equal show that the film has no noise by which exposures would differ
    first = range(1, min(n_still, NOISE_SHOWN_BY))
    if any(repeats.at(index) for index in first) and all(repeats.at(index) for index in first):
        repeats.meaningful = False
    return repeats


def first_poses(tracker: FilmTracker, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses and their standard uncertainties in the first n frames, each (n, n_bodies, 3), NaN where lost."""
    pose, u = (np.full((n, len(tracker.trackers), 3), np.nan) for _ in range(2))
    for step in range(n):
        tracker.step(step, step, search=False)
        for i, body in enumerate(tracker.trackers):
            if not body.flag & FAILURE:
                pose[step, i], u[step, i] = body.fit.pose, np.sqrt(np.diag(body.fit.covariance))
    return pose, u
