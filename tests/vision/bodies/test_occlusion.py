"""Pixels hidden by a body in front, against plain geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.bodies.occlusion import mark_covered


def test_mark_covered_against_plain_geometry() -> None:
    """Template pixels carried into the frame, then back into the axes of the one in front."""
    rng = np.random.default_rng(6)
    offset = rng.uniform(-40, 40, (2, 500)).astype(np.float32)
    centre, pose = np.array([70.0, 50.0]), np.array([0.2, 3.0, -2.0])
    other_centre, other_pose = np.array([90.0, 60.0]), np.array([-0.3, -4.0, 5.0])
    outline = np.zeros((120, 180), dtype=np.uint8)
    outline[45:70, 70:120] = 1
    covered = np.zeros(500, dtype=np.uint8)
    count = mark_covered(offset, centre, pose, outline, other_centre, other_pose, covered)

    def turn(phi: float) -> NDArray[np.float64]:
        return np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])

    there = (centre + pose[1:])[:, None] + turn(0.2) @ offset
    back = other_centre[:, None] + turn(0.3) @ (there - (other_centre + other_pose[1:])[:, None])
    column, row = np.floor(back + 0.5).astype(int)
    inside = (row >= 0) & (row < 120) & (column >= 0) & (column < 180)
    expected = inside & (outline[np.clip(row, 0, 119), np.clip(column, 0, 179)] > 0)
    np.testing.assert_array_equal(covered.astype(bool), expected)
    assert count == expected.sum() > 50
