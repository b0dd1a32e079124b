"""Track textured points through the film.

Points are the most textured of each cell of a grid. They are followed from frame to frame by pyramidal Lucas-Kanade
(J.-Y. Bouguet, Pyramidal implementation of the Lucas-Kanade feature tracker, Intel 2000; OpenCV's), forward and back;
one that does not come back to where it was is lost from there on. The frames are spread over what changes in the film,
so that a short motion in a long film is not stepped over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource

MOST_POINTS = 1600  # that are tracked: one a cell of the picture
LEAST_SPACING_PX = 5.0  # side of the smallest cell
MOST_FRAMES = 60
ACTIVITY_FRAMES = 400  # between which changes are measured
WINDOW_PX = 21  # side of Lucas and Kanade's window
SMOOTH_PX = 1.0
BLACK = 0.05
"""Of the brightest grey values."""
BACK_PX = 0.7
"""Distance by which a point may miss its place when followed back."""
TEXTURE = 0.5
"""Least squared slope of a point, in its weakest direction, over the squared noise."""
LEAST_SLOPE2 = 0.05
"""The same without noise, (grey of 255 per px)^2."""

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class PointTracks:
    """Where n points are in t frames."""

    frame: NDArray[np.intp]
    """(t,): frame numbers, the reference's first."""
    place_px: NDArray[np.float64]
    """(n, t, 2): (x, y); NaN from where a point is lost."""
    spacing_px: float
    """Side of the cells the points were chosen from."""
    reference: Picture
    """(height, width): the first frame, smoothed and stretched over the grey values in use."""
    pictures: NDArray[np.uint8]
    """(t, height, width): the frames in the same grey values, light matched."""
    noise_grey: float
    """Noise of one of the pictures."""

    def beginning(self, n: int) -> PointTracks:
        """The same points in the first ``n`` of the frames."""
        return replace(self, frame=self.frame[:n], place_px=self.place_px[:, :n], pictures=self.pictures[:n])


def track_points(film: FrameSource) -> PointTracks:
    """Follow the most textured points of the picture through the film."""
    first, second = (film.read(index).astype(np.float32) for index in (0, 1))
    low, high = np.quantile(first, [0.002, 0.998])
    factor = 255.0 / max(float(high - low), 1.0)

    def stretch_contrast(grey: NDArray[Any]) -> Picture:
        smooth = cv2.GaussianBlur((grey - low) * factor, (0, 0), SMOOTH_PX)
        return np.asarray(np.clip(smooth, 0.0, 255.0), dtype=np.uint8)

    reference = stretch_contrast(first)
    # most pixels differ by noise, whatever moves
    noise = float(1.4826 * np.median(np.abs(second - first))) / np.sqrt(2.0) * factor
    noise = max(noise / (2.0 * np.sqrt(np.pi) * SMOOTH_PX), 0.3)
    frame = frames_by_activity(film)
    light = _illumination_statistic(first)
    pictures = []
    for index in frame:
        grey = film.read(int(index)).astype(np.float32)
        pictures.append(stretch_contrast(grey * (float(light(first)) / max(float(light(grey)), 1e-6))))
    points, spacing = _select_points(reference, noise)
    place = np.full((len(points), frame.size, 2), np.nan)
    place[:, 0] = points
    alive = np.arange(len(points))
    before = reference
    for step in range(1, frame.size):
        if alive.size == 0:
            break
        there, kept = _track_to_next(before, pictures[step], place[alive, step - 1])
        alive = alive[kept]
        place[alive, step] = there[kept]
        before = pictures[step]
    return PointTracks(frame, place, spacing, reference, np.stack(pictures), noise)


def frames_by_activity(film: FrameSource) -> NDArray[np.intp]:
    """Up to `MOST_FRAMES` frames, the first and the last among them, evenly spread over what changes between frames."""
    looked_at = np.unique(np.linspace(0, film.n_frames - 1, ACTIVITY_FRAMES).astype(int))
    if looked_at.size <= MOST_FRAMES:
        return looked_at
    change, before, light = [0.0], None, None
    for index in looked_at:
        grey = film.read(int(index)).astype(np.float32)
        small = np.asarray(cv2.resize(grey, None, fx=0.125, fy=0.125, interpolation=cv2.INTER_AREA), dtype=np.float32)
        light = light or _illumination_statistic(small)
        small /= max(float(light(small)), 1e-6)
        if before is not None:
            change.append(float(np.abs(small - before).mean()))
        before = small
    steps = np.array(change[1:])
    steps = np.maximum(steps - 1.2 * np.quantile(steps, 0.2), 0.02 * steps.max() + 1e-12)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    return np.unique(np.rint(np.interp(np.linspace(0.0, way[-1], MOST_FRAMES), way, looked_at)).astype(int))


def _illumination_statistic(first: NDArray[Any]) -> Callable[[NDArray[Any]], Any]:
    """What tells the light: the median, which hardly follows what moves, or the mean if the first is mostly black."""
    return np.median if np.median(first) > BLACK * np.quantile(first, 0.998) else np.mean


def _select_points(reference: Picture, noise: float) -> tuple[NDArray[np.float64], float]:
    """The most textured point (x, y) of each cell that has texture, and the side of the cells."""
    height, width = reference.shape
    spacing = max(LEAST_SPACING_PX, float(np.sqrt(height * width / MOST_POINTS)))
    slope = weakest_slope2(reference)
    margin = WINDOW_PX // 2
    slope[:margin], slope[-margin:], slope[:, :margin], slope[:, -margin:] = 0.0, 0.0, 0.0, 0.0
    found = []
    for top in np.arange(0.0, height, spacing):
        for left in np.arange(0.0, width, spacing):
            cell = slope[int(top) : int(top + spacing), int(left) : int(left + spacing)]
            if cell.size and cell.max() > TEXTURE * noise**2 + LEAST_SLOPE2:
                row, column = np.unravel_index(int(np.argmax(cell)), cell.shape)
                found.append((int(left) + column, int(top) + row))
    return np.array(found, dtype=float).reshape(-1, 2), spacing


def weakest_slope2(reference: Picture) -> NDArray[np.float32]:
    """Mean squared slope around every pixel in the direction in which it is least, (grey per px)^2."""
    grey = reference.astype(np.float32)
    gx, gy = (cv2.Sobel(grey, cv2.CV_32F, *axes, scale=0.125) for axes in ((1, 0), (0, 1)))
    xx, yy, xy = (cv2.boxFilter(product, -1, (9, 9)) for product in (gx * gx, gy * gy, gx * gy))
    return np.asarray(0.5 * (xx + yy - np.sqrt((xx - yy) ** 2 + 4.0 * xy * xy)), dtype=np.float32)


def _track_to_next(
    before: Picture, after: Picture, place: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Places of points in the next picture, and which of them come back when followed from there."""
    start = place.astype(np.float32)[:, None]
    there, found, _ = _lucas_kanade(before, after, start)
    back, found_back, _ = _lucas_kanade(after, before, there)
    off = np.hypot(*(back - start)[:, 0].T)
    inside = np.all((there[:, 0] > 1.0) & (there[:, 0] < np.array(before.shape[::-1]) - 2.0), axis=1)
    kept = (found[:, 0] == 1) & (found_back[:, 0] == 1) & (off < BACK_PX) & inside
    return there[:, 0].astype(float), np.asarray(kept)


def _lucas_kanade(before: Picture, after: Picture, start: NDArray[np.float32]) -> Any:
    """OpenCV's; its type hints know no call without initial places."""
    follow: Any = cv2.calcOpticalFlowPyrLK
    return follow(before, after, start, None, winSize=(WINDOW_PX, WINDOW_PX), maxLevel=3)
