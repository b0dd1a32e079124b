"""Find a lost body again: searches over turn and shift that need no good initial guess.

Method: the template is turned in steps and slid over the region where the body is expected, at half the resolution,
with normalised correlation under its mask (OpenCV `matchTemplate`). The best few, one per turn, are the initial guesses
for a fit. A body that is not near its last place is looked for in the whole picture and at every turn, at a quarter of
the resolution; the best places are then searched around as before.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource
from vision.fitting.template import Template

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
    found: list[tuple[float, NDArray[np.float64]]] = []
    for phi in newest_rad + np.arange(-math.pi, math.pi - 1e-9, FAR_TURN_STEP_RAD):
        patch, mask, offset_x, offset_y = _turned(template, float(phi), 4)
        if min(patch.shape) < FAR_LEAST_PX or patch.shape[0] >= small.shape[0] or patch.shape[1] >= small.shape[1]:
            return []
        score = cv2.matchTemplate(small, patch, cv2.TM_CCOEFF_NORMED, mask=mask)
        score[~np.isfinite(score)] = -1.0
        _, best, _, (column, row) = cv2.minMaxLoc(score)
        x, y = 4.0 * (column + offset_x) - border + 1.5, 4.0 * (row + offset_y) - border + 1.5
        found.append((best, np.array([phi, x - template.centre_px[0], y - template.centre_px[1]])))
    found.sort(key=lambda item: -item[0])
    places: list[NDArray[np.float64]] = []
    for _, pose in found:
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
    small = _halve(picture)
    found: list[tuple[float, NDArray[np.float64]]] = []
    for turn in np.arange(-TURN_RANGE_RAD, TURN_RANGE_RAD + 1e-9, TURN_STEP_RAD):
        phi = float(expected[0] + turn)
        patch, mask, offset_x, offset_y = _turned(template, phi, 2)
        if patch.shape[0] >= small.shape[0] or patch.shape[1] >= small.shape[1]:
            continue
        score = cv2.matchTemplate(small, patch, cv2.TM_CCOEFF_NORMED, mask=mask)
        score[~np.isfinite(score)] = -1.0
        _, best, _, (column, row) = cv2.minMaxLoc(score)
        x = 2.0 * (column + offset_x) + centre_x - reach + 0.5
        y = 2.0 * (row + offset_y) + centre_y - reach + 0.5
        found.append((best, np.array([phi, x - template.centre_px[0], y - template.centre_px[1]])))
    found.sort(key=lambda item: -item[0])
    return [pose for _, pose in found[:N_CANDIDATES]]


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
