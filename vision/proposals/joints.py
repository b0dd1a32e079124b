"""Which proposed body turns on which, and which lies in front.

Two bodies are pinned where a point exists that both their motions take to the same places. What is pinned to the
ground has no parent; what is pinned to a body already placed has it as parent. Where two regions come to overlap, the
body whose reference agrees with the frame there lies in front.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.proposals.motion_groups import Motion
from vision.proposals.point_tracks import PointTracks

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


def parents_of(regions: Sequence[Region]) -> list[int | None]:
    """Index of the body each is pinned to; None for the ground, or where no pin is found."""
    rest = Motion(np.tile(np.eye(2), (len(regions[0][0].turn), 1, 1)), np.zeros((len(regions[0][0].turn), 2)))
    outside = [cv2.distanceTransform(np.asarray(1 - mask, np.uint8), cv2.DIST_L2, 5) for _, mask in regions]

    def miss(i: int, j: int | None) -> float:
        found = pin(regions[i][0], rest if j is None else regions[j][0])
        if found is None:
            return np.inf
        point, off = found
        near = all(_at(outside[k], point) < NEAR_PX for k in (i, j) if k is not None)
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


def pin(one: Motion, other: Motion) -> tuple[NDArray[np.float64], float] | None:
    """The point of the reference (x, y) that two motions keep together best, and its distance, root mean square; None
    where they do not turn against each other."""
    turn, shift = one.turn - other.turn, other.shift - one.shift
    if np.abs(turn[:, 1, 0]).max() < LEAST_TURN_RAD:
        return None
    point = np.asarray(np.linalg.lstsq(turn.reshape(-1, 2), shift.reshape(-1), rcond=None)[0], dtype=np.float64)
    off = np.hypot(*(turn @ point - shift).T)
    return point, float(np.sqrt(np.mean(off**2)))


def layers_of(tracks: PointTracks, key: NDArray[np.intp], regions: Sequence[Region]) -> list[int]:
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


def _at(distance: NDArray[Any], point: NDArray[np.float64]) -> float:
    """Distance at a point, which may lie outside the picture."""
    height, width = distance.shape
    inside = np.clip(np.rint(point), 0.0, [width - 1.0, height - 1.0])
    return float(distance[int(inside[1]), int(inside[0])] + np.hypot(*(point - inside)))
