"""Track one body through the film: predict, fit, accept or reject, search when lost.

Order of attempts in a frame: from the constant-acceleration prediction; from the newest known placement moved with the
parent; from the candidates of the wide search. The first fit that passes every test is accepted. A frame without one
is lost: NaN with the reasons of the first attempt, and the body stays at its newest known placement until it is found
again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource
from vision.fitting.base import FAILED, LEAST_PX, Fit
from vision.fitting.icgn import IcgnFitter
from vision.fitting.template import Template
from vision.frame_fit.judgement import (
    MAX_JUMP_PX,
    MAX_JUMP_RAD,
    Figures,
    Standards,
    judge_fit,
    update_usual_quality,
)
from vision.frame_fit.motion import Motion, expect_pose, is_placed, place_body
from vision.results.flags import FAILURE, FrameFlag

TURN_STEP_RAD = math.radians(2.5)  # of the search: half of it is well inside the capture range
TURN_RANGE_RAD = math.radians(17.5)  # of the search, to each side of the expected turn
SHIFT_RANGE_PX = 40  # of the search, to each side of the expected place
N_CANDIDATES = 4  # best matches from which a lost body is fitted
FAR_TURN_STEP_RAD = math.radians(6.0)
"""A texture of grain some pixels wide, a quarter as large, still looks like itself half a step away."""
FAR_LEAST_PX = 6  # smallest side of a template at a quarter of the resolution
FAR_PLACES = 2  # of the whole picture, from which a lost body is fitted


def search_whole_picture(
    film: FrameSource, index: int, template: Template, newest_rad: float
) -> list[NDArray[np.float64]]:
    """Poses (turn, x, y) anywhere in frame ``index`` from which to fit, best first; none for a body too small to be
    told so coarsely.

    Turns are given within half a turn of the newest known one, ``newest_rad``, which the picture cannot tell.
    """
    picture = film.read(index).astype(np.float32)
    border = 4 * (int(math.ceil(template.radius_px / 8.0)) + 1)
    wide = cv2.copyMakeBorder(picture, border, border, border, border, cv2.BORDER_CONSTANT, value=float(picture.mean()))
    small = _halve(_halve(np.asarray(wide, dtype=np.float32)))
    turns = newest_rad + np.arange(-math.pi, math.pi - 1e-9, FAR_TURN_STEP_RAD)
    places: list[NDArray[np.float64]] = []
    for pose in _match_template(small, template, turns, 4, (1.5 - border, 1.5 - border), FAR_LEAST_PX):
        apart = [np.abs(pose - other) for other in places]
        if all(one[0] > MAX_JUMP_RAD or max(one[1:]) > MAX_JUMP_PX for one in apart):
            places.append(pose)
        if len(places) == FAR_PLACES:
            break
    return [pose for place in places for pose in search_near_pose(film, index, template, place)[:2]]


def search_near_pose(
    film: FrameSource, index: int, template: Template, expected: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Poses (turn, x, y) in frame ``index`` around the expected one from which to fit, best first; none when the body
    can only be outside the picture."""
    half = int(math.ceil(template.radius_px)) + 2
    reach = half + SHIFT_RANGE_PX
    centre_x = round(template.centre_px[0] + expected[1])
    centre_y = round(template.centre_px[1] + expected[2])
    x0, x1 = max(0, centre_x - reach), min(film.width, centre_x + reach + 1)
    y0, y1 = max(0, centre_y - reach), min(film.height, centre_y + reach + 1)
    if x1 - x0 < LEAST_PX or y1 - y0 < LEAST_PX:
        return []
    picture = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.float32)
    view = film.read_region(index, y0, y1, x0, x1)
    top, left = y0 - (centre_y - reach), x0 - (centre_x - reach)
    picture[:] = float(view.mean())
    picture[top : top + view.shape[0], left : left + view.shape[1]] = view
    turns = expected[0] + np.arange(-TURN_RANGE_RAD, TURN_RANGE_RAD + 1e-9, TURN_STEP_RAD)
    corner = (centre_x - reach + 0.5, centre_y - reach + 0.5)
    return _match_template(_halve(picture), template, turns, 2, corner)[:N_CANDIDATES]


def _match_template(
    small: NDArray[np.float32],
    template: Template,
    turns_rad: NDArray[np.float64],
    coarse: int,
    corner_px: tuple[float, float],
    least_px: int = 0,
) -> list[NDArray[np.float64]]:
    """Pose (turn, x, y) of the best match at each turn at which the template fits into ``small``, part of a frame at a
    ``coarse``-th of its resolution whose first pixel lies at ``corner_px`` (x, y) of the frame; best first.

    With ``least_px``, a template that has a shorter side, or does not fit in, at any turn matches nowhere.
    """
    found: list[tuple[float, NDArray[np.float64]]] = []
    for phi in turns_rad.tolist():
        patch, mask, offset_x, offset_y = _rotate_template(template, phi, coarse)
        if min(patch.shape) < least_px or patch.shape[0] >= small.shape[0] or patch.shape[1] >= small.shape[1]:
            if least_px:
                return []
            continue
        score = cv2.matchTemplate(small, patch, cv2.TM_CCOEFF_NORMED, mask=mask)
        score[~np.isfinite(score)] = -1.0
        _, best, _, (column, row) = cv2.minMaxLoc(score)
        x, y = coarse * (column + offset_x) + corner_px[0], coarse * (row + offset_y) + corner_px[1]
        found.append((best, np.array([phi, x - template.centre_px[0], y - template.centre_px[1]])))
    found.sort(key=lambda item: -item[0])
    return [pose for _, pose in found]


def _halve(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    rows, columns = picture.shape[0] // 2, picture.shape[1] // 2
    return picture[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2).mean(axis=(1, 3))


def _rotate_template(
    template: Template, phi: float, coarse: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], float, float]:
    """Template turned by ``phi`` (picture axes), rad, at a ``coarse``-th of the resolution: grey less its mean (h, w),
    mask (h, w), 1 where it has pixels, else 0, and column and row of the centre in it."""
    cosine, sine = math.cos(phi), math.sin(phi)
    dx, dy = template.offset_px
    x = (cosine * dx - sine * dy) / coarse
    y = (sine * dx + cosine * dy) / coarse
    left, top = math.floor(float(x.min())), math.floor(float(y.min()))
    columns = np.rint(x - left).astype(int)
    rows = np.rint(y - top).astype(int)
    shape = (int(rows.max()) + 1, int(columns.max()) + 1)
    at, cells = rows * shape[1] + columns, shape[0] * shape[1]
    count = np.bincount(at, minlength=cells).reshape(shape)
    total = np.bincount(at, template.columns[3], cells).reshape(shape)
    mask = (count >= 0.5 * coarse**2).astype(np.float32)
    patch = (total / np.maximum(count, 1.0) * mask).astype(np.float32)
    return patch, mask, float(-left), float(-top)


GOOD = FrameFlag.GOOD
"""Compared by identity before its bits: arithmetic of flags costs more than all other tests of a good frame."""
FAR_EVERY = 3
"""Of the lost frames in a row that are searched, the whole picture is in one out of this many, the first included."""
FAR_SHARE = 0.95
"""Least correlation, as a share of the usual one, of a body found far from where it was: others may look like it."""
MAX_SEARCHED_IN_A_ROW = 60  # lost frames, after which only those are searched that the whole picture is in


@dataclass
class BodyTracker:
    """One body, the ``number``-th of those whose ``motion`` and ``standards`` it uses; ``looks_far``: whether it is
    looked for in the whole picture once it is lost."""

    fitter: IcgnFitter
    motion: Motion
    standards: Standards
    number: int = 0
    flag: FrameFlag = FrameFlag.NOT_CONVERGED
    lost_in_a_row: int = 0
    searches: int = 0
    looks_far: bool = True

    def __post_init__(self) -> None:
        self._fit: Fit | Callable[[], Fit] = FAILED

    @classmethod
    def create_single(cls, fitter: IcgnFitter) -> BodyTracker:
        """Of a body without others, at rest where it is in the reference."""
        tracker = cls(fitter, Motion.from_templates([fitter.template]), Standards.from_templates([fitter.template]))
        tracker.place(-1, np.zeros(3))
        return tracker

    @property
    def template(self) -> Template:
        return self.fitter.template

    @property
    def usual_quality(self) -> NDArray[np.float64]:
        """Usual correlation, 0 before the first fit, and gain, (2,)."""
        return self.standards.usual[self.number]

    @property
    def fit(self) -> Fit:
        if not isinstance(self._fit, Fit):
            self._fit = self._fit()
        return self._fit

    def clear(self) -> None:
        self.motion.absolute.known[self.number] = self.motion.relative.known[self.number] = 0

    def place(self, ordinal: int, pose: NDArray[np.float64]) -> None:
        """Record the pose of the body in the ``ordinal``-th tracked frame; parents are placed before their children."""
        place_body(self.motion, self.number, ordinal, pose)

    def is_placed(self, ordinal: int) -> bool:
        return bool(is_placed(self.motion, self.number, ordinal))

    def predict(self, ordinal: int, is_moving: bool = True) -> NDArray[np.float64]:
        """Pose (3,) expected in the ``ordinal``-th tracked frame; the newest known one, moved with the parent, unless
        ``is_moving``."""
        pose = np.empty(3)
        expect_pose(self.motion, self.number, ordinal, is_moving, pose)
        return pose

    def fit_frame(
        self,
        film: FrameSource,
        index: int,
        ordinal: int,
        expected: NDArray[np.float64],
        covered: NDArray[np.uint8] | None,
        search: bool = True,
        compiled_fit: Callable[[], Fit] | None = None,
    ) -> Fit:
        """Fit the body in frame ``index``, the ``ordinal``-th tracked, from the pose ``expected``, else from the newest
        known one and, if ``search``, others; return and keep the fit and, unless lost, its pose. ``compiled_fit``: one
        from ``expected`` done."""
        fit = self.fitter.fit(film, index, expected, covered) if compiled_fit is None else compiled_fit()
        flag = self._judge(fit, expected)
        if flag & FAILURE:
            fit, flag = self._retry(film, index, ordinal, covered, flag, search)
        self._fit, self.flag = fit, flag
        if flag & FAILURE:
            self.lost_in_a_row += 1
            self.fitter.reset()
            return fit
        self.lost_in_a_row = 0
        update_usual_quality(self.standards, self.number, _figures(fit))
        self.place(ordinal, fit.pose)
        return fit

    def take_fit(self, fit: Callable[[], Fit], flag: int) -> None:
        """Take over a fit that is believed and placed already; it is made when it is asked for."""
        self._fit, self.flag, self.lost_in_a_row = fit, FrameFlag(flag) if flag else GOOD, 0

    def skip(self, ordinal: int, flag: FrameFlag) -> None:
        """Pass over a frame that says nothing: lost, but the motion goes on as predicted."""
        self._fit, self.flag = FAILED, flag
        self.place(ordinal, self.predict(ordinal))

    def _retry(
        self,
        film: FrameSource,
        index: int,
        ordinal: int,
        covered: NDArray[np.uint8] | None,
        first_flag: FrameFlag,
        search: bool,
    ) -> tuple[Fit, FrameFlag]:
        """Fit the ``ordinal``-th tracked frame from the newest known pose, then, if ``search``, from a search around it
        and of the whole picture, counted in ``searches``; else `FAILED` with ``first_flag``."""
        newest = self.predict(ordinal, is_moving=False)
        fit, flag = self._fit_anew(film, index, newest, covered)
        if not flag & FAILURE:
            return fit, flag | (FrameFlag.REACQUIRED if self.lost_in_a_row else FrameFlag.GOOD)
        if not search or (self.lost_in_a_row > MAX_SEARCHED_IN_A_ROW and self.lost_in_a_row % FAR_EVERY):
            return FAILED, first_flag
        self.searches += 1
        best, best_flag = FAILED, first_flag
        near = search_near_pose(film, index, self.template, newest)
        for start in near:
            fit, flag = self._fit_anew(film, index, start, covered)
            if not flag & FAILURE and fit.zncc > best.zncc:
                best, best_flag = fit, flag | FrameFlag.REACQUIRED
        if best is not FAILED or not self.looks_far or self.lost_in_a_row % FAR_EVERY:
            return best, best_flag
        for start in search_whole_picture(film, index, self.template, float(newest[0])):
            # what hides it where it was says nothing of it here
            fit, flag = self._fit_anew(film, index, start, None)
            if not flag & FAILURE and fit.zncc > max(best.zncc, FAR_SHARE * self.usual_quality[0]):
                best, best_flag = fit, flag | FrameFlag.REACQUIRED
        return best, best_flag

    def _fit_anew(
        self, film: FrameSource, index: int, start: NDArray[np.float64], covered: NDArray[np.uint8] | None
    ) -> tuple[Fit, FrameFlag]:
        """Reset the fitter and fit from the pose ``start`` with equal weights; if that fails, again with weights for a
        body that is much hidden. Return the last fit and its flag, failed or not."""
        for cautious in (False, True):
            self.fitter.reset(cautious)
            fit = self.fitter.fit(film, index, start, covered)
            flag = self._judge(fit, start)
            if not flag & FAILURE:
                break
        return fit, flag

    def _judge(self, fit: Fit, expected: NDArray[np.float64]) -> FrameFlag:
        if not fit.converged:
            return FrameFlag.NOT_CONVERGED
        flag = judge_fit(self.standards, self.number, _figures(fit), fit.pose, expected, fit.covariance)
        return FrameFlag(flag) if flag else GOOD


def _figures(fit: Fit) -> Figures:
    return Figures(fit.zncc, fit.inlier, fit.noise_grey, fit.gain, fit.seen, fit.level)
