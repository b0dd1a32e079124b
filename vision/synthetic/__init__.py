"""Synthetic films with known truth: textures, outlines, scenes, lens, sensor.

Public: used by the tests, by the benchmarks and by the virtual camera. Nothing here is part of tracking.
"""

from __future__ import annotations

from vision.camera.projection import Projection, tilted
from vision.synthetic.scene import Scene, Sensor, SyntheticBody, background, total_noise
from vision.synthetic.shapes import box, thick_line, turned
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
    "tilted",
    "total_noise",
    "turned",
    "wood_grain",
]
