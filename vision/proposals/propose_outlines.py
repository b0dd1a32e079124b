"""Propose outlines of the moving bodies, for the user to inspect and correct.

Meant for the first film of a camera setting; the tracker never uses a proposal that nobody has seen.

Method: textured points are followed through the film (`point_tracks`) and sorted into rigid motions (`motion_groups`),
which fits refine (`motion_groups.refine_groups`); the pixels that each motion explains become its region; pins
and overlaps tell parents and layers. Where most points are lost before the film ends (large turns, glare), its
beginning is tried as well; where nothing moves by a pixel, smaller motions are looked for; the attempt whose outlines
hold most points that move with them is given. Bodies that never move relative to each other are one outline; what shows
no texture and no edge is not found.

Parents and layers: two bodies are pinned where a point exists that both their motions take to the same places. What is
pinned to the ground has no parent; what is pinned to a body already placed has it as parent. Where two regions come to
overlap, the body whose reference agrees with the frame there lies in front.

Regions: the frames turned back by a motion agree with the reference where the picture shows the body that moves so.
Pixels that one motion explains clearly better than all others are sure; from them the regions grow over what is flat or
uncertain up to the edges of the picture (watershed: F. Meyer, Color image segmentation, IEE Conf. 354, 1992; OpenCV's).
An outline is simplified to at most `MOST_CORNERS` corners; where two overlap, the smaller body keeps its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from vision.bodies.outlines import Body, signed_distance
from vision.errors import TrackingError
from vision.film.source import FrameSource
from vision.proposals.motion_groups import USUAL, Distances, Groups, Motion, group_by_motion, refine_groups
from vision.proposals.point_tracks import PointTracks, track_points

SMOOTH_PX = 2.0
HIDDEN = 0.6
"""Share of the frames in which a pixel may be hidden."""
CLEARLY_BETTER = 0.6
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
MIN_AREA_PX = 400  # px^2, of a body
MOST_CORNERS = 20  # of a proposed outline
Mask = NDArray[np.uint8]


def motion_residuals(tracks: PointTracks, groups: Groups) -> NDArray[np.float32]:
    """What each motion leaves of the frames at every pixel of the reference, over the noise, (m, height, width)."""
    reference = tracks.reference.astype(np.float32)
    left = []
    for motion in groups.motions:
        most = DIFFERENT * tracks.noise_grey
        frames = [
            cv2.GaussianBlur(
                np.minimum(np.abs(warp_to_reference(tracks.pictures[step], matrix) - reference), most),
                (0, 0),
                SMOOTH_PX,
            )
            for step, matrix in zip(groups.key, motion.matrices(), strict=True)
        ]
        left.append(np.quantile(np.stack(frames), 1.0 - HIDDEN, axis=0) / tracks.noise_grey)
    return np.asarray(left, dtype=np.float32)


def warp_to_reference(picture: NDArray[np.uint8], matrix: NDArray[np.float64]) -> NDArray[np.float32]:
    """A frame with the body where it is in the reference; far from any grey value where the frame does not show it."""
    size, flags = picture.shape[::-1], cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    grey = picture.astype(np.float32)
    return np.asarray(cv2.warpAffine(grey, matrix, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=1e4))


def find_regions(tracks: PointTracks, groups: Groups) -> list[tuple[Motion, Mask]]:
    """Each motion with its region, largest first; motions of which no region is left are left out."""
    left = motion_residuals(tracks, groups)
    order = np.sort(left, axis=0)
    sure = (order[0] < np.maximum(CLEARLY_BETTER * order[1], order[1] - LARGEST)) & (order[0] < LARGEST)
    best = np.where(sure, np.argmin(left, axis=0), -1)
    marks = np.zeros(best.shape, dtype=np.int32)
    near = np.zeros(best.shape, dtype=np.uint8)
    for i in range(1, len(groups.motions)):
        points = tracks.place_px[groups.group == i, 0]
        own = _parts_near_points(_open_mask(np.asarray(best == i, dtype=np.uint8), 3), points, tracks.spacing_px)
        if np.count_nonzero(own) < MIN_AREA_PX // 8:
            continue
        marks[own > 0] = i + 1
        hull = cv2.convexHull(np.argwhere(own > 0)[:, ::-1].astype(np.int32))
        near |= _dilate(np.asarray(cv2.fillConvexPoly(np.zeros_like(near), hull, 1), dtype=np.uint8), AROUND_PX)
    marks[(marks == 0) & ((best == 0) | (near == 0))] = 1
    colour = cv2.cvtColor(cv2.GaussianBlur(tracks.reference, (0, 0), 1.0), cv2.COLOR_GRAY2BGR)
    grown = cv2.watershed(colour, marks)
    found = []
    for i, motion in enumerate(groups.motions[1:], start=1):
        own = grown == i + 1
        mask = _largest_part(np.asarray(own & ~flat_rim(own, grown == 1, tracks), dtype=np.uint8), widened=True)
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


def trace_outlines(masks: Sequence[Mask]) -> list[NDArray[np.float64] | None]:
    """An outline (k, 2) for each region, largest first, simple and without overlap; None where too little is left."""
    taken = np.zeros(masks[0].shape, dtype=bool) if masks else np.zeros((0, 0), dtype=bool)
    result: list[NDArray[np.float64] | None] = []
    for mask in reversed(masks):  # the smaller lies in front more often
        polygon = None
        for widened in (0, 3, 6, 9):
            free = mask & ~_dilate(taken.astype(np.uint8), widened)
            whole = _largest_part(free)
            polygon = None if whole is None else _simple_outline(whole)
            if polygon is None or not np.any((signed_distance(polygon, *mask.shape) > 0.0) & taken):
                break
        else:
            polygon = None
        if polygon is not None:
            taken |= signed_distance(polygon, *mask.shape) > 0.0
        result.append(polygon)
    return result[::-1]


def _simple_outline(mask: Mask) -> NDArray[np.float64] | None:
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(contours, key=cv2.contourArea)
    for tolerance in np.arange(1.0, 12.0, 0.5):
        polygon = cv2.approxPolyDP(largest, float(tolerance), True)[:, 0].astype(float)
        if len(polygon) <= MOST_CORNERS:
            return polygon if len(polygon) >= 3 else None
    return None


def _largest_part(mask: Mask, widened: bool = False) -> Mask | None:
    """The largest connected part, smoothed and without holes; None where it is too small. ``widened`` is what smoothing
    has made too wide."""
    narrow = np.asarray(cv2.erode(mask, _disc_kernel(5)), dtype=np.uint8) if widened else mask
    smooth = _open_mask(np.asarray(cv2.morphologyEx(narrow, cv2.MORPH_CLOSE, _disc_kernel(5)), dtype=np.uint8), 5)
    contours, _ = cv2.findContours(smooth, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    largest = max(contours, key=cv2.contourArea)
    if cv2.contourArea(largest) < MIN_AREA_PX:
        return None
    return np.asarray(cv2.drawContours(np.zeros_like(mask), [largest], -1, 1, cv2.FILLED), dtype=np.uint8)


def _parts_near_points(mask: Mask, points: NDArray[np.float64], spacing_px: float) -> Mask:
    near = np.zeros_like(mask)
    for x, y in np.rint(points).astype(int):
        near[y, x] = 1
    return mask & _dilate(near, int(max(3.0 * spacing_px, 16.0)))


def _dilate(mask: Mask, by_px: int) -> Mask:
    return np.asarray(cv2.dilate(mask, _disc_kernel(2 * by_px + 1)), dtype=np.uint8)


def _open_mask(mask: Mask, size: int) -> Mask:
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, _disc_kernel(size)), dtype=np.uint8)


def _disc_kernel(size: int) -> Mask:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), dtype=np.uint8)


PINNED_PX = 1.5
"""Largest distance, root mean square over the frames, of the two places of a pin."""
LEAST_TURN_RAD = 0.02
"""Relative turn below which nothing tells a pin from a slide."""
NEAR_PX = 30.0
"""Distance of a pin from the regions of both bodies."""
OVERLAP_PX = 300
"""Pixels, over all frames, in which two regions must overlap to say which is in front."""
CLEARLY = 1.5
"""Ratio of the differences from the frame in the overlap."""
Region = tuple[Motion, NDArray[np.uint8]]


def find_parents(regions: Sequence[Region]) -> list[int | None]:
    """Index of the body each is pinned to; None for the ground, or where no pin is found."""
    rest = Motion(np.tile(np.eye(2), (len(regions[0][0].turn), 1, 1)), np.zeros((len(regions[0][0].turn), 2)))
    outside = [cv2.distanceTransform(np.asarray(1 - mask, np.uint8), cv2.DIST_L2, 5) for _, mask in regions]

    def miss(i: int, j: int | None) -> float:
        found = find_pin(regions[i][0], rest if j is None else regions[j][0])
        if found is None:
            return np.inf
        point, off = found
        near = all(_value_at(outside[k], point) < NEAR_PX for k in (i, j) if k is not None)
        return off if near else np.inf

    # from the ground outwards, the surest pin first
    placed: dict[int, int | None] = {}
    while len(placed) < len(regions):
        left = [i for i in range(len(regions)) if i not in placed]
        best = min(((miss(i, j), i, j) for i in left for j in (None, *placed)), key=lambda found: found[0])
        if best[0] < PINNED_PX:
            placed[best[1]] = best[2]
        elif placed:
            break
        else:
            placed[0] = None  # nothing is pinned to the ground: from the largest
    return [placed.get(i) for i in range(len(regions))]


def find_pin(one: Motion, other: Motion) -> tuple[NDArray[np.float64], float] | None:
    """The point of the reference (x, y) that two motions keep together best, and its distance, root mean square; None
    where they do not turn against each other."""
    turn, shift = one.turn - other.turn, other.shift - one.shift
    if np.abs(turn[:, 1, 0]).max() < LEAST_TURN_RAD:
        return None
    point = np.asarray(np.linalg.lstsq(turn.reshape(-1, 2), shift.reshape(-1), rcond=None)[0], dtype=np.float64)
    off = np.hypot(*(turn @ point - shift).T)
    return point, float(np.sqrt(np.mean(off**2)))


def order_layers(tracks: PointTracks, key: NDArray[np.intp], regions: Sequence[Region]) -> list[int]:
    """Layer of each body, the larger in front; equal where the film does not tell."""
    behind: list[set[int]] = [set() for _ in regions]
    for i in range(len(regions)):
        for j in range(i):
            ratio = _difference_ratio(tracks, key, regions[i], regions[j])
            if ratio > CLEARLY:
                behind[j].add(i)
            elif ratio < 1.0 / CLEARLY:
                behind[i].add(j)
    layers = [0] * len(regions)
    for _ in regions:
        layers = [max([layers[k] + 1 for k in lower], default=0) for lower in behind]
    # as many rounds as bodies end unless the film contradicts itself
    settled = [max([layers[k] + 1 for k in lower], default=0) for lower in behind]
    return layers if settled == layers else [0] * len(regions)


def _difference_ratio(tracks: PointTracks, key: NDArray[np.intp], one: Region, other: Region) -> float:
    """Difference of the frames from the one body's reference where both regions overlap, over that from the other's; 1
    where they hardly do."""
    total, count = np.zeros(2), 0
    for k, step in enumerate(key):
        grey, masks = [], []
        for motion, mask in (one, other):
            matrix = motion.matrices()[k]
            grey.append(cv2.warpAffine(tracks.reference, matrix, mask.shape[::-1]).astype(float))
            masks.append(cv2.warpAffine(cv2.erode(mask, np.ones((5, 5), np.uint8)), matrix, mask.shape[::-1]) > 0)
        overlap = masks[0] & masks[1]
        frame = tracks.pictures[step].astype(float)
        total += [float(np.abs(frame - part)[overlap].sum()) for part in grey]
        count += int(np.count_nonzero(overlap))
    return float(total[0] / max(total[1], 1e-9)) if count >= OVERLAP_PX else 1.0


def _value_at(distance: NDArray[Any], point: NDArray[np.float64]) -> float:
    height, width = distance.shape
    inside = np.clip(np.rint(point), 0.0, [width - 1.0, height - 1.0])
    return float(distance[int(inside[1]), int(inside[0])] + np.hypot(*(point - inside)))


LEAST_FRAMES = 4
LOST = 0.6
"""Share of the points still followed in the last frame below which the film's beginning is tried as well."""
STILL_FOLLOWED = (0.6, 0.4, 0.3)
"""The beginning lasts while such shares of the points are followed."""
NOISES = 5.0
"""Smallest motion that is looked for, over the noise of a followed point."""
LEAST_FACTOR = 0.06  # smallest share of the usual distances
SHAKEN = 0.6
"""Share of the points that shift alike from which a motion of less than a pixel is the camera's."""


def propose_bodies(film: FrameSource) -> list[Body]:
    """Outlines of the rigid bodies that move, largest first, named ``body1``, ``body2``, …

    Parameters
    ----------
    film : FrameSource
        Outlines are drawn on its first frame.

    Returns
    -------
    list of Body
        To be looked at, corrected and named: outlines of at most 20 corners that do not overlap, with the parent a body
        is pinned to and the layer it lies in, where the film tells.

    Raises
    ------
    TrackingError
        Nothing moves as a rigid textured body; the reason is said.

    Examples
    --------
    >>> import vision
    >>> with vision.open_film("film.mraw") as film:
    ...     vision.propose_bodies(film)[0].name
    'body1'
    """
    if film.n_frames < LEAST_FRAMES:
        raise TrackingError(f"{film.path}: {film.n_frames} frames; a proposal needs at least {LEAST_FRAMES}")
    tracks = track_points(film)
    whole = _try_outlines(tracks, USUAL)
    others = [_try_outlines(tracks.beginning(n), USUAL) for n in _shortened_lengths(tracks)]
    rests = len(whole.groups.motions) == 1 and np.count_nonzero(whole.groups.group == 0) > 0.5 * len(tracks.place_px)
    if rests and not whole.bodies and not any(other.bodies for other in others):
        within = USUAL.scale_by(_distance_scale(tracks))
        if not _is_camera_shaking(tracks, within.rests_px):
            others.append(_try_outlines(tracks, within))
    best = max([whole, *others], key=lambda attempt: attempt.points)
    if not best.bodies:
        raise TrackingError(f"{film.path}: {_explain_failure(tracks, whole.groups)}; draw outlines by hand")
    return best.bodies


@dataclass(frozen=True)
class _Attempt:
    """Bodies found, and how many points lie in the outline of the body they move with."""

    bodies: list[Body]
    points: int
    groups: Groups


def _try_outlines(tracks: PointTracks, within: Distances) -> _Attempt:
    groups = refine_groups(tracks, group_by_motion(tracks, within))
    found = find_regions(tracks, groups) if len(groups.motions) > 1 else []
    polygons = trace_outlines([mask for _, mask in found])
    kept = [(region, polygon) for region, polygon in zip(found, polygons, strict=True) if polygon is not None]
    if not kept:
        return _Attempt([], 0, groups)
    own = [region for region, _ in kept]
    parents, layers = find_parents(own), order_layers(tracks, groups.key, own)
    names = [f"body{i + 1}" for i in range(len(kept))]
    bodies = [
        Body(name, polygon, None if parent is None else names[parent], layer)
        for name, (_, polygon), parent, layer in zip(names, kept, parents, layers, strict=True)
    ]
    points = 0
    for (motion, _), polygon in kept:
        which = next(i for i, other in enumerate(groups.motions) if other is motion)
        x, y = np.rint(tracks.place_px[groups.group == which, 0]).astype(int).T
        points += int(np.count_nonzero(signed_distance(polygon, *tracks.reference.shape)[y, x] > 0.0))
    return _Attempt(bodies, points, groups)


def _shortened_lengths(tracks: PointTracks) -> list[int]:
    """Numbers of frames after which the points of the first frame have become few."""
    followed = np.isfinite(tracks.place_px[..., 0]).sum(axis=0) / max(len(tracks.place_px), 1)
    if followed[-1] > LOST:
        return []
    ends = {int(np.count_nonzero(followed > share)) for share in STILL_FOLLOWED}
    return sorted(n for n in ends if LEAST_FRAMES <= n < tracks.frame.size)


def _is_camera_shaking(tracks: PointTracks, rests_px: float) -> bool:
    """Whether most points only shift, all alike: the camera moves."""
    place = tracks.place_px[:, np.isfinite(tracks.place_px[..., 0]).any(axis=0)]
    moved = place - place[:, :1]
    off = np.hypot(*np.moveaxis(moved - np.nanmedian(moved, axis=0), 2, 0))
    return float(np.mean(np.nanquantile(off, 0.8, axis=1) < rests_px)) > SHAKEN


def _distance_scale(tracks: PointTracks) -> float:
    """Share of the usual distances that the noise of the followed points permits: neighbours move alike."""
    moved = tracks.place_px - tracks.place_px[:, :1]
    _, near = KDTree(tracks.place_px[:, 0]).query(tracks.place_px[:, 0], 2)
    apart = np.abs(moved - moved[near[:, 1]])[:, 1:]
    noise = 1.4826 * float(np.nanmedian(apart)) / np.sqrt(2.0)
    return float(np.clip(NOISES * noise / USUAL.rests_px, LEAST_FACTOR, 1.0))


def _explain_failure(tracks: PointTracks, groups: Groups) -> str:
    n = len(tracks.place_px)
    if n == 0:
        return "no part of the picture has texture that could be followed"
    resting = int(np.count_nonzero(groups.group == 0))
    if len(groups.motions) == 1 and resting > 0.5 * n:
        least = USUAL.rests_px
        return f"{resting} of {n} textured points move by less than {least:g} px and the others not as a rigid body"
    return f"of {n} textured points {n - resting} move, but too few of them as one rigid body with an area of its own"
