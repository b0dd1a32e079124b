"""Disturbed films for ``benchmarks/tracking_stress.py``, drawn by a renderer that shares no code with `vision`.

A texture is filtered noise on a grid of `FINE` points per pixel, sampled by SciPy's cubic spline; a film is a bar with
that texture, turning and shifting before a background, through a camera with one disturbance. Angles are
counter-clockwise, in rad.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

sys.path.append(str(Path(__file__).resolve().parent))  # tests load this file by its path
from stress_kinds import FURTHER
from stress_shot import (
    F64,
    HALF_X,
    HALF_Y,
    HEIGHT,
    OUTLINE,
    PIVOT,
    STILL,
    TEXTURES,
    WIDTH,
    N,
    Plate,
    Shot,
    progress,
    texture,
)


def fixed_pattern(shot: Shot) -> None:
    """Every pixel and every column of the sensor has an offset of its own."""
    pattern = shot.rng.normal(0.0, 2.0, (HEIGHT, WIDTH)) + shot.rng.normal(0.0, 1.0, WIDTH)
    shot.grey = lambda _, picture: picture + pattern


def dust(shot: Shot) -> None:
    """Dark spots on the sensor."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    shade = np.zeros((HEIGHT, WIDTH))
    for _ in range(25):
        cx, cy, w = shot.rng.uniform(20, WIDTH - 20), shot.rng.uniform(20, HEIGHT - 20), shot.rng.uniform(1.2, 4.0)
        shade += shot.rng.uniform(0.05, 0.3) * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * w * w))
    shot.light = lambda _, picture: picture * (1.0 - np.minimum(shade, 0.8))


def jpeg(shot: Shot) -> None:
    """JPEG of quality 60 to 90 of which the film says nothing any more."""
    quality = int(shot.rng.integers(60, 91))

    def squeezed(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        packed = [cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])[1] for frame in frames]
        return np.stack([cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) for data in packed])

    shot.finished = squeezed


def correlated_noise(shot: Shot) -> None:
    """Noise smoothed by the camera over 0.7 to 3 px."""
    width = shot.rng.uniform(0.7, 3.0)

    def noise(picture: F64) -> F64:
        smooth = ndimage.gaussian_filter(shot.rng.normal(size=picture.shape), width)
        return picture + 2.0 * smooth / smooth.std()

    shot.noise = noise


def scale_change(shot: Shot) -> None:
    """The body comes nearer or goes away by 0.3 to 1.5 %."""
    shot.scale = 1.0 + shot.rng.choice([-1, 1]) * shot.rng.uniform(0.003, 0.015) * progress()


def defocus(shot: Shot) -> None:
    """The body leaves the plane of focus."""
    width = shot.rng.uniform(0.6, 1.6) * progress()
    shot.light = lambda i, picture: ndimage.gaussian_filter(picture, width[i]) if width[i] > 0.05 else picture


def highlight(shot: Shot) -> None:
    """A reflection that stays where it is while the body moves."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    cx, cy, w = PIVOT[0] + shot.rng.uniform(-40, 40), PIVOT[1] + shot.rng.uniform(-25, 25), shot.rng.uniform(6, 30)
    glow = shot.rng.uniform(15, 60) * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * w * w))
    shot.light = lambda _, picture: picture + glow


def neighbour(shot: Shot) -> None:
    """A textured slat slides over the body and stays."""
    half = (shot.rng.uniform(8.0, 16.0), 70.0)
    slat = Plate(texture(str(shot.rng.choice(TEXTURES)), half, shot.rng), half)
    speed, turn = shot.rng.uniform(1.0, 4.0), shot.rng.uniform(-0.2, 0.2)

    def covered(i: int, picture: F64) -> F64:
        x = min(10.0 + speed * max(0, i - STILL - 4), 60.0)
        return slat.over(picture, np.array([turn + 0.004 * i, x, 95.0]))

    shot.light = covered


def saturation(shot: Shot) -> None:
    """The brightest part of the texture, or a white area under the outline, exceeds the sensor's range."""
    if shot.rng.uniform() < 0.5:
        shot.gain = np.full(N, shot.rng.uniform(1.7, 2.1))
        return
    share = shot.rng.uniform(0.3, 0.6)

    def white(i: int, picture: F64) -> F64:
        y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
        turn, px, py = shot.pose[i]
        u = np.cos(turn) * (x - px) - np.sin(turn) * (y - py)
        return picture + 300.0 * np.clip(u - HALF_X * (1.0 - 2.0 * share), 0.0, 1.0)

    shot.light = white


def duplicates(shot: Shot) -> None:
    """Frames that the camera's software repeats."""
    again = shot.rng.choice(np.arange(STILL + 8, N - 8), 5, replace=False)

    def repeated(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        for i in sorted(again):
            frames[i] = frames[i - 1]
        return frames

    shot.finished = repeated


def low_light(shot: Shot) -> None:
    """4 to 12 photons per pixel."""
    photons = shot.rng.uniform(4.0, 12.0)

    def noise(picture: F64) -> F64:
        counts = shot.rng.poisson(np.maximum(picture, 0.0) * photons / 110.0)
        return counts * 110.0 / photons + shot.rng.normal(0.0, 1.0, picture.shape)

    shot.noise = noise


def vibration(shot: Shot) -> None:
    """The camera shakes by half a pixel, in the still frames too."""
    shot.pose[:, 1:] += shot.rng.normal(0.0, 0.4, (N, 2))


def flicker(shot: Shot) -> None:
    """Light that changes by 30 %."""
    shot.gain = 1.0 + 0.3 * np.cos(shot.rng.uniform(0.3, 1.5) * np.arange(N) + shot.rng.uniform(0, 6))


def row_flicker(shot: Shot) -> None:
    """Light that flickers while the rows are read one after the other: bands that run through the picture."""
    phase = 2.0 * np.pi * np.arange(HEIGHT)[:, None] / shot.rng.uniform(150, 400)
    shot.light = lambda i, picture: picture * (1.0 + 0.1 * np.cos(phase + 1.3 * i))


def light_moves(shot: Shot) -> None:
    """A gradient of the light grows while the body moves."""
    x = (np.arange(WIDTH) - PIVOT[0]) / WIDTH
    slope = shot.rng.uniform(0.2, 0.6) * progress()
    shot.light = lambda i, picture: picture * (1.0 + slope[i] * x)


def clean(shot: Shot) -> None:
    """White noise of two grey levels and nothing else."""


KINDS: dict[str, Callable[[Shot], None]] = {
    kind.__name__: kind
    for kind in (
        clean,
        fixed_pattern,
        dust,
        jpeg,
        correlated_noise,
        scale_change,
        defocus,
        highlight,
        neighbour,
        saturation,
        duplicates,
        low_light,
        vibration,
        flicker,
        row_flicker,
        light_moves,
    )
}
NUMBER = {kind: number for number, kind in enumerate(sorted(KINDS))}
"""Part of a film's seed; kinds that were added later come after those of the first tables."""
for _kind in FURTHER:
    NUMBER[_kind.__name__] = len(KINDS)
    KINDS[_kind.__name__] = _kind
COLOURED = ("correlated_noise", "jpeg", "mpeg4", "h264", "row_noise", "quantisation")
"""Kinds whose noise is not white; in `LOOKED_AT` frames what it does to the angle is computed."""
LOOKED_AT = range(STILL + 6, N, 3)
SUBFRAMES = 7
"""Pictures that make one of a body smeared by its motion."""


@dataclass(frozen=True)
class StressFilm:
    """Frames (n, height, width) uint8, true angle (n,), rad, the mean over the exposure; outline (k, 2), px; the least
    error of the angle that the film's noise permits, rad: Cramer-Rao bound of white noise, or what least squares with a
    known template make of noise that is not white."""

    frames: NDArray[np.uint8]
    angle_rad: F64
    outline_px: F64
    bound_rad: float


def _design(body: Plate, pose: F64, seen: NDArray[np.bool_] | None = None) -> tuple[F64, NDArray[np.bool_]]:
    """Slopes (5, n) of the grey value by angle, x, y, gain and offset over the inner pixels of the body, and those;
    of the pixels that are ``seen`` (height, width) where that is given."""
    step = np.array([1e-3, 0.1, 0.1])
    flat = np.full((HEIGHT, WIDTH), 60.0)
    slopes = [
        (body.over(flat, pose + step[k] * unit) - body.over(flat, pose - step[k] * unit)) / (2.0 * step[k])
        for k, unit in enumerate(np.eye(3))
    ]
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] - pose[[2, 1], None, None]
    c, s = np.cos(pose[0]), -np.sin(pose[0])
    inside = (abs(c * x + s * y) < HALF_X - 5.0) & (abs(c * y - s * x) < HALF_Y - 5.0)
    if seen is not None:
        inside &= seen
    grey = body.over(flat, pose)[inside]
    return np.stack([*(slope[inside] for slope in slopes), grey, np.ones(grey.size)]), inside


def bound_of(body: Plate, pose: F64, noise_grey: float, seen: NDArray[np.bool_] | None = None) -> float:
    """Smallest standard deviation of the angle for white noise, gain, offset and position unknown too."""
    design, _ = _design(body, pose, seen)
    return float(noise_grey * np.sqrt(np.linalg.inv(design @ design.T)[0, 0]))


def error_of(body: Plate, pose: F64, off: F64) -> float:
    """Error of the angle by least squares, the template known, of a frame that is ``off`` (height, width) the light."""
    design, inside = _design(body, pose)
    return float(np.linalg.solve(design @ design.T, design @ off[inside])[0])


def _exposed(shot: Shot, body: Plate, behind: F64, i: int) -> F64:
    """The body before its background in frame i, over the time the shutter is open."""
    poses = shot.pose[i : i + 1]
    if shot.open_share:
        share = shot.open_share * (np.arange(SUBFRAMES) - (SUBFRAMES - 1) / 2) / SUBFRAMES
        poses = np.column_stack([np.interp(i + share, np.arange(N), one) for one in shot.pose.T])
    return np.mean([body.over(behind, pose, shot.scale[i], shot.squeeze[i]) for pose in poses], axis=0)


def _mean_angle(shot: Shot) -> F64:
    share = shot.open_share * (np.arange(SUBFRAMES) - (SUBFRAMES - 1) / 2) / SUBFRAMES
    return np.mean([np.interp(np.arange(N) + one, np.arange(N), shot.pose[:, 0]) for one in share], axis=0)


def stress_film(kind: str, surface: str, seed: int) -> StressFilm:
    """Render one film of a kind of disturbance."""
    rng = np.random.default_rng([seed, NUMBER[kind], TEXTURES.index(surface)])
    s = progress()
    turn = rng.choice([-1, 1]) * rng.uniform(0.08, 0.3)
    pose = np.column_stack([turn * s, PIVOT[0] + rng.uniform(-8, 8) * s, PIVOT[1] + rng.uniform(-8, 8) * s])
    shot = Shot(rng, pose)
    body = Plate(texture(surface, (HALF_X, HALF_Y), rng), (HALF_X, HALF_Y))
    wall = Plate(texture("fine", (WIDTH / 2, HEIGHT / 2), rng), (WIDTH / 2, HEIGHT / 2))
    behind = wall.over(np.full((HEIGHT, WIDTH), 60.0), np.array([0.0, WIDTH / 2, HEIGHT / 2])) * 0.6
    KINDS[kind](shot)
    frames = np.empty((N, HEIGHT, WIDTH), dtype=np.uint8)
    light = {}
    for i in range(N):
        picture = shot.light(i, _exposed(shot, body, behind, i)) * shot.gain[i]
        if kind in COLOURED and i in LOOKED_AT:
            light[i] = picture
        picture = shot.noise(picture) if shot.noise else picture + rng.normal(0.0, shot.read_noise, picture.shape)
        frames[i] = np.clip(np.rint(shot.grey(i, picture)), 0, 255)
    c, sn = np.cos(shot.pose[0, 0]), np.sin(shot.pose[0, 0])
    outline = np.array([(c * x + sn * y, c * y - sn * x) for x, y in OUTLINE]) + shot.pose[0, 1:]
    noise = 2.0
    if shot.noise:  # from the frames: what differs between two still ones
        noise = float(np.median(np.abs(frames[2].astype(float) - frames[1]))) / 0.6745 / np.sqrt(2.0)
    # what is cut off tells nothing; what is brighter has more contrast over the same noise
    gain = float(np.median(shot.gain))
    bound = bound_of(body, shot.pose[0], max(noise, 2.0) / gain, frames[STILL // 2] < 255)
    frames = shot.finished(frames)
    if light:
        errors = [error_of(body, shot.pose[i], frames[i] - there) for i, there in light.items()]
        bound = max(bound, float(np.sqrt(np.mean(np.square(errors)))))
    return StressFilm(frames, _mean_angle(shot), outline, bound)
