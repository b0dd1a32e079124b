"""Outlines proposed from the film itself, for the user to inspect and correct.

Meant for the first film of a camera setting; the tracker never uses a proposal that nobody has seen.

Method: pixels whose grey value varies in time more than noise explains show where anything moves. A textured square
among them, the seed, is tracked through the film like a body; frames turned back by its poses agree with the reference
exactly where the film shows the same rigid body, and disagree elsewhere. The connected region around the seed that
agrees is an outline; the next seed is taken from what is left. Bodies that never move relative to each other are one
outline; what shows no texture is not found. Parents, and which body is in front, are left to the user.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import Body
from vision.errors import TrackingError, VisionInputError, VisionWarning
from vision.film.source import FrameSource
from vision.reference.still_average import Reference, average_still_frames
from vision.results.track_result import TrackResult
from vision.tracking.track_film import track

SAMPLES = 40
"""Frames used for the variance, spread over the film."""
VARIES = 3.0
"""Standard deviation in time over the noise, above which a pixel counts as moving."""
SEED_PX = 34
KEY_FRAMES = 15
AGREES = 0.5
"""Largest share of the difference from the reference that may be left after turning back."""
NOISE_LEFT = 1.6
"""Difference after turning back, over the noise, that a pixel of the body may have."""
FLAT = 0.4
"""Local spread of grey values, over that of the moving pixels, below which a pixel cannot tell motions apart."""
FOUND_SHARE = 0.6
"""Frames in which a seed must be found to count as a body."""
MIN_AREA_PX = 500
MAX_BODIES = 8
MAX_FRAMES = 400
SMOOTH_PX = 2.5


def propose_bodies(film: FrameSource) -> list[Body]:
    """Outlines of the rigid bodies that move, largest first, named ``body1``, ``body2``, …

    Parameters
    ----------
    film : FrameSource
        Begins with still frames.

    Returns
    -------
    list of Body
        To be looked at, corrected and named.

    Raises
    ------
    TrackingError
        Nothing moves as a rigid textured body.

    Examples
    --------
    >>> import vision
    >>> with vision.open_film("film.mraw") as film:
    ...     vision.propose_bodies(film)[0].name
    'body1'
    """
    still = average_still_frames(film, np.ones((film.height, film.width), dtype=bool), max_still=16)
    sample = np.unique(np.linspace(0, film.n_frames - 1, SAMPLES).astype(int))
    difference = np.stack([_difference(film.read(int(i)), still, None) for i in sample])
    moves = _smooth(np.median(difference, axis=0)) > 1.0
    moves |= _smooth(np.sqrt(np.mean(difference**2, axis=0))) > VARIES
    gx, gy = (cv2.Sobel(still.picture, cv2.CV_32F, *axes, scale=0.125) for axes in ((1, 0), (0, 1)))
    texture = np.minimum(cv2.boxFilter(gx * gx, -1, (SEED_PX, SEED_PX)), cv2.boxFilter(gy * gy, -1, (SEED_PX, SEED_PX)))
    # flat pixels agree with any motion; flat means little local spread, compared with that of the moving pixels
    mean = cv2.boxFilter(still.picture, -1, (9, 9))
    spread = np.sqrt(np.maximum(cv2.boxFilter(still.picture**2, -1, (9, 9)) - mean**2, 0.0))
    telling = spread > np.maximum(FLAT * np.median(spread[moves]) if moves.any() else 0.0, still.noise_grey)
    free = moves & telling
    found: list[_Region] = []
    for _ in range(4 * MAX_BODIES):
        if len(found) == MAX_BODIES:
            break
        share = cv2.boxFilter(free.astype(np.float32), -1, (SEED_PX, SEED_PX))
        score = np.where(share > 0.7, texture * share, 0.0)
        half = SEED_PX // 2 + 2
        score[:half], score[-half:], score[:, :half], score[:, -half:] = 0.0, 0.0, 0.0, 0.0
        if score.max() <= max(still.noise_grey, 0.3) ** 2 * 0.25:
            break
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        at = tuple(slice(v - SEED_PX // 4, v + SEED_PX // 4 + 1) for v in (row, column))
        region = _around(film, still, int(row), int(column), telling)
        free[at] = False
        if region is None:
            continue
        free &= ~cv2.dilate(region.mask, np.ones((7, 7), np.uint8)).astype(bool)
        twin = next((other for other in found if other.moves_like(region)), None)
        if twin is not None:
            twin.mask |= region.mask
        else:
            found.append(region)
    outlines = [outline for region in found if (outline := _outline(region.mask)) is not None]
    if not outlines:
        raise TrackingError(f"{film.path}: no rigid textured body moves enough to be outlined; draw outlines by hand")
    outlines.sort(key=lambda item: -item[0])
    return [Body(f"body{i + 1}", polygon) for i, (_, polygon) in enumerate(outlines)]


@dataclass
class _Region:
    """Pixels that move as one, and how: picture matrices (n, 2, 3) from the still picture to each frame."""

    mask: NDArray[np.uint8]
    motion: NDArray[np.float64]

    def moves_like(self, other: _Region) -> bool:
        """Whether both motions move the pixels alike, to two pixels in most frames."""
        rows, columns = np.nonzero(self.mask | other.mask)
        points = np.stack([columns[:: max(1, rows.size // 50)], rows[:: max(1, rows.size // 50)]]).astype(float)
        apart = [m[:, :, :2] @ points + m[:, :, 2:] for m in (self.motion, other.motion)]
        distance = np.hypot(*np.moveaxis(apart[0] - apart[1], 1, 0))
        known = np.isfinite(distance).all(axis=1)
        return bool(known.any() and np.quantile(distance[known].max(axis=1), 0.8) < 2.0)


def _smooth(picture: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), SMOOTH_PX))


def _difference(frame: NDArray[Any], still: Reference, warp: NDArray[np.float64] | None) -> NDArray[np.float32]:
    """Frame, turned back by ``warp`` where given, less the still picture, over the noise; flicker taken out."""
    grey = frame.astype(np.float32)
    grey *= np.float32(np.median(still.picture) / max(float(np.median(grey)), 1e-6))
    if warp is not None:
        size = (grey.shape[1], grey.shape[0])
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        warped = cv2.warpAffine(grey, warp, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=1e4)
        grey = np.asarray(warped, dtype=np.float32)
    return np.asarray((grey - still.picture) / np.float32(max(still.noise_grey, 0.5)))


def _around(film: FrameSource, still: Reference, row: int, column: int, telling: NDArray[np.bool_]) -> _Region | None:
    """Pixels that move with a square; None when the square cannot be tracked or does not move."""
    half = 0.5 * SEED_PX + 4.0
    corners = [[-half, -half], [half, -half], [half, half], [-half, half]]
    square = Body("seed", np.array(corners) + (column, row))
    every = max(1, film.n_frames // MAX_FRAMES)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VisionWarning)
            tracked = track(film, [square], np.arange(float(film.n_frames)), every=every, confirm="none")
    except VisionInputError:
        return None
    keys = _key_rows(tracked)
    if keys.size < 3:
        return None
    c, sn = np.cos(tracked.angle_rad[:, 0]), np.sin(tracked.angle_rad[:, 0])
    turn = np.moveaxis(np.array([[c, sn], [-sn, c]]), 2, 0)
    place = np.stack([tracked.x_px[:, 0], tracked.y_px[:, 0]], axis=-1)
    motion = np.concatenate([turn, (place - turn @ place[0])[:, :, None]], axis=2)
    static, turned = [], []
    for key in keys:
        frame = film.read(int(tracked.frame[key]))
        static.append(np.abs(_difference(frame, still, None)))
        turned.append(np.abs(_difference(frame, still, motion[key])))
    # the lower quartile over the frames: a body in front hides a pixel in some of them
    moved, left = (_smooth(np.quantile(np.stack(v), q, axis=0)) for v, q in ((static, 0.6), (turned, 0.35)))
    agrees = ((left < AGREES * moved) & (left < NOISE_LEFT) & telling).astype(np.uint8)
    ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
    closed = cv2.morphologyEx(cv2.morphologyEx(agrees, cv2.MORPH_CLOSE, ellipse), cv2.MORPH_OPEN, ellipse)
    _, labels = cv2.connectedComponents(closed)
    inside = labels[row - 6 : row + 7, column - 6 : column + 7]
    values, counts = np.unique(inside[inside > 0], return_counts=True)
    if values.size == 0:
        return None
    return _Region(np.asarray(labels == values[np.argmax(counts)], dtype=np.uint8), motion)


def _key_rows(tracked: TrackResult) -> NDArray[np.intp]:
    """Rows spread over the motion in which the square is found and has moved by more than a pixel or a degree."""
    known = ~tracked.failed[:, 0]
    if known.mean() < FOUND_SHARE or not known[0]:
        return np.zeros(0, dtype=np.intp)
    way = np.hypot(tracked.x_px[:, 0] - tracked.x_px[0, 0], tracked.y_px[:, 0] - tracked.y_px[0, 0])
    way = way + np.degrees(np.abs(tracked.angle_rad[:, 0]))
    rows = np.flatnonzero(known & (way > 1.0))
    if rows.size == 0:
        return rows
    order = rows[np.argsort(way[rows])]
    return np.asarray(np.unique(order[np.linspace(0, order.size - 1, KEY_FRAMES).astype(int)]))


def _outline(mask: NDArray[np.uint8]) -> tuple[int, NDArray[np.float64]] | None:
    """Area and outline of a region; None when it is too small."""
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (11, 11)))
    # smoothing has widened it
    contours, _ = cv2.findContours(
        cv2.erode(closed, np.ones((5, 5), np.uint8)), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    if not contours:
        return None
    largest = max(contours, key=cv2.contourArea)
    area = int(cv2.contourArea(largest))
    if area < MIN_AREA_PX:
        return None
    polygon = cv2.approxPolyDP(largest, 1.5, True)[:, 0, :].astype(float)
    return (area, polygon) if len(polygon) >= 3 else None
