"""A film of a turning bar with known angles, drawn without `vision.synthetic`, and video files of any stamps.

The texture is a sum of plane waves, which is known exactly between its points; each film pixel is the mean of 4 x 4
such points, so that edges are smooth. Angles counter-clockwise as seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import Body

HEIGHT, WIDTH = 120, 172
PIVOT = (46.0, 62.0)
LEFT, RIGHT, HALF = -10.0, 92.0, 16.0
SUB = 4
N_STILL, TURN_RAD = 15, np.radians(8.0)
BODY = Body("bar", tuple((PIVOT[0] + x, PIVOT[1] + y) for x, y in ((-8, -14), (90, -14), (90, 14), (-8, 14))))
OUTLINES = f"[[body]]\nname = 'bar'\npolygon_px = {[[*map(float, point)] for point in BODY.polygon_px]}\n"


def smooth_turn(at: NDArray[np.float64], n: int = 60) -> NDArray[np.float64]:
    """Angle, rad, at frame numbers that may be fractions: at rest up to `N_STILL`, turned by 8 deg at n - 1."""
    x = np.clip((np.asarray(at, dtype=float) - N_STILL) / (n - 1 - N_STILL), 0.0, 1.0)
    return TURN_RAD * x * x * (3.0 - 2.0 * x)


def _waves(seed: int, longest_px: float, shortest_px: float, count: int) -> NDArray[np.float64]:
    """Wave vectors (rad/px) and phases, (count, 3)."""
    rng = np.random.default_rng(seed)
    k = 2.0 * np.pi / rng.uniform(shortest_px, longest_px, count)
    direction = rng.uniform(0.0, np.pi, count)
    return np.column_stack([k * np.cos(direction), k * np.sin(direction), rng.uniform(0.0, 2.0 * np.pi, count)])


def _texture(waves: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    return sum(np.sin(a * x + b * y + phase) for a, b, phase in waves) / np.sqrt(len(waves) / 2.0)


@cache
def _points() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places of all points, and the background there."""
    offset = (np.arange(SUB) + 0.5) / SUB - 0.5
    x, y = np.meshgrid((np.arange(WIDTH)[:, None] + offset).ravel(), (np.arange(HEIGHT)[:, None] + offset).ravel())
    return x, y, 70.0 + 16.0 * _texture(_waves(1, 30.0, 9.0, 12), x, y)


def turning_bar(angle_rad: Sequence[float] | NDArray[np.float64], noise_grey: float = 2.0) -> NDArray[np.uint8]:
    """Frames (n, height, width) of the bar at each angle."""
    x, y, light = _points()
    waves, rng, frames = _waves(2, 14.0, 5.0, 16), np.random.default_rng(3), []
    for angle in angle_rad:
        c, s = np.cos(angle), np.sin(angle)
        # picture y points down: a counter-clockwise turn is the inverse there
        u = c * (x - PIVOT[0]) - s * (y - PIVOT[1])
        v = s * (x - PIVOT[0]) + c * (y - PIVOT[1])
        inside = (u > LEFT) & (u < RIGHT) & (np.abs(v) < HALF)
        drawn = light.copy()
        drawn[inside] = 130.0 + 34.0 * _texture(waves, u[inside], v[inside])
        grey = drawn.reshape(HEIGHT, SUB, WIDTH, SUB).mean(axis=(1, 3))
        noisy = grey + noise_grey * rng.standard_normal(grey.shape)
        frames.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return np.stack(frames)


def write_video(
    path: Path,
    frames: NDArray[np.uint8],
    codec: str = "ffv1",
    *,
    stamps: Sequence[int] | NDArray[np.int64] | None = None,
    rate: int = 2000,
    pixels: str = "gray",
    options: dict[str, str] | None = None,
    container: dict[str, str] | None = None,
) -> Path:
    """Write frames at stamps counted in intervals of ``rate``, one after the other where none are given."""
    with av.open(str(path), "w", options=container or {}) as file:
        stream: Any = file.add_stream(codec, rate=rate, options=options or {})
        stream.height, stream.width = frames[0].shape
        stream.pix_fmt = pixels
        stream.codec_context.time_base = Fraction(1, rate)
        for k, grey in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(grey, format="gray")
            frame = frame if pixels == "gray" else frame.reformat(format=pixels)
            frame.pts, frame.time_base = k if stamps is None else int(stamps[k]), Fraction(1, rate)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    return path
