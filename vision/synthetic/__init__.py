"""Synthetic films with known truth: textures, outlines, scenes, lens, sensor."""

from __future__ import annotations

from vision.camera.model import Projection, tilt_homography
from vision.synthetic.scene import (
    Scene,
    Sensor,
    SyntheticBody,
    background,
    box,
    thick_line,
    total_noise,
    transform_points,
)
from vision.synthetic.textures import BlobTexture, speckle, wood_grain

__all__ = [
    "BlobTexture",
    "Projection",
    "Scene",
    "Sensor",
    "SyntheticBody",
    "background",
    "box",
    "speckle",
    "thick_line",
    "tilt_homography",
    "total_noise",
    "transform_points",
    "wood_grain",
]

tilted, turned = tilt_homography, transform_points  # their former names, for one release
