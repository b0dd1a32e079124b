"""Follow one body through the film: predict, fit, judge, search when lost.

Place in the data flow: `track` steps all bodies through the frames, parents first; this file decides for one
body and one frame whether a fit is believed.

Order of attempts in a frame: from the constant-acceleration prediction; from the newest known place moved
with the parent; from the candidates of the wide search. The first fit that passes every test counts. A frame
without one is lost: NaN with the reasons of the first attempt, and the body keeps the newest place known
until it is found again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource
from vision.fitting.base import FAILED, Fit, Fitter
from vision.fitting.template import Template
from vision.tracking.flags import FAILURE, FrameFlag
from vision.tracking.pose_prediction import Placement, Trace, from_parent, in_parent
from vision.tracking.wide_search import candidates

MIN_ZNCC = 0.6
MIN_INLIER = 0.3
MAX_JUMP_RAD = math.radians(8.0)
MAX_JUMP_PX = 12.0
USUAL_SHARE = 0.85
"""Least correlation as a share of the usual one; blur lowers it slowly, a wrong place at once."""
MIN_GAIN = 0.6
"""Flicker changes the light by some per cent; a contrast that collapses is another surface in the way."""
COVERED_SHARE = 0.1
"""Pixels in sight that do not agree; noise alone makes 0.003."""
PATIENCE = 60
"""Lost frames in a row after which the wide search runs on every fifth frame only."""


@dataclass
class Follower:
    """State of one body while a film is tracked.

    Parameters
    ----------
    fitter : Fitter
    parent : Follower or None
    """

    fitter: Fitter
    parent: Follower | None = None
    absolute: Trace = field(default_factory=Trace)
    relative: Trace = field(default_factory=Trace)
    fit: Fit = FAILED
    flag: FrameFlag = FrameFlag.NOT_CONVERGED
    lost_in_a_row: int = 0
    usual_zncc: float = 0.0
    usual_gain: float = 1.0
    searches: int = 0

    @property
    def template(self) -> Template:
        """The body's template."""
        return self.fitter.template

    def start(self) -> None:
        """Place the body where it is in the reference, at rest."""
        place = self._placement(np.zeros(3))
        self.absolute.add(-1, place)
        if self.parent is not None:
            self.relative.add(-1, in_parent(place, self.parent.absolute.last()))  # type: ignore[arg-type]

    def place(self, step: int, pose: NDArray[np.float64]) -> None:
        """Tell where the body is at a step; parents are placed before their children."""
        place = self._placement(pose)
        self.absolute.add(step, place)
        parent_now = self._parent_placement(step)
        if parent_now is not None:
            self.relative.add(step, in_parent(place, parent_now))

    def predict(self, step: int) -> NDArray[np.float64]:
        """Pose expected at a step, through the parent's pose of the same step where that is known."""
        place = self.absolute.predict(step)
        parent_now = self._parent_placement(step)
        relative = self.relative.predict(step)
        if parent_now is not None and relative is not None:
            place = from_parent(relative, parent_now)
        assert place is not None, "start() gives every body a first place"
        return self._pose(place)

    def step(
        self, film: FrameSource, index: int, step: int, covered: NDArray[np.uint8] | None, search: bool = True
    ) -> Fit:
        """Fit the body in frame ``index``, the ``step``-th tracked one, and remember the result."""
        expected = self.predict(step)
        fit = self.fitter.fit(film, index, expected, covered)
        flag = self._judge(fit, expected)
        if flag & FAILURE:
            fit, flag = self._retry(film, index, step, covered, flag, search)
        self.fit, self.flag = fit, flag
        if flag & FAILURE:
            self.lost_in_a_row += 1
            self.fitter.reset()
            return fit
        if fit.seen - fit.inlier > COVERED_SHARE:
            self.flag |= FrameFlag.COVERED
        self.lost_in_a_row = 0
        self.usual_zncc = fit.zncc if self.usual_zncc == 0.0 else 0.9 * self.usual_zncc + 0.1 * fit.zncc
        self.usual_gain += 0.1 * (fit.gain - self.usual_gain)
        self.place(step, fit.pose)
        return fit

    def _retry(
        self,
        film: FrameSource,
        index: int,
        step: int,
        covered: NDArray[np.uint8] | None,
        first_flag: FrameFlag,
        search: bool,
    ) -> tuple[Fit, FrameFlag]:
        """Try from the newest place known, then from a wide search around it."""
        newest = self._newest(step)
        self.fitter.reset()
        fit = self.fitter.fit(film, index, newest, covered)
        flag = self._judge(fit, newest)
        if not flag & FAILURE:
            return fit, flag | (FrameFlag.REACQUIRED if self.lost_in_a_row else FrameFlag.GOOD)
        if not search or (self.lost_in_a_row > PATIENCE and self.lost_in_a_row % 5):
            return FAILED, first_flag
        self.searches += 1
        best, best_flag = FAILED, first_flag
        for start in candidates(film, index, self.template, newest):
            self.fitter.reset()
            fit = self.fitter.fit(film, index, start, covered)
            flag = self._judge(fit, start)
            if not flag & FAILURE and fit.zncc > best.zncc:
                best, best_flag = fit, flag | FrameFlag.REACQUIRED
        return best, best_flag

    def _judge(self, fit: Fit, expected: NDArray[np.float64]) -> FrameFlag:
        if not fit.converged:
            return FrameFlag.NOT_CONVERGED
        flag = FrameFlag.GOOD
        if not (fit.zncc >= MIN_ZNCC and fit.zncc >= USUAL_SHARE * self.usual_zncc):
            flag |= FrameFlag.LOW_CORRELATION
        if not MIN_GAIN <= fit.gain / self.usual_gain <= 1.0 / MIN_GAIN:
            flag |= FrameFlag.ODD_GAIN
        if not fit.inlier >= MIN_INLIER:
            flag |= FrameFlag.FEW_INLIERS
        moved = np.abs(fit.pose - expected)
        if not (moved[0] <= MAX_JUMP_RAD and np.hypot(moved[1], moved[2]) <= MAX_JUMP_PX):
            flag |= FrameFlag.JUMP
        if not (np.all(np.isfinite(fit.covariance)) and fit.covariance[0, 0] > 0.0):
            flag |= FrameFlag.NO_COVARIANCE
        return flag

    def _newest(self, step: int) -> NDArray[np.float64]:
        place = self.absolute.last()
        parent_now, relative = self._parent_placement(step), self.relative.last()
        if parent_now is not None and relative is not None:
            place = from_parent(relative, parent_now)
        assert place is not None, "start() gives every body a first place"
        return self._pose(place)

    def _parent_placement(self, step: int) -> Placement | None:
        """The parent's placement at this step; None without a parent or when the parent is lost."""
        if self.parent is None or self.parent.absolute.newest_step() != step:
            return None
        return self.parent.absolute.last()

    def _placement(self, pose: NDArray[np.float64]) -> Placement:
        centre_x, centre_y = self.template.centre_px
        return np.array([pose[0], centre_x + pose[1], centre_y + pose[2]])

    def _pose(self, place: Placement) -> NDArray[np.float64]:
        centre_x, centre_y = self.template.centre_px
        return np.array([place[0], place[1] - centre_x, place[2] - centre_y])
