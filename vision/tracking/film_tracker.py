"""All bodies of one film, stepped from frame to frame, parents first.

Holds one `BodyTracker` per body and decides in which order they are fitted and which template pixels are left out
because another body is in front.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import parents_first
from vision.film.repeats import Repeats
from vision.fitting.base import Fitter, region_of
from vision.fitting.ecc import EccFitter
from vision.fitting.frame_spline import FrameSpline
from vision.fitting.icgn import IcgnFitter
from vision.fitting.template import Template
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FAILURE, FrameFlag
from vision.tracking.body_tracker import BodyTracker

NOISE_SHOWN_BY = 5
"""Still frames compared to see whether the film has noise."""


class FilmTracker:
    """The bodies of one film, first at their places in the reference."""

    def __init__(self, ready: PreparedFilm) -> None:
        self.ready = ready
        self.order = parents_first(ready.bodies)
        self._frames = FrameSpline(ready.film)
        self._searches = 0
        self.trackers: list[BodyTracker] = []
        self.restart()

    def restart(self) -> None:
        """Put every body back to its place in the reference."""
        self._searches += sum(tracker.searches for tracker in self.trackers)
        self.trackers = [BodyTracker(self._fitter(template)) for template in self.ready.templates]
        parents = self.ready.parents
        for i in self.order:
            parent = parents[i]
            self.trackers[i].parent = None if parent is None else self.trackers[parent]
            self.trackers[i].start()

    def _fitter(self, template: Template) -> Fitter:
        return EccFitter(template) if self.ready.method == "ecc" else IcgnFitter(template, self._frames)

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
        film, trackers, parents = self.ready.film, self.trackers, self.ready.parents
        expected = [tracker.predict(step) for tracker in trackers]
        boxes = [
            region_of(body.template, pose, film.height, film.width)
            for body, pose in zip(trackers, expected, strict=True)
        ]
        self._frames.expect(index, [box for box in boxes if box is not None])
        for i in self.order:
            covered = self._covered(i, step, expected)
            trackers[i].step(film, index, step, expected[i], covered, search)
            for child, parent in enumerate(parents):
                if parent == i:
                    # now through the parent's pose in this frame
                    expected[child] = trackers[child].predict(step)

    def skip(self, step: int, flag: FrameFlag) -> None:
        """Pass over a frame that says nothing, with a flag for all bodies."""
        for i in self.order:
            self.trackers[i].skip(step, flag)

    def repeats(self) -> Repeats:
        """Finds repeated frames by the pixels around the bodies' places in the reference."""
        film = self.ready.film
        boxes = [region_of(t, np.zeros(3), film.height, film.width, 0) for t in self.ready.templates]
        known = np.array([box for box in boxes if box is not None] or [(0, film.height, 0, film.width)])
        low, high = known.min(axis=0), known.max(axis=0)
        repeats = Repeats(film, (int(low[0]), int(high[1]), int(low[2]), int(high[3])))
        # still frames that are equal show that the film has no noise by which exposures would differ
        first = range(1, min(self.ready.reference.n_averaged, NOISE_SHOWN_BY))
        if any(repeats.at(index) for index in first) and all(repeats.at(index) for index in first):
            repeats.meaningful = False
        return repeats

    def _covered(self, i: int, step: int, expected: list[NDArray[np.float64]]) -> NDArray[np.uint8] | None:
        """Template pixels of a body that the bodies in front hide, at their poses where known, else as expected."""
        in_front = self.ready.occlusion.in_front[i]
        if not in_front:
            return None
        others = {j: self.trackers[j] for j in in_front}
        poses = {j: o.fit.pose if o.absolute.newest_step() == step else expected[j] for j, o in others.items()}
        return self.ready.occlusion.covered(i, expected[i], poses)

    def searches(self) -> int:
        """Number of wide searches."""
        return self._searches + sum(tracker.searches for tracker in self.trackers)

    def searched_before(self, other: FilmTracker) -> None:
        """Count the searches of another tracker of the same film, too."""
        self._searches += other.searches()

    def info(self) -> dict[str, Any]:
        """Counts and settings that go into the result."""
        return {
            "pixels": {template.name: template.n_pixels for template in self.ready.templates},
            "noise_grey": self.ready.reference.noise_grey,
            "wide_searches": self.searches(),
        }


def first_poses(tracker: FilmTracker, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses and their standard uncertainties in the first n frames, each (n, n_bodies, 3), NaN where lost."""
    pose, u = (np.full((n, len(tracker.trackers), 3), np.nan) for _ in range(2))
    for step in range(n):
        tracker.step(step, step, search=False)
        for i, body in enumerate(tracker.trackers):
            if not body.flag & FAILURE:
                pose[step, i], u[step, i] = body.fit.pose, np.sqrt(np.diag(body.fit.covariance))
    return pose, u
