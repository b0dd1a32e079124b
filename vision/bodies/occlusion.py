"""Pixels of a body that another body hides in a frame.

The outlines of the bodies in front, widened by the clearance, move with their predicted poses, so that a lever that
sweeps over the whippen never counts as whippen. What no outline describes is left to the weights of the fit.

Conventions: picture axes (y down); ``pose`` is (phi, tx, ty) as in `vision.fitting.base`. `mark_covered` is compiled
and calls no other compiled function (see `vision.fitting.kernels`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.bodies.masks import CLEARANCE_PX
from vision.bodies.outlines import Body, signed_distance
from vision.fitting.template import Template

FAST = {"reassoc", "contract", "arcp", "nsz"}


@njit(cache=True, nogil=True, fastmath=FAST)
def mark_covered(
    offset: NDArray[np.float32],
    centre: NDArray[np.float64],
    pose: NDArray[np.float64],
    other_mask: NDArray[np.uint8],
    other_centre: NDArray[np.float64],
    other_pose: NDArray[np.float64],
    covered: NDArray[np.uint8],
) -> int:
    """Mark template pixels that a body in front hides; its reference mask is moved with it. Returns their number."""
    cosine, sine = math.cos(pose[0]), math.sin(pose[0])
    other_cosine, other_sine = math.cos(other_pose[0]), math.sin(other_pose[0])
    shift_x = centre[0] + pose[1] - other_centre[0] - other_pose[1]
    shift_y = centre[1] + pose[2] - other_centre[1] - other_pose[2]
    height, width = other_mask.shape
    count = 0
    for i in range(offset.shape[1]):
        x = shift_x + cosine * offset[0, i] - sine * offset[1, i]
        y = shift_y + sine * offset[0, i] + cosine * offset[1, i]
        ix = int(math.floor(other_centre[0] + other_cosine * x + other_sine * y + 0.5))
        iy = int(math.floor(other_centre[1] - other_sine * x + other_cosine * y + 0.5))
        if 0 <= ix < width and 0 <= iy < height and other_mask[iy, ix] != 0:
            covered[i] = 1
            count += 1
    return count


class Occlusion:
    """Which body can hide which, and the outlines of those in front; bodies and templates are in the same order."""

    def __init__(self, bodies: Sequence[Body], templates: Sequence[Template], height: int, width: int) -> None:
        self._templates = templates
        self._centres = [np.array(template.centre_px) for template in templates]
        self._outlines = [
            (signed_distance(body.polygon_px, height, width) > -CLEARANCE_PX).astype(np.uint8) for body in bodies
        ]
        self.in_front = [
            [j for j, other in enumerate(bodies) if j != i and other.layer >= body.layer]
            for i, body in enumerate(bodies)
        ]

    def covered(self, body: int, pose: NDArray[np.float64], poses: dict[int, NDArray[np.float64]]) -> NDArray[np.uint8]:
        """Template pixels of a body, at ``pose``, that bodies in front hide at theirs; shape (n,), 1 is hidden."""
        template = self._templates[body]
        covered = np.zeros(template.n_pixels, dtype=np.uint8)
        for other, there in poses.items():
            mark_covered(
                template.offset_px,
                self._centres[body],
                pose,
                self._outlines[other],
                self._centres[other],
                there,
                covered,
            )
        return covered
