"""Track one body through the film: predict, fit, accept or reject, search when lost.

Order of attempts in a frame: from the constant-acceleration prediction; from the newest known placement moved with the
parent; from the candidates of the wide search. The first fit that passes every test is accepted. A frame without one
is lost: NaN with the reasons of the first attempt, and the body stays at its newest known placement until it is found
again.

Prediction: constant acceleration, seen from the parent. A child's placement is tracked in the axes of its parent, so
that a jack that rides on a moving whippen is predicted with the whippen's motion in the same frame. A `Placement` is
(phi, x, y) of the centre in the picture, or in the parent's axes.

The wide search over turn and shift needs no good initial guess. Method: the template is turned in steps and slid over
the region where the body is expected, at half the resolution, with normalised correlation under its mask (OpenCV
`matchTemplate`). The best few, one per turn, are the initial guesses for a fit. A body that is not near its last place
is looked for in the whole picture and at every turn, at a quarter of the resolution; the best places are then searched
around as before.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource
from vision.fitting.base import FAILED, Fit, Fitter
from vision.fitting.template import Template
from vision.frame_fit.compiled import (
    COVERED_SHARE,
    MAX_JUMP_PX,
    MAX_JUMP_RAD,
    MIN_GAIN,
    MIN_INLIER,
    NOISE_ONLY,
    USUAL_SHARE,
    History,
    add_place,
    predict_place,
)
from vision.results.flags import FAILURE, FrameFlag

TURN_STEP_RAD = math.radians(2.5)
TURN_RANGE_RAD = math.radians(17.5)
SHIFT_RANGE_PX = 40
N_CANDIDATES = 4
FAR_TURN_STEP_RAD = math.radians(6.0)
"""A texture of grain some pixels wide, a quarter as large, still looks like itself half a step away."""
FAR_LEAST_PX = 6
"""Smallest side of a template at a quarter of the resolution."""
FAR_PLACES = 2
FAR_APART_RAD, FAR_APART_PX = math.radians(10.0), 12.0


def far_candidates(film: FrameSource, index: int, template: Template, newest_rad: float) -> list[NDArray[np.float64]]:
    """Poses anywhere in the picture from which to fit, best first; none for a body too small to be told so coarsely.

    Turns are given within half a turn of the newest known one, ``newest_rad``, which the picture cannot tell.
    """
    picture = film.read(index).astype(np.float32)
    border = 4 * (int(math.ceil(template.radius_px / 8.0)) + 1)
    wide = cv2.copyMakeBorder(picture, border, border, border, border, cv2.BORDER_CONSTANT, value=float(picture.mean()))
    small = _halve(_halve(np.asarray(wide, dtype=np.float32)))
    turns = newest_rad + np.arange(-math.pi, math.pi - 1e-9, FAR_TURN_STEP_RAD)
    places: list[NDArray[np.float64]] = []
    for pose in _matched(small, template, turns, 4, (1.5 - border, 1.5 - border), FAR_LEAST_PX):
        apart = [np.abs(pose - other) for other in places]
        if all(one[0] > FAR_APART_RAD or max(one[1:]) > FAR_APART_PX for one in apart):
            places.append(pose)
        if len(places) == FAR_PLACES:
            break
    return [pose for place in places for pose in search_candidates(film, index, template, place)[:2]]


def search_candidates(
    film: FrameSource, index: int, template: Template, expected: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Poses around the expected one from which to fit, best first; none when the body can only be outside the
    picture."""
    half = int(math.ceil(template.radius_px)) + 2
    reach = half + SHIFT_RANGE_PX
    centre_x = round(template.centre_px[0] + expected[1])
    centre_y = round(template.centre_px[1] + expected[2])
    x0, x1 = max(0, centre_x - reach), min(film.width, centre_x + reach + 1)
    y0, y1 = max(0, centre_y - reach), min(film.height, centre_y + reach + 1)
    if x1 - x0 < 16 or y1 - y0 < 16:
        return []
    picture = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.float32)
    view = film.read_region(index, y0, y1, x0, x1)
    top, left = y0 - (centre_y - reach), x0 - (centre_x - reach)
    picture[:] = float(view.mean())
    picture[top : top + view.shape[0], left : left + view.shape[1]] = view
    turns = expected[0] + np.arange(-TURN_RANGE_RAD, TURN_RANGE_RAD + 1e-9, TURN_STEP_RAD)
    corner = (centre_x - reach + 0.5, centre_y - reach + 0.5)
    return _matched(_halve(picture), template, turns, 2, corner)[:N_CANDIDATES]


def _matched(
    small: NDArray[np.float32],
    template: Template,
    turns_rad: NDArray[np.float64],
    coarse: int,
    corner_px: tuple[float, float],
    least_px: int = 0,
) -> list[NDArray[np.float64]]:
    """Poses of the best match for each turn at which the template fits into a picture, best first.

    The picture is a ``coarse``-th as large as the frame, where its first pixel lies at ``corner_px`` (x, y). Where a
    side of ``least_px`` is asked for, a template that lacks it, or does not fit in, at any turn matches nowhere.
    """
    found: list[tuple[float, NDArray[np.float64]]] = []
    for phi in turns_rad.tolist():
        patch, mask, offset_x, offset_y = _turned(template, phi, coarse)
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


def _turned(
    template: Template, phi: float, coarse: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], float, float]:
    """Turned template at a ``coarse``-th of the resolution, its mask, and the position of the centre in it (of its
    pixels)."""
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


Placement = NDArray[np.float64]


def in_parent(child: Placement, parent: Placement) -> Placement:
    """Placement of a child in the axes of its parent."""
    cosine, sine = math.cos(parent[0]), math.sin(parent[0])
    # plain numbers: arrays of three cost more than the sums
    (turn, x, y), (turn0, x0, y0) = child.tolist(), parent.tolist()
    return np.array([turn - turn0, cosine * (x - x0) + sine * (y - y0), cosine * (y - y0) - sine * (x - x0)])


def from_parent(relative: Placement, parent: Placement) -> Placement:
    """Placement in the picture of a child given in the axes of its parent; undoes `in_parent`."""
    cosine, sine = math.cos(parent[0]), math.sin(parent[0])
    (turn, x, y), (turn0, x0, y0) = relative.tolist(), parent.tolist()
    return np.array([turn + turn0, x0 + cosine * x - sine * y, y0 + sine * x + cosine * y])


class PlacementHistory:
    """The last three placements of a body, for extrapolation; after a gap it starts anew.

    They are kept in the arrays of a `History` of one body, which may be parts of larger ones, where compiled code finds
    them; what that does with them is done here by the same functions, as Python.
    """

    def __init__(self, kept: History | None = None) -> None:
        self.kept = History.empty(1) if kept is None else kept

    def add(self, step: int, placement: Placement) -> None:
        """Record the placement found at a step (the running number of the tracked frame)."""
        add_place.py_func(self.kept, 0, step, *placement.tolist())

    def clear(self) -> None:
        """Forget everything."""
        self.kept.known[0] = 0

    def newest(self) -> Placement | None:
        """The newest known placement."""
        known = int(self.kept.known[0])
        return self.kept.place[0, known - 1].copy() if known else None

    def newest_step(self) -> int | None:
        """Step of the newest known placement."""
        known = int(self.kept.known[0])
        return int(self.kept.step[0, known - 1]) if known else None

    def predict(self, step: int) -> Placement | None:
        """Placement at a step: constant acceleration from three neighbours, else the newest known one."""
        if not self.kept.known[0]:
            return None
        place = np.empty(3)
        predict_place.py_func(self.kept, 0, step, place)
        return place


GOOD = FrameFlag.GOOD
"""Compared by identity before its bits: arithmetic of flags costs more than all other tests of a good frame."""
MIN_ZNCC = 0.6
"""Least correlation on a film without noise; with noise, `EXPECTED_SHARE` of what it leaves of a perfect match."""
EXPECTED_SHARE = 0.75
CHANCE = 12.0
"""A correlation may be chance whose Fisher transform is below this over the root of the number of pixels: neighbouring
pixels are alike."""
LEAST_LIGHT, SAME_LEVEL, SAME_INLIER = 0.25, 1.3, 0.9
"""Unless only the light has changed, by the first factor at most: then the mean grey value has changed with the
contrast (out of focus it does not), up to the second, and at least this share of the pixels agrees, as well as before.
"""
FAR_EVERY = 3
"""Of the lost frames in a row that are searched, the whole picture is in one out of this many, the first included."""
FAR_SHARE = 0.95
"""Least correlation, as a share of the usual one, of a body found far from where it was: others may look like it."""
LEAST_COMMON = 0.01
"""Where noise explains the reference altogether its contrast tells nothing of the gain."""
MAX_SEARCHED_IN_A_ROW = 60
"""Lost frames in a row after which the wide search runs on every fifth frame only."""


@dataclass
class BodyTracker:
    """State of one body while a film is tracked: ``absolute`` in the picture, ``relative`` in its parent's axes;
    ``usual`` correlation (0 before the first fit) and gain, running means; ``looks_far``: whether it is looked for in
    the whole picture once it is lost."""

    fitter: Fitter
    parent: BodyTracker | None = None
    absolute: PlacementHistory = field(default_factory=PlacementHistory)
    relative: PlacementHistory = field(default_factory=PlacementHistory)
    usual: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 1.0]))
    flag: FrameFlag = FrameFlag.NOT_CONVERGED
    lost_in_a_row: int = 0
    searches: int = 0
    looks_far: bool = True
    least_zncc: float = field(init=False)
    common_contrast: float = field(init=False)

    def __post_init__(self) -> None:
        self._fit: Fit | Callable[[], Fit] = FAILED
        template = self.fitter.template
        texture = max(float(np.var(template.columns[3])) - template.noise_grey**2 / template.n_averaged, 0.0)
        expected = math.sqrt(texture / (texture + template.noise_grey**2)) if texture > 0.0 else 0.0
        # what noise left in the reference takes off the contrast in common with frames that are not part of it
        self.common_contrast = max(texture / max(float(np.var(template.columns[3])), 1e-9), LEAST_COMMON)
        expected *= math.sqrt(self.common_contrast)
        self._chance = math.tanh(CHANCE / math.sqrt(template.n_pixels))
        self.least_zncc = max(min(MIN_ZNCC, EXPECTED_SHARE * expected), self._chance)
        self._noise_share = template.noise_grey**2 / max(texture, 1e-9)

    @property
    def template(self) -> Template:
        """The body's template."""
        return self.fitter.template

    @property
    def fit(self) -> Fit:
        """The newest fit."""
        if not isinstance(self._fit, Fit):
            self._fit = self._fit()
        return self._fit

    def start(self) -> None:
        """Place the body where it is in the reference, at rest."""
        place = self._placement(np.zeros(3))
        self.absolute.add(-1, place)
        if self.parent is not None:
            self.relative.add(-1, in_parent(place, self.parent.absolute.newest()))  # type: ignore[arg-type]

    def place(self, step: int, pose: NDArray[np.float64]) -> None:
        """Record the pose of the body at a step; parents are placed before their children."""
        place = self._placement(pose)
        self.absolute.add(step, place)
        parent_now = self._parent_placement(step)
        if parent_now is not None:
            self.relative.add(step, in_parent(place, parent_now))

    def predict(self, step: int) -> NDArray[np.float64]:
        """Pose expected at a step, through the parent's pose of the same step where that is known."""
        relative = None if self._parent_placement(step) is None else self.relative.predict(step)
        return self._pose(self.absolute.predict(step) if relative is None else None, relative, step)

    def step(
        self,
        film: FrameSource,
        index: int,
        step: int,
        expected: NDArray[np.float64],
        covered: NDArray[np.uint8] | None,
        search: bool = True,
        begun: Callable[[], Fit] | None = None,
    ) -> Fit:
        """Fit the body in frame ``index``, the ``step``-th tracked one, from its `predict` pose, and remember it.

        ``begun`` gives the fit from that pose where it is done already.
        """
        fit = self.fitter.fit(film, index, expected, covered) if begun is None else begun()
        flag = self._flags_of(fit, expected)
        if flag is not GOOD and flag & FAILURE:
            fit, flag = self._retry(film, index, step, covered, flag, search)
        self._fit, self.flag = fit, flag
        if flag is not GOOD and flag & FAILURE:
            self.lost_in_a_row += 1
            self.fitter.reset()
            return fit
        if fit.seen - fit.inlier > COVERED_SHARE:
            self.flag |= FrameFlag.COVERED
        self.lost_in_a_row = 0
        usual_zncc, usual_gain = self.usual.tolist()
        is_new = usual_zncc == 0.0 or self._odd_gain(fit)  # a lamp that was switched stays as it is
        self.usual[0] = fit.zncc if is_new else 0.9 * usual_zncc + 0.1 * fit.zncc
        self.usual[1] = fit.gain if self._odd_gain(fit) else usual_gain + 0.1 * (fit.gain - usual_gain)
        self.place(step, fit.pose)
        return fit

    def fitted(self, fit: Callable[[], Fit], covered: bool) -> None:
        """Take over a fit that passed every test and is placed already; it is made when it is asked for."""
        self._fit, self.flag, self.lost_in_a_row = fit, FrameFlag.COVERED if covered else GOOD, 0

    def skip(self, step: int, flag: FrameFlag) -> None:
        """Pass over a frame that says nothing: lost, but the motion goes on as predicted."""
        self._fit, self.flag = FAILED, flag
        self.place(step, self.predict(step))

    def _retry(
        self,
        film: FrameSource,
        index: int,
        step: int,
        covered: NDArray[np.uint8] | None,
        first_flag: FrameFlag,
        search: bool,
    ) -> tuple[Fit, FrameFlag]:
        """Fit from the newest known placement, then from a wide search around it."""
        newest = self._pose(self.absolute.newest(), self.relative.newest(), step)
        fit, flag = self._fit_anew(film, index, newest, covered)
        if not flag & FAILURE:
            return fit, flag | (FrameFlag.REACQUIRED if self.lost_in_a_row else FrameFlag.GOOD)
        if not search or (self.lost_in_a_row > MAX_SEARCHED_IN_A_ROW and self.lost_in_a_row % 5):
            return FAILED, first_flag
        self.searches += 1
        best, best_flag = FAILED, first_flag
        near = search_candidates(film, index, self.template, newest)
        for start in near:
            fit, flag = self._fit_anew(film, index, start, covered)
            if not flag & FAILURE and fit.zncc > best.zncc:
                best, best_flag = fit, flag | FrameFlag.REACQUIRED
        if best is not FAILED or not self.looks_far or self.lost_in_a_row % FAR_EVERY:
            return best, best_flag
        for start in far_candidates(film, index, self.template, float(newest[0])):
            # what hides it where it was says nothing of it here
            fit, flag = self._fit_anew(film, index, start, None)
            if not flag & FAILURE and fit.zncc > max(best.zncc, FAR_SHARE * self.usual[0]):
                best, best_flag = fit, flag | FrameFlag.REACQUIRED
        return best, best_flag

    def _fit_anew(
        self, film: FrameSource, index: int, start: NDArray[np.float64], covered: NDArray[np.uint8] | None
    ) -> tuple[Fit, FrameFlag]:
        """Fit without the weights of the frame before: from equal ones, then in case much of the body is hidden."""
        for cautious in (False, True)[: 1 + self.fitter.has_cautious_start]:
            self.fitter.reset(cautious)
            fit = self.fitter.fit(film, index, start, covered)
            flag = self._flags_of(fit, start)
            if not flag & FAILURE:
                break
        return fit, flag

    def _flags_of(self, fit: Fit, expected: NDArray[np.float64]) -> FrameFlag:
        if not fit.converged:
            return FrameFlag.NOT_CONVERGED
        flag = GOOD
        # residuals that are the still frames' noise need no better correlation, however low that noise makes it
        noise_only = fit.noise_grey <= NOISE_ONLY * self.template.noise_grey * max(fit.gain, 1.0)
        other_light = self._odd_gain(fit) and self._is_itself(fit)
        usual = noise_only or other_light or fit.zncc >= USUAL_SHARE * self.usual[0]
        if not (fit.zncc >= (self._chance if other_light else self.least_zncc) and usual):
            flag |= FrameFlag.LOW_CORRELATION
        if self._odd_gain(fit) and not other_light:
            flag |= FrameFlag.ODD_GAIN
        if not fit.inlier >= MIN_INLIER:
            flag |= FrameFlag.FEW_INLIERS
        (turn, x, y), (turn0, x0, y0) = fit.pose.tolist(), expected.tolist()
        if not (abs(turn - turn0) <= MAX_JUMP_RAD and math.hypot(x - x0, y - y0) <= MAX_JUMP_PX):
            flag |= FrameFlag.JUMP
        # one number that is not finite makes the sum so
        if not (math.isfinite(sum(map(sum, fit.covariance.tolist()))) and fit.covariance[0, 0] > 0.0):
            flag |= FrameFlag.NO_COVARIANCE
        return flag

    def _odd_gain(self, fit: Fit) -> bool:
        """Whether the contrast has changed by more than lamps usually do."""
        least = MIN_GAIN * self.common_contrast
        return not least <= fit.gain / self.usual[1] <= 1.0 / least

    def _is_itself(self, fit: Fit) -> bool:
        """Whether a fit of odd gain is as good as the body's would be, were it only lit otherwise: where light falls,
        what is wrong with the fit falls with it, but the noise stays."""
        if not (LEAST_LIGHT <= fit.gain / self.usual[1] <= 1.0 / LEAST_LIGHT and fit.inlier >= SAME_INLIER):
            return False
        if not 1.0 / SAME_LEVEL <= fit.level / (fit.gain * self.template.mean_grey) <= SAME_LEVEL:
            return False
        noise = self._noise_share * max(1.0 / fit.gain**2 - 1.0 / self.usual[1] ** 2, 0.0)
        expected = 1.0 / math.sqrt(1.0 / (self.usual[0] or 1.0) ** 2 + noise)
        return fit.zncc >= USUAL_SHARE * expected

    def _parent_placement(self, step: int) -> Placement | None:
        """The parent's placement at this step; None without a parent or when the parent is lost."""
        if self.parent is None or self.parent.absolute.newest_step() != step:
            return None
        return self.parent.absolute.newest()

    def _placement(self, pose: NDArray[np.float64]) -> Placement:
        centre_x, centre_y = self.template.centre_px
        return np.array([pose[0], centre_x + pose[1], centre_y + pose[2]])

    def _pose(self, place: Placement | None, relative: Placement | None, step: int) -> NDArray[np.float64]:
        """Pose at a placement in the picture, or at one relative to the parent where the parent's is known."""
        parent_now = self._parent_placement(step)
        if parent_now is not None and relative is not None:
            place = from_parent(relative, parent_now)
        assert place is not None, "start() gives every body a first placement"
        centre_x, centre_y = self.template.centre_px
        return np.array([place[0], place[1] - centre_x, place[2] - centre_y])
