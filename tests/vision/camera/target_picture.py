"""Pictures of calibration targets through a known lens.

The pattern is a formula on the plane; each pixel is the mean of points within it, each mapped to the plane exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision import Projection

SUBPIXELS = 4
DARK, BRIGHT = 30.0, 210.0


def target_picture(
    lens: Projection,
    kind: str,
    grid: tuple[int, int],
    pitch_px: float,
    *,
    turn_rad: float = 0.0,
    place_px: tuple[float, float] | None = None,
) -> NDArray[np.float32]:
    """Noise-free picture of a checkerboard (inner corners) or of round dots, shape (height, width).

    Parameters
    ----------
    lens : Projection
    kind : {"checkerboard", "dots"}
    grid : (int, int)
        Points per row and per column.
    pitch_px : float
        Distance of points on the plane, px.
    turn_rad : float
        Of the target in picture axes.
    place_px : (float, float), optional
        Middle of the grid on the plane; the picture's centre by default.
    """
    columns, rows = grid
    middle = lens.centre_px if place_px is None else np.asarray(place_px, dtype=float)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    y, x = np.indices((lens.height, lens.width), dtype=float)
    total = np.zeros((lens.height, lens.width))
    shifts = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    for dx in shifts:
        for dy in shifts:
            flat = lens.rectified(np.stack([x + dx, y + dy], axis=-1)) - middle
            u = (c * flat[..., 0] + s * flat[..., 1]) / pitch_px + 0.5 * (columns - 1)
            v = (-s * flat[..., 0] + c * flat[..., 1]) / pitch_px + 0.5 * (rows - 1)
            if kind == "checkerboard":
                inside = (np.abs(u - 0.5 * (columns - 1)) < 0.5 * (columns + 1)) & (
                    np.abs(v - 0.5 * (rows - 1)) < 0.5 * (rows + 1)
                )
                ink = inside & ((np.floor(u) + np.floor(v)) % 2 == 0)
            else:
                near = np.hypot(u - np.clip(np.rint(u), 0, columns - 1), v - np.clip(np.rint(v), 0, rows - 1))
                ink = near < 0.28
            total += np.where(ink, DARK, BRIGHT)
    return (total / SUBPIXELS**2).astype(np.float32)
