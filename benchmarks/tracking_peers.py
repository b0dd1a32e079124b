"""Other tracking methods, for the table of ``benchmarks/tracking.py``: Lucas-Kanade and template matching.

Each takes a film, the templates of its bodies and their reference image (height, width), and returns the angle of
each body in image orientation, rad, (n_frames, n_bodies), NaN where it is lost.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.film.source import Film
from vision.fitting.template import Template


def by_lucas_kanade(film: Film, templates: list[Template], picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Each frame is rotated back by the previous pose, 80 corners are tracked, and a rigid fit gives the increment."""
    phi = np.full((film.n_frames, len(templates)), np.nan)
    corners, poses = [], []
    for template in templates:
        mask = np.zeros(picture.shape, dtype=np.uint8)
        columns, rows = np.rint(template.offset_px + np.array(template.centre_px)[:, None]).astype(int)
        mask[rows, columns] = 255
        corners.append(cv2.goodFeaturesToTrack(picture, 80, 0.01, 5, mask=mask))
        poses.append(np.zeros(3))
    height, width = picture.shape
    for index in range(film.n_frames):
        frame = np.ascontiguousarray(film.read(index))
        for i, template in enumerate(templates):
            turn, tx, ty = poses[i]
            c, s = np.cos(turn), np.sin(turn)
            cx, cy = template.centre_px
            warp = np.array([[c, -s, cx + tx - c * cx + s * cy], [s, c, cy + ty - s * cx - c * cy]])
            back = cv2.warpAffine(frame, warp, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
            found, status, _ = cv2.calcOpticalFlowPyrLK(picture, back, corners[i], None, winSize=(21, 21), maxLevel=2)
            good = status[:, 0] == 1
            if np.count_nonzero(good) < 8:
                continue
            fit, _ = cv2.estimateAffinePartial2D(corners[i][good], found[good], ransacReprojThreshold=0.5)
            if fit is None:
                continue
            more = float(np.arctan2(fit[1, 0], fit[0, 0]))
            centre = fit @ np.array([cx, cy, 1.0])
            moved = warp @ np.array([centre[0], centre[1], 1.0])
            poses[i] = np.array([turn + more, moved[0] - cx, moved[1] - cy])
            phi[index, i] = poses[i][0]
    return phi


def by_templates(film: Film, templates: list[Template], picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Two 31 px squares per body, matched without rotation, with a parabola for the subpixel part."""
    phi = np.full((film.n_frames, len(templates)), np.nan)
    half, reach = 15, 8
    marks = []
    for template in templates:
        offset = template.offset_px.T.astype(float)
        axis = np.linalg.svd(offset - offset.mean(0), full_matrices=False)[2][0]
        along = offset @ axis
        ends = [offset[np.abs(along - np.quantile(along, q)) < 6].mean(0) for q in (0.1, 0.9)]
        marks.append(np.rint(np.array(ends) + template.centre_px).astype(int))
    inside = (half + reach, picture.shape[1] - half - reach - 1, picture.shape[0] - half - reach - 1)
    marks = [np.clip(m, inside[0], inside[1:]) for m in marks]
    patches = [[picture[y - half : y + half + 1, x - half : x + half + 1] for x, y in m] for m in marks]
    places = [m.astype(float) for m in marks]
    for index in range(film.n_frames):
        frame = np.ascontiguousarray(film.read(index))
        for i, pair in enumerate(patches):
            for k, patch in enumerate(pair):
                x, y = np.clip(np.rint(places[i][k]).astype(int), inside[0], inside[1:])
                window = frame[y - half - reach : y + half + reach + 1, x - half - reach : x + half + reach + 1]
                score = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
                _, _, _, (bx, by) = cv2.minMaxLoc(score)
                places[i][k] = (x + bx - reach + peak(score[by], bx), y + by - reach + peak(score[:, bx], by))
            before, now = marks[i][1] - marks[i][0], places[i][1] - places[i][0]
            phi[index, i] = np.arctan2(before[0] * now[1] - before[1] * now[0], before[0] * now[0] + before[1] * now[1])
    return phi


def peak(score: NDArray[Any], at: int) -> float:
    """Subpixel offset of the peak of a parabola through three scores from the highest one."""
    if not 0 < at < score.size - 1:
        return 0.0
    left, middle, right = float(score[at - 1]), float(score[at]), float(score[at + 1])
    bend = left - 2 * middle + right
    return 0.5 * (left - right) / bend if bend < 0 else 0.0
