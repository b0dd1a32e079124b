"""Calibrate the camera's projection of the plane of motion from a film of a target in that plane.

OpenCV finds the target's corners or dots; views of one plane cannot separate lens from tilt well enough for a full
calibration, so only what distorts the plane itself is fitted: stretch, shear, perspective and radial distortion, the
same in all frames, and the target's turn and place in each.

SciPy's least squares over all points; covariance from the residuals. Frames at rest are averaged first: their errors
are not independent. Moving the target between frames shows whether it stays in the plane (then the residual is small).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from vision.angles import turn_matrix
from vision.camera.model import EXPECTED_TURN_RAD, MAX_DISTORTION, CalibratedCamera, build_projection
from vision.errors import VisionInputError
from vision.film.source import FrameSource

TARGETS = ("checkerboard", "dots")
CORNER_SHARE = 0.3  # of the distance of corners, that the window of one reaches to each side: to no other edge
CORNER_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)  # iterations, last step in px: converged
DOT_SHARE = 0.4  # of the distance of dots, that the window of one reaches: the next begins at a half
LEAST_DOT_PX = 4.0  # diameter of a dot, and distance of two
PAPER = 0.9  # quantile of the grey values around a dot, that is paper
BRIGHTEST = 0.999  # quantile of the grey values, that is white: glints and defect pixels lie above
LEAST_FREEDOM = 8  # degrees, with which the residual is known to a quarter
MOST_CONDITION = 1e9  # of the scaled Jacobian: beyond it the target does not fix the view
GRID_PX = 10.0  # from point to point of the block: choice
EDGE = 0.15  # of the spanned part, that the block's middle keeps from its edge: choice
AT_REST_PX = 0.3  # frames whose points moved less than this since the last view are averaged with it
MAX_VIEWS = 40  # that are used, evenly spread over those found: the fit has three unknowns for each
MISTAKEN = 3.0  # residual of a view, over the usual one, above which it is left out
CORRELATED = 2.0
"""Neighbouring points have correlated errors: variance of the parameters over that from independent points, as found on
synthetic targets (root mean square of error over uncertainty 1.4 without)."""
BLOCK_PX = (120.0, 40.0)  # body for which the effect on angles is stated


@dataclass(frozen=True)
class Target:
    """A flat grid of points.

    Parameters
    ----------
    kind : {"checkerboard", "dots"}
    columns, rows : int
        Inner corners of the checkerboard, or dots.
    pitch_m : float
        Distance of neighbouring points.
    """

    kind: str
    columns: int
    rows: int
    pitch_m: float

    def __post_init__(self) -> None:
        if self.kind not in TARGETS:
            raise VisionInputError(f"target {self.kind!r} is not known; choose {' or '.join(TARGETS)}")
        if min(self.columns, self.rows) < 3:
            raise VisionInputError(f"target of {self.columns} x {self.rows} points; each side needs 3 or more")
        if not 0.0 < self.pitch_m < np.inf:
            raise VisionInputError(f"target pitch {self.pitch_m} m; needs a positive length")

    def points_m(self) -> NDArray[np.float64]:
        """Points in their own axes, shape (rows * columns, 2), row by row, y as in the picture."""
        x, y = np.meshgrid(np.arange(self.columns, dtype=float), np.arange(self.rows, dtype=float))
        return self.pitch_m * np.stack([x.ravel(), y.ravel()], axis=-1)


@dataclass(frozen=True)
class Calibration:
    """Result of `calibrate`.

    Attributes
    ----------
    camera : CalibratedCamera
    residual_px : float
        Root mean square distance of the points from the fitted view, per axis.
    n_points, n_views, n_frames : int
        Points in the views that were used; these views, which differ; frames in which the target was found.
    coverage : float
        Share of the picture that the points span.
    effect_rad : float
        Largest error of an angle that the view causes without correction: a block of 120 x 40 px anywhere in the
        spanned part, turned by 15 degrees.
    u_effect_rad : float
        Largest standard uncertainty that is left of it with correction.
    """

    camera: CalibratedCamera
    residual_px: float
    n_points: int
    n_views: int
    n_frames: int
    coverage: float
    effect_rad: float
    u_effect_rad: float


def find_points(picture: NDArray[Any], target: Target) -> NDArray[np.float64] | None:
    """Points (x, y) of the target in a picture, row by row, shape (rows * columns, 2), px; None unless all of them are
    in view."""
    top = float(np.quantile(picture, BRIGHTEST))
    grey = np.clip(np.asarray(picture, dtype=float) * (255.0 / max(top, 1.0)), 0, 255).astype(np.uint8)
    size = (target.columns, target.rows)
    if target.kind == "checkerboard":
        found, points = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if found:  # whose corners are off by a sixth of a pixel
            half = max(int(CORNER_SHARE * _spacing(np.asarray(points, dtype=float).reshape(-1, 2))), 2)
            points = cv2.cornerSubPix(grey, points.astype(np.float32), (half, half), (-1, -1), CORNER_STOP)
    else:
        found, points = cv2.findCirclesGrid(
            grey, size, flags=cv2.CALIB_CB_SYMMETRIC_GRID, blobDetector=_create_dot_detector(grey.size)
        )
        if found:
            points = _refine_dot_centres(grey, np.asarray(points, dtype=float).reshape(-1, 2))
    return np.asarray(points, dtype=float).reshape(-1, 2) if found else None


def calibrate(film: FrameSource, target: Target, every: int = 1) -> Calibration:
    """Calibrate the camera from a target moved in the plane of motion, found in one frame in ``every`` of a film or
    folder of pictures; also residual, coverage and effect on angles. `VisionInputError` where it is not found or does
    not fix the view.

    Parameters
    ----------
    film, target : FrameSource, Target
    every : int
        Use one frame out of this many.

    Returns
    -------
    Calibration

    Raises
    ------
    VisionInputError
        The target is not found, or its points are too few or badly spread.

    Examples
    --------
    >>> import vision
    >>> with vision.open_film("target.mraw") as film:
    ...     vision.calibrate(film, vision.Target("checkerboard", columns=9, rows=6, pitch_m=5e-3)).n_frames
    12
    """
    views: list[list[NDArray[np.float64]]] = []
    n_frames = 0
    for index in range(0, film.n_frames, every):
        points = find_points(film.read(index), target)
        if points is None:
            continue
        n_frames += 1
        if views and np.abs(points - views[-1][0]).max() < AT_REST_PX:
            views[-1].append(points)
        else:
            views.append([points])
    if not views:
        raise VisionInputError(
            f"{film.path}: no {target.kind} of {target.columns} x {target.rows} points found in "
            f"{len(range(0, film.n_frames, every))} frames; count inner corners, and keep all of it in view"
        )
    used = np.linspace(0, len(views) - 1, min(len(views), MAX_VIEWS)).round().astype(int)
    seen = [np.mean(views[i], axis=0) for i in used]
    camera, residual_px, rest = _fit_camera(film, target, seen)
    # a view in which a point was mistaken for another spoils the fit; its residual stands out
    spread = np.sqrt(np.mean(rest**2, axis=(1, 2)))
    good = [points for points, own in zip(seen, spread, strict=True) if own <= MISTAKEN * np.median(spread)]
    if len(good) < len(seen):
        seen, (camera, residual_px, _) = good, _fit_camera(film, target, good)
    everything = np.concatenate(seen)
    span = np.ptp(everything, axis=0)
    coverage = float(span[0] * span[1] / (film.width * film.height))
    effect, u_effect = angle_errors(camera, everything.min(axis=0), everything.max(axis=0))
    return Calibration(
        camera, residual_px, sum(v.shape[0] for v in seen), len(seen), n_frames, coverage, effect, u_effect
    )


def angle_errors(
    camera: CalibratedCamera,
    low_px: NDArray[np.float64],
    high_px: NDArray[np.float64],
    turn_rad: float = EXPECTED_TURN_RAD,
) -> tuple[float, float]:
    """Largest angle error without correction, and largest standard uncertainty with it, rad, of a block of 120 x 40 px
    that turns by ``turn_rad`` anywhere between the corners ``low_px`` and ``high_px`` (x, y) of a part of the picture.
    """
    x, y = np.meshgrid(*(np.linspace(-0.5, 0.5, round(side / GRID_PX) + 1) * side for side in BLOCK_PX))
    block = np.stack([x.ravel(), y.ravel()], axis=-1)
    size = camera.width, camera.height
    seen_by = [build_projection(camera.parameters, *size), *(one.projection for one in camera.variants(*size))]
    worst = u_worst = 0.0
    shares = (EDGE, 0.5, 1.0 - EDGE)
    for place in (low_px + (high_px - low_px) * np.array([u, v]) for u in shares for v in shares):
        for start in 0.25 * np.pi * np.arange(4):
            before, after = (place + block @ turn_matrix(a).T for a in (start, start + turn_rad))
            errors = [_rigid_turn(view.to_picture(before), view.to_picture(after)) - turn_rad for view in seen_by]
            worst = max(worst, abs(errors[0]))
            u_worst = max(u_worst, float(np.sqrt(np.sum((np.array(errors[1:]) - errors[0]) ** 2))))
    return worst, u_worst


def _fit_camera(
    film: FrameSource, target: Target, corners_px: Sequence[NDArray[np.float64]]
) -> tuple[CalibratedCamera, float, NDArray[np.float64]]:
    """Fit the camera to the target's points (points, 2) in each view, ``corners_px``; returns it, the root mean square
    residual per axis, px, and the residuals (views, points, 2). `VisionInputError` where the points do not fix it."""
    board = target.points_m() - target.points_m().mean(axis=0)
    centre = build_projection(np.zeros(5), film.width, film.height).centre_px
    scales, places = [], []
    for points in corners_px:
        flat = board @ np.linalg.lstsq(board, points - points.mean(axis=0), rcond=None)[0]
        turn = _rigid_turn(board, flat)
        scales.append(float(np.sum((board @ turn_matrix(turn).T) * flat) / np.sum(board**2)))
        places.append(np.array([turn, *(points.mean(axis=0) - centre)]))
    start = [np.zeros(5), np.array([np.mean(scales)]), *places]

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        projection = build_projection(
            np.array([*x[:4], np.clip(x[4], -MAX_DISTORTION, MAX_DISTORTION)]), film.width, film.height
        )
        off = []
        for i, points in enumerate(corners_px):
            turn, tx, ty = x[6 + 3 * i : 9 + 3 * i]
            plane = centre + np.array([tx, ty]) + x[5] * (board @ turn_matrix(turn).T)
            off.append(projection.to_picture(plane) - points)
        return np.concatenate(off).ravel()

    step = np.concatenate([np.full(5, 1e-3), [1e-3 * start[1][0]], np.tile([1e-3, 1.0, 1.0], len(corners_px))])
    found = least_squares(residuals, np.concatenate(start), x_scale=step, method="lm", xtol=1e-13, ftol=1e-13)
    rest = found.fun
    freedom = rest.size - found.x.size
    if freedom < LEAST_FREEDOM:
        raise VisionInputError(f"{film.path}: {rest.size // 2} points are too few; use a target with more")
    scaled = found.jac * step
    if np.linalg.cond(scaled) > MOST_CONDITION:
        raise VisionInputError(
            f"{film.path}: the points do not fix the view; use a larger target, spread over the picture"
        )
    covariance = CORRELATED * np.outer(step, step) * np.linalg.inv(scaled.T @ scaled) * float(rest @ rest) / freedom
    if abs(found.x[4]) >= MAX_DISTORTION:
        raise VisionInputError(
            f"{film.path}: distortion of {100 * found.x[4]:.0f} % at the corner; is it the right target?"
        )
    scale, u_scale = float(found.x[5]), float(np.sqrt(covariance[5, 5]))
    camera = CalibratedCamera(film.width, film.height, found.x[:5], covariance[:5, :5], scale, u_scale)
    return camera, float(np.sqrt(rest @ rest / freedom)), rest.reshape(len(corners_px), -1, 2)


def _rigid_turn(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    """Turn that takes one set of points nearest to the other, rad."""
    a, b = before - before.mean(axis=0), after - after.mean(axis=0)
    return float(np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b)))


def _spacing(points: NDArray[np.float64]) -> float:
    """Typical distance of a point to its nearest neighbour, px."""
    apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)) + 1e9 * np.eye(len(points))
    return float(np.median(apart.min(axis=1)))


def _create_dot_detector(n_pixels: int) -> Any:
    wanted = cv2.SimpleBlobDetector.Params()
    wanted.minArea, wanted.maxArea = 0.25 * np.pi * LEAST_DOT_PX**2, n_pixels / 3.0
    wanted.minDistBetweenBlobs = LEAST_DOT_PX
    return cv2.SimpleBlobDetector.create(wanted)


def _refine_dot_centres(grey: NDArray[np.uint8], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centres of mass (n, 2) of the dots' darkness around ``points`` (n, 2), px, within `DOT_SHARE` of their
    distance."""
    half = max(3, int(DOT_SHARE * _spacing(points)))
    result = points.astype(float).copy()
    for _ in range(3):
        for i, (x, y) in enumerate(result):
            x0, y0 = round(x) - half, round(y) - half
            patch = grey[max(0, y0) : y0 + 2 * half + 1, max(0, x0) : x0 + 2 * half + 1].astype(float)
            rows, columns = np.indices(patch.shape)
            rows, columns = rows + max(0, y0), columns + max(0, x0)
            round_window = np.clip(half + 0.5 - np.hypot(columns - x, rows - y), 0.0, 1.0)
            dark = np.clip(np.quantile(patch, PAPER) - patch, 0.0, None)
            dark = np.where(dark > 0.25 * dark.max(), dark, 0.0) * round_window
            if dark.sum() > 0.0:
                result[i] = (np.sum(dark * columns) / dark.sum(), np.sum(dark * rows) / dark.sum())
    return result
