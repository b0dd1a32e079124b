"""Films of a turning bar that something disturbs, with their errors once tracked; many more, drawn without
`vision.synthetic`: ``python -m benchmarks tracking_stress``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tests.vision.known_films import (
    HEIGHT,
    PIVOT,
    WIDTH,
    KnownFilm,
    bar_motion,
    bar_scene,
    film_of,
    quietly_tracked,
    smooth_step,
    z_of,
)
from vision import ArrayFilm, TrackResult

N, STILL, TURN_RAD = 60, 14, 0.25
Y, X = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
S = smooth_step((np.arange(N) - STILL) / (N - STILL - 6))
"""How far the bar has moved."""
Grey = NDArray[np.float64]


def zoomed(i: int, light: Grey, along: float, across: float) -> Grey:
    """The picture larger by two factors, along the bar and across it, around its origin."""
    x0, y0 = PIVOT[0] + 6.0 * S[i], PIVOT[1] + 3.0 * S[i]
    c, s = np.cos(TURN_RAD * S[i]), np.sin(TURN_RAD * S[i])
    u, v = (c * (X - x0) - s * (Y - y0)) / along, (s * (X - x0) + c * (Y - y0)) / across
    return ndimage.map_coordinates(light, [y0 - s * u + c * v, x0 + c * u + s * v], order=3, mode="nearest")


def dust(i: int, light: Grey) -> Grey:
    spots = np.random.default_rng(4).uniform([20, 20], [WIDTH - 20, HEIGHT - 20], (40, 2))
    shade = sum(np.exp(-((X - x) ** 2 + (Y - y) ** 2) / 6.0) for x, y in spots)
    return light * (1.0 - 0.35 * np.clip(shade, 0.0, 1.0))


def shadow_edge(i: int, light: Grey) -> Grey:
    return light * (1.0 - 0.3 / (1.0 + np.exp(-(X - 60.0 - 50.0 * S[i]) / 2.0)))


LIGHTS: dict[str, Callable[[int, Grey], Grey]] = {
    "clean": lambda i, light: light,
    "dust": dust,
    "shadow_edge": shadow_edge,
    "saturation": lambda i, light: 1.35 * light,
    "scale_change": lambda i, light: zoomed(i, light, 1.0 + 0.02 * S[i], 1.0 + 0.02 * S[i]),
    "tilt": lambda i, light: zoomed(i, light, 1.0 - 0.015 * S[i], 1.0),
    "defocus": lambda i, light: ndimage.gaussian_filter(light, 1.2 * S[i]),
    "row_flicker": lambda i, light: light * (1.0 + 0.04 * np.sin(0.9 * i + Y / 11.0)),
    "low_light": lambda i, light: 0.35 * light,
}
"""What happens to the light of a frame."""


def smooth_noise(frames: NDArray[np.uint8], rms: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Noise of the given size in each frame that goes together over some pixels."""
    rng, more = np.random.default_rng(3), []
    for frame, size in zip(frames, rms, strict=True):
        smooth = ndimage.gaussian_filter(rng.normal(size=frame.shape), 1.5)
        more.append(frame + size * smooth / smooth.std())
    return np.clip(np.rint(more), 0, 255).astype(np.uint8)


def compressed(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    quality = [cv2.IMWRITE_JPEG_QUALITY, 60]
    return np.stack([cv2.imdecode(cv2.imencode(".jpg", one, quality)[1], cv2.IMREAD_GRAYSCALE) for one in frames])


def repeated(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    frames = frames.copy()
    for k in (20, 27, 33, 34, 48):
        frames[k] = frames[k - 1]
    return frames


FILES: dict[str, Callable[[NDArray[np.uint8]], NDArray[np.uint8]]] = {
    "jpeg": compressed,
    "correlated_noise": lambda frames: smooth_noise(frames, np.full(N, 2.0)),
    "quantisation": lambda frames: frames // 12 * 12,
    "duplicates": repeated,
}
"""What happens to the frames afterwards."""
KINDS = (*LIGHTS, *FILES)


@cache
def disturbed(kind: str, texture: str) -> KnownFilm:
    """The film of a kind."""

    def cover(i: int, light: NDArray[np.float32]) -> None:
        light[:] = LIGHTS.get(kind, LIGHTS["clean"])(i, light.astype(float))

    known = film_of(bar_scene(texture), bar_motion(N, PIVOT, TURN_RAD), seed=len(kind), cover=cover)
    frames = FILES.get(kind, lambda frames: frames)(known.frames)
    return replace(known, film=ArrayFilm(frames, frame_rate_hz=2000.0))


@cache
def tracked(kind: str, texture: str) -> tuple[TrackResult, NDArray[np.float64]]:
    """Result, and errors over the stated uncertainty of the moving rows."""
    known = disturbed(kind, texture)
    result = quietly_tracked(known.film, known.bodies)
    return result, z_of(result, known.pose)[STILL:]
