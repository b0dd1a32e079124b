"""Pixels hidden by a body in front, against plain geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision import Body
from vision.bodies.masks import CLEARANCE_PX
from vision.bodies.occlusion import Occlusion
from vision.bodies.outlines import signed_distance
from vision.fitting.template import build_template


def test_mark_covered_against_plain_geometry() -> None:
    """Template pixels carried into the frame, then back into the axes of the one in front."""
    rng = np.random.default_rng(6)
    mask = np.zeros((120, 180), dtype=bool)
    mask[20:80, 30:110] = True
    template = build_template("back", rng.uniform(50.0, 200.0, mask.shape), mask, 4)
    offset, centre, pose = template.offset_px, np.array(template.centre_px), np.array([0.2, 3.0, -2.0])
    front = Body("front", np.array([[70.0, 45.0], [120.0, 45.0], [120.0, 70.0], [70.0, 70.0]]), layer=1)
    back = Body("back", np.array([[26.0, 16.0], [114.0, 16.0], [114.0, 84.0], [26.0, 84.0]]))
    distances = [signed_distance(body.polygon_px, 120, 180) for body in (back, front)]
    other = build_template("front", rng.uniform(50.0, 200.0, mask.shape), distances[1] > 4.0, 4)
    other_centre, other_pose = np.array(other.centre_px), np.array([-0.3, -4.0, 5.0])
    covered = Occlusion([back, front], [template, other], distances).hidden_pixels(0, pose, {1: other_pose})

    def turn(phi: float) -> NDArray[np.float64]:
        return np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])

    there = (centre + pose[1:])[:, None] + turn(0.2) @ offset
    back = other_centre[:, None] + turn(0.3) @ (there - (other_centre + other_pose[1:])[:, None])
    column, row = np.floor(back + 0.5).astype(int)
    inside = (row >= 0) & (row < 120) & (column >= 0) & (column < 180)
    expected = inside & (distances[1][np.clip(row, 0, 119), np.clip(column, 0, 179)] > -CLEARANCE_PX)
    np.testing.assert_array_equal(covered.astype(bool), expected)
    assert 500 < expected.sum() < offset.shape[1] - 500
