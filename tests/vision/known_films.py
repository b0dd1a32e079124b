"""Synthetic films with known poses, never square, of scenes that have no symmetry, and how their bodies move."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vision import ArrayFilm, Body, TrackResult, VisionWarning, build_masks, ccw_to_picture, cramer_rao_bound, track
from vision.fitting.template import Template, build_template
from vision.reference.still_average import average_still_frames
from vision.synthetic import Scene, Sensor, SyntheticBody, background, box, speckle, total_noise, wood_grain

HEIGHT, WIDTH = 150, 210
PIVOT = (92.0, 96.0)
"""Where the tests put the origin of the bar."""


def smooth_step(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """0 to 1 while x goes from 0 to 1, with zero speed and acceleration at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x * x)


def bar_motion(n: int, pivot: tuple[float, float], turn_rad: float, still: int = 14) -> NDArray[np.float64]:
    """Poses (n, 1, 3) of a bar that rests, turns about its origin, and drifts to the right and down."""
    s = smooth_step((np.arange(n) - still) / (n - still - 6))
    return np.column_stack([turn_rad * s, pivot[0] + 6.0 * s, pivot[1] + 3.0 * s])[:, None, :]


@dataclass(frozen=True)
class KnownFilm:
    """Frames with the poses they were drawn at."""

    film: ArrayFilm
    bodies: list[Body]
    pose: NDArray[np.float64]  # (n_frames, n_bodies, 3): angle ccw, x, y of the origin
    light: NDArray[np.float32]
    noise_grey: float

    @property
    def frames(self) -> NDArray[np.uint8]:
        """All pictures, (n, height, width)."""
        return np.stack([self.film.read(i) for i in range(self.film.n_frames)])

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Of the first body."""
        return build_masks(self.bodies, self.film.height, self.film.width)[0]

    def bound(self) -> NDArray[np.float64]:
        """Least standard errors that the first body's picture allows: angle, x, y."""
        return cramer_rao_bound(self.light, self.mask, total_noise(self.noise_grey, 8))

    def template(self, n_still: int) -> Template:
        """Of the first body."""
        reference = average_still_frames(self.film, self.mask, n_still)
        return build_template("bar", reference.picture, self.mask, n_still, noise_grey=reference.noise_grey)

    def true_fit(self, i: int, template: Template) -> NDArray[np.float64]:
        """What a fit of the first body should find: its middle turns about its origin."""
        phi = float(ccw_to_picture(self.pose[i, 0, 0] - self.pose[0, 0, 0]))
        origin = self.pose[0, 0, 1:]
        arm = np.array(template.centre_px) - origin
        c, s = np.cos(phi), np.sin(phi)
        return np.array([phi, *(self.pose[i, 0, 1:] - origin + np.array([[c, -s], [s, c]]) @ arm - arm)])


@cache  # its textures are tabulated once
def bar_scene(texture: str, seed: int = 5) -> Scene:
    """A bar of 110 x 44 px on a background, its origin off its middle."""
    extent = (-36.0, -28.0, 86.0, 28.0)
    make = speckle(extent, seed) if texture == "speckle" else wood_grain(extent, seed, direction_rad=0.15)
    body = SyntheticBody("bar", box(-30.0, -22.0, 80.0, 22.0), make)
    return Scene([body], background(HEIGHT, WIDTH, seed + 1))


def film_of(
    scene: Scene,
    pose: NDArray[np.float64],
    *,
    noise_grey: float = 2.0,
    seed: int = 0,
    gain: NDArray[np.float64] | None = None,
    parents: dict[str, str] | None = None,
    cover: Cover | None = None,
) -> KnownFilm:
    """A scene at poses (n_frames, n_bodies, 3), one instant each."""
    sensor = Sensor(noise_grey, 8, seed)
    frames = []
    for i, poses in enumerate(pose):
        light = scene.light(poses[None])
        if cover is not None:
            light = light.copy()
            cover(i, light)
        frames.append(sensor.expose(light, 1.0 if gain is None else float(gain[i])))
    bodies = [
        Body(body.name, body.outline(*pose[0, k]), (parents or {}).get(body.name), layer=k)
        for k, body in enumerate(scene.bodies)
    ]
    film = ArrayFilm(np.stack(frames), frame_rate_hz=2000.0)
    return KnownFilm(film, bodies, pose, scene.light(pose[0][None]), noise_grey)


def error_of(result: TrackResult, pose: NDArray[np.float64], body: int = 0) -> NDArray[np.float64]:
    """Angle found less the true one, both zero in the mean of the still frames, rad, (n_frames,)."""
    true = pose[:, body, 0]
    return result.angle_rad[:, body] - (true - true[: result.n_still].mean())


def z_of(result: TrackResult, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The first body's errors over their stated uncertainty."""
    return error_of(result, pose) / result.u_angle_rad[:, 0]


def quietly_tracked(film: ArrayFilm, bodies: list[Body], **options: Any) -> TrackResult:
    """Tracked without warnings."""
    with warnings.catch_warnings(action="ignore", category=VisionWarning):
        return track(film, bodies, **options)


def still_bar(texture: str) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A picture of the bar at rest, and pixels well inside it."""
    light = bar_scene(texture).light(np.array([[[0.0, *PIVOT]]]))
    mask = np.zeros(light.shape, dtype=bool)
    mask[80:112, 68:166] = True
    return light, mask


Cover = Callable[[int, NDArray[np.float32]], None]
"""Changes the light of a frame in place."""


def dark(frames: range) -> Cover:
    """No light in these frames."""

    def cover(i: int, light: NDArray[np.float32]) -> None:
        if i in frames:
            light[:] = 12.0

    return cover


def blurred(width_px: NDArray[np.float64]) -> Cover:
    """Out of focus by a width of its own in each frame."""

    def cover(i: int, light: NDArray[np.float32]) -> None:
        light[:] = ndimage.gaussian_filter(light, width_px[i])

    return cover


def same_bits(a: TrackResult, b: TrackResult) -> None:
    """Equal to the bit."""
    for name in ("angle_rad", "u_angle_rad", "x_px", "zncc", "covariance", "u_common_rad", "u_total_rad", "flag"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def sliding_bar(i: int, light: NDArray[np.float32]) -> None:
    """Hides a third of the bar from frame 21 on."""
    if i > 20:
        left = 45 + (i - 20) // 2
        light[:, left : left + 38] = 25.0
