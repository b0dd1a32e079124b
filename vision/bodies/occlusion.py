"""Occlusion: which pixels of a body another body hides in a frame.

The outlines of the bodies in front, widened by the clearance, move with their predicted poses, so that a lever that
sweeps over the whippen never counts as whippen. What no outline describes is left to the weights of the fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.bodies.masks import CLEARANCE_PX
from vision.bodies.outlines import Body
from vision.fitting.template import Template
from vision.kernel_cache import cached_njit

FAST = {"reassoc", "contract", "arcp", "nsz"}


GROUP = 64  # pixels that are looked at together first: where their whole neighbourhood is clear, none of them is


@cached_njit(_nrt=False)
def relative_pose(
    pose: NDArray[np.float64],
    centre: NDArray[np.float64],
    other_pose: NDArray[np.float64],
    other_centre: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Turn (rad) relative to another body, and position (x, y; px) of a body's centre from the other's centre, in the
    other's turned axes; poses are (turn, x, y) since the reference, ``centre`` (x, y) in the reference."""
    cosine, sine = math.cos(other_pose[0]), math.sin(other_pose[0])
    x, y = centre[0] + pose[1] - other_centre[0] - other_pose[1], centre[1] + pose[2] - other_centre[1] - other_pose[2]
    return pose[0] - other_pose[0], cosine * x + sine * y, cosine * y - sine * x


@cached_njit(fastmath=FAST)
def mark_covered(
    offset: NDArray[np.float32],
    groups: NDArray[np.float64],
    relative: tuple[float, float, float],
    distance: NDArray[np.float32],
    other_centre: NDArray[np.float64],
    covered: NDArray[np.uint8],
) -> int:
    """Set ``covered`` (n,) to 1 at template pixels, ``offset`` (2, n), that a body in front hides, and count them.
    ``relative``: `relative_pose` to it; ``distance``: its `signed_distance`; ``groups`` (3, k): centre x, y and radius
    of each 64 pixels.

    ``other_centre`` is that of the body in front in the reference.
    """
    cosine, sine = math.cos(relative[0]), math.sin(relative[0])
    left, top = other_centre[0] + relative[1] + 0.5, other_centre[1] + relative[2] + 0.5
    height, width = distance.shape
    count = 0
    for group in range(groups.shape[1]):
        ix = int(math.floor(left + cosine * groups[0, group] - sine * groups[1, group]))
        iy = int(math.floor(top + sine * groups[0, group] + cosine * groups[1, group]))
        if 0 <= ix < width and 0 <= iy < height and distance[iy, ix] + groups[2, group] + 1.0 < -CLEARANCE_PX:
            continue
        for i in range(group * GROUP, min((group + 1) * GROUP, offset.shape[1])):
            ix = int(math.floor(left + cosine * offset[0, i] - sine * offset[1, i]))
            iy = int(math.floor(top + sine * offset[0, i] + cosine * offset[1, i]))
            if 0 <= ix < width and 0 <= iy < height and distance[iy, ix] > -CLEARANCE_PX:
                covered[i] = 1
                count += 1
    return count


def _group_pixels(offset: NDArray[np.float32]) -> NDArray[np.float64]:
    """Centres and radii of the groups of a template's pixels, shape (3, n_groups)."""
    starts = range(0, offset.shape[1], GROUP)
    parts = [offset[:, start : start + GROUP].astype(float) for start in starts]
    centres = [part.mean(axis=1) for part in parts]
    radii = [np.hypot(*(part - centre[:, None])).max() for part, centre in zip(parts, centres, strict=True)]
    return np.vstack([np.array(centres).T, radii])


class Occlusion:
    """Which body can hide which; bodies, templates and the distances from their outlines are in the same order."""

    def __init__(
        self,
        bodies: Sequence[Body],
        templates: Sequence[Template],
        distances: Sequence[NDArray[np.float32]] | NDArray[np.float32],
    ) -> None:
        self._bodies, self._templates = bodies, templates
        self._centres = [np.array(template.centre_px) for template in templates]
        self.groups = [_group_pixels(template.offset_px) for template in templates]
        # of all bodies, (m, height, width)
        self.distances = distances if isinstance(distances, np.ndarray) else np.stack(distances)
        self.in_front = [
            [j for j, other in enumerate(bodies) if j != i and other.layer >= body.layer]
            for i, body in enumerate(bodies)
        ]

    def with_templates(self, templates: Sequence[Template]) -> Occlusion:
        return Occlusion(self._bodies, templates, self.distances)

    def hidden_pixels(
        self, body: int, pose: NDArray[np.float64], poses: dict[int, NDArray[np.float64]]
    ) -> NDArray[np.uint8]:
        """Template pixels of body ``body`` (index), at ``pose``, that others hide: (n,), 1 where hidden. ``poses``: of
        the bodies in front, by index."""
        template = self._templates[body]
        covered = np.zeros(template.n_pixels, dtype=np.uint8)
        for other, there in poses.items():
            seen = relative_pose(pose, self._centres[body], there, self._centres[other])
            mark_covered(
                template.offset_px, self.groups[body], seen, self.distances[other], self._centres[other], covered
            )
        return covered
