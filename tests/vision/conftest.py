"""Synthetic films with known poses, never square, with a scene that has no symmetry."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import tracking_stress as stress_films
from vision.bodies.outlines import Body
from vision.errors import VisionWarning
from vision.film.source import ArrayFilm
from vision.results.track_result import TrackResult
from vision.synthetic import Scene, Sensor, SyntheticBody, background, box, speckle, wood_grain
from vision.tracking.track_film import track_film

HEIGHT, WIDTH = 150, 210
PIVOT = (92.0, 96.0)
ECC = pytest.param(
    "ecc",
    marks=pytest.mark.skipif(not hasattr(cv2, "findTransformECCWithMask"), reason="masked ECC is in OpenCV 5"),
)


@dataclass(frozen=True)
class KnownFilm:
    """Frames with the poses they were drawn at."""

    film: ArrayFilm
    bodies: list[Body]
    pose: NDArray[np.float64]  # (n_frames, n_bodies, 3): angle ccw, x, y of the origin
    light: NDArray[np.float32]
    noise_grey: float


@cache  # its textures are tabulated once
def one_body_scene(texture: str, seed: int = 5) -> Scene:
    """A bar of 110 x 44 px on a background, its origin off its middle."""
    extent = (-36.0, -28.0, 86.0, 28.0)
    make = speckle(extent, seed) if texture == "speckle" else wood_grain(extent, seed, direction_rad=0.15)
    body = SyntheticBody("bar", box(-30.0, -22.0, 80.0, 22.0), make)
    return Scene([body], background(HEIGHT, WIDTH, seed + 1))


@pytest.fixture(scope="session")
def film_of() -> Callable[..., KnownFilm]:
    """Factory: render a scene at given poses, (n_frames, n_bodies, 3), one instant each."""

    def make(
        scene: Scene,
        pose: NDArray[np.float64],
        *,
        noise_grey: float = 2.0,
        seed: int = 0,
        gain: NDArray[np.float64] | None = None,
        parents: dict[str, str] | None = None,
        cover: Callable[[int, NDArray[np.float32]], None] | None = None,
    ) -> KnownFilm:
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

    return make


@cache
def load_stress() -> ModuleType:
    """The renderer of the stress benchmark, which shares no code with `vision`; a film is drawn once."""
    stress_films.__dict__["stress_film"] = cache(stress_films.stress_film)
    return stress_films


@pytest.fixture(scope="session")
def stress() -> ModuleType:
    return load_stress()


def track_stress_film(_folder: Path, kind: str, surface: str, seed: int) -> tuple[TrackResult, np.ndarray, np.ndarray]:
    """Result, errors and errors over the stated uncertainty of the moving rows."""
    stress = load_stress()
    film = stress.stress_film(kind, surface, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VisionWarning)
        result = track_film(ArrayFilm(film.frames, 2000.0), [Body("bar", film.outline_px)])
    still = min(result.n_still, stress.STILL)
    error = (result.angle_rad[:, 0] - film.angle_rad + film.angle_rad[:still].mean())[stress.STILL :]
    return result, error, error / result.u_angle_rad[stress.STILL :, 0]


@pytest.fixture(scope="session")
def tracked(shared: Callable[..., Any]) -> Callable[..., tuple[TrackResult, np.ndarray, np.ndarray]]:
    """Track a film of the stress benchmark, once in a run; as `track_stress_film`."""
    return partial(shared, track_stress_film)


@pytest.fixture(scope="session")
def bar_scene() -> Callable[[str], Scene]:
    """Factory of the one-body scene."""
    return one_body_scene


@pytest.fixture(scope="session")
def pivot() -> tuple[float, float]:
    """Where the tests put the origin of the bar."""
    return PIVOT
