"""Regions of the reference that move as one, and their outlines.

Method: the frames turned back by a motion agree with the reference where the picture shows the body that moves so.
Pixels that one motion explains clearly better than all others are sure; from them the regions grow over what is flat or
uncertain up to the edges of the picture (watershed: F. Meyer, Color image segmentation, IEE Conf. 354, 1992; OpenCV's).
An outline is simplified to at most `MOST_CORNERS` corners; where two overlap, the smaller body keeps its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import signed_distance
from vision.proposals.motion_groups import Groups, Motion
from vision.proposals.point_tracks import PointTracks

SMOOTH_PX = 2.0
HIDDEN = 0.6
"""Share of the frames in which a pixel may be hidden."""
CLEARLY = 0.6
"""Difference left by the best motion over that of the next from which a pixel is sure."""
LARGEST = 4.0
"""Difference over the noise that may be left."""
DIFFERENT = 25.0
"""Largest difference over the noise that is counted, so that one frame does not decide."""
AROUND_PX = 8
"""Beyond this around the sure pixels of a body nothing belongs to it."""
RIM_PX = 24.0
"""Width of what may be taken off a region's rim because it is as flat as what lies beside it."""
SLOPE, LEAST_SLOPE = 2.0, 2.0
"""Slope up to which a picture is flat: over the noise, and grey of 255 per px."""
MIN_AREA_PX = 400
MOST_CORNERS = 20
Mask = NDArray[np.uint8]


def left_over(tracks: PointTracks, groups: Groups) -> NDArray[np.float32]:
    """What each motion leaves of the frames at every pixel of the reference, over the noise, (m, height, width)."""
    reference = tracks.reference.astype(np.float32)
    left = []
    for motion in groups.motions:
        most = DIFFERENT * tracks.noise_grey
        frames = [
            _smooth(np.minimum(np.abs(turned_back(tracks.pictures[step], matrix) - reference), most))
            for step, matrix in zip(groups.key, motion.matrices(), strict=True)
        ]
        left.append(np.quantile(np.stack(frames), 1.0 - HIDDEN, axis=0) / tracks.noise_grey)
    return np.asarray(left, dtype=np.float32)


def turned_back(picture: NDArray[np.uint8], matrix: NDArray[np.float64]) -> NDArray[np.float32]:
    """A frame with the body where it is in the reference; far from any grey value where the frame does not show it."""
    size, flags = picture.shape[::-1], cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    grey = picture.astype(np.float32)
    return np.asarray(cv2.warpAffine(grey, matrix, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=1e4))


def regions(tracks: PointTracks, groups: Groups) -> list[tuple[Motion, Mask]]:
    """Each motion with its region, largest first; motions of which no region is left are left out."""
    left = left_over(tracks, groups)
    order = np.sort(left, axis=0)
    sure = (order[0] < np.maximum(CLEARLY * order[1], order[1] - LARGEST)) & (order[0] < LARGEST)
    best = np.where(sure, np.argmin(left, axis=0), -1)
    marks = np.zeros(best.shape, dtype=np.int32)
    near = np.zeros(best.shape, dtype=np.uint8)
    for i in range(1, len(groups.motions)):
        own = _opened(np.asarray(best == i, dtype=np.uint8), 3)
        points = tracks.place_px[groups.group == i, 0]
        own = _with_points(own, points, tracks.spacing_px)
        if np.count_nonzero(own) < MIN_AREA_PX // 8:
            continue
        marks[own > 0] = i + 1
        hull = cv2.convexHull(np.argwhere(own > 0)[:, ::-1].astype(np.int32))
        near |= _dilated(np.asarray(cv2.fillConvexPoly(np.zeros_like(near), hull, 1), dtype=np.uint8), AROUND_PX)
    marks[(marks == 0) & ((best == 0) | (near == 0))] = 1
    colour = cv2.cvtColor(cv2.GaussianBlur(tracks.reference, (0, 0), 1.0), cv2.COLOR_GRAY2BGR)
    grown = cv2.watershed(colour, marks)
    found = []
    for i, motion in enumerate(groups.motions[1:], start=1):
        own = grown == i + 1
        mask = _whole(np.asarray(own & ~flat_rim(own, grown == 1, tracks), dtype=np.uint8), widened=True)
        if mask is not None:
            found.append((motion, mask))
    found.sort(key=lambda item: -int(np.count_nonzero(item[1])))
    return found


def flat_rim(region: NDArray[np.bool_], rests: NDArray[np.bool_], tracks: PointTracks) -> NDArray[np.bool_]:
    """What of a region is as flat as the rest beside it: there a body's edge lies further in."""
    gx, gy = (cv2.Sobel(tracks.reference, cv2.CV_32F, *axes, scale=0.125) for axes in ((1, 0), (0, 1)))
    flat = np.hypot(gx, gy) < max(SLOPE * tracks.noise_grey, LEAST_SLOPE)
    far = cv2.distanceTransform(np.asarray(~rests, dtype=np.uint8), cv2.DIST_L2, 5)
    count, labels = cv2.connectedComponents(np.asarray(region & flat & (far < RIM_PX), dtype=np.uint8), connectivity=4)
    beside = np.zeros(count, dtype=bool)
    beside[np.unique(labels[far < 3.0])] = True
    beside[0] = False
    return np.asarray(beside[labels])


def outlines(masks: Sequence[Mask]) -> list[NDArray[np.float64] | None]:
    """An outline (k, 2) for each region, largest first, simple and without overlap; None where too little is left."""
    taken = np.zeros(masks[0].shape, dtype=bool) if masks else np.zeros((0, 0), dtype=bool)
    result: list[NDArray[np.float64] | None] = []
    for mask in reversed(masks):  # the smaller lies in front more often
        polygon = None
        for widened in (0, 3, 6, 9):
            free = mask & ~_dilated(taken.astype(np.uint8), widened)
            whole = _whole(free)
            polygon = None if whole is None else _simple(whole)
            if polygon is None or not np.any((signed_distance(polygon, *mask.shape) > 0.0) & taken):
                break
        else:
            polygon = None
        if polygon is not None:
            taken |= signed_distance(polygon, *mask.shape) > 0.0
        result.append(polygon)
    return result[::-1]


def _simple(mask: Mask) -> NDArray[np.float64] | None:
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(contours, key=cv2.contourArea)
    for tolerance in np.arange(1.0, 12.0, 0.5):
        polygon = cv2.approxPolyDP(largest, float(tolerance), True)[:, 0].astype(float)
        if len(polygon) <= MOST_CORNERS:
            return polygon if len(polygon) >= 3 else None
    return None


def _whole(mask: Mask, widened: bool = False) -> Mask | None:
    """The largest connected part, smoothed and without holes; None where it is too small. ``widened`` is what smoothing
    has made too wide."""
    narrow = np.asarray(cv2.erode(mask, _disc(5)), dtype=np.uint8) if widened else mask
    smooth = _opened(np.asarray(cv2.morphologyEx(narrow, cv2.MORPH_CLOSE, _disc(5)), dtype=np.uint8), 5)
    contours, _ = cv2.findContours(smooth, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    largest = max(contours, key=cv2.contourArea)
    if cv2.contourArea(largest) < MIN_AREA_PX:
        return None
    return np.asarray(cv2.drawContours(np.zeros_like(mask), [largest], -1, 1, cv2.FILLED), dtype=np.uint8)


def _with_points(mask: Mask, points: NDArray[np.float64], spacing_px: float) -> Mask:
    """Only the parts of a mask near points of the same motion."""
    near = np.zeros_like(mask)
    for x, y in np.rint(points).astype(int):
        near[y, x] = 1
    return mask & _dilated(near, int(max(3.0 * spacing_px, 16.0)))


def _dilated(mask: Mask, by_px: int) -> Mask:
    return np.asarray(cv2.dilate(mask, _disc(2 * by_px + 1)), dtype=np.uint8)


def _opened(mask: Mask, size: int) -> Mask:
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, _disc(size)), dtype=np.uint8)


def _disc(size: int) -> Mask:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), dtype=np.uint8)


def _smooth(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), SMOOTH_PX))
