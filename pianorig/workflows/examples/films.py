"""Example films: the jack and the repetition lever in a forte blow, and a calibration target moved about."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import model
import vision
from rig.simulated import ActionGeometry, CameraSettings, film_bodies, film_trial

CAMERA = CameraSettings(width=280, height=212, scale_px_per_m=2240.0)
FRAMES = 150
START_S = 0.045
"""The example force begins at 0.05 s, the bodies move from 0.065 s on."""
GRID, PITCH_M = (9, 6), 5e-3
VIEWS = 12
DARK, BRIGHT, NOISE = 40.0, 200.0, 1.5
SUBPIXELS = 4


def write_blow_film(path: Path, bodies: Path, blow: model.Solution, frames: int = FRAMES) -> None:
    """Film the blow with the virtual camera, from its trigger on, and write the outlines of its bodies.

    Parameters
    ----------
    path : ``.mraw``; the header goes beside it
    bodies : ``.toml``
    blow : of the built-in action
    frames : how many
    """
    column = [model.BODIES.index(name) for name in ("whippen", "jack", "repetition")]
    relative = blow.angle_rad[:, column]  # jack and lever from the whippen, as the camera wants them

    def angles_at(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(time_s, blow.time_s, relative[:, k]) for k in range(3)], axis=1)

    action = model.load_action()

    def pivot(body: str) -> tuple[float, float]:
        return action[f"{body}.pivot.x"], action[f"{body}.pivot.y"]

    whippen, jack, repetition = (float(value) for value in relative[0])
    geometry = ActionGeometry(pivot("whippen"), pivot("jack"), pivot("repetition"), (whippen, jack, repetition))
    times = START_S + (np.arange(frames) + 0.5) / CAMERA.frame_rate_hz
    film_trial(path, np.asarray(times, dtype=np.float64), angles_at, geometry, CAMERA, seed=1)
    vision.save_bodies(bodies, film_bodies(geometry, CAMERA))


def write_target_film(path: Path) -> None:
    """Film a checkerboard of 9 x 6 inner corners, 5 mm apart, held flat and moved within the plane of motion."""
    vision.write_mraw(path, _target_frames(), CAMERA.frame_rate_hz, bit_depth=8, comment="synthetic calibration target")


def _target_frames() -> Iterator[NDArray[np.uint8]]:
    random = np.random.default_rng(4)
    pitch_px = PITCH_M * CAMERA.scale_px_per_m
    room = 0.5 * np.array([CAMERA.width, CAMERA.height]) - 0.5 * pitch_px * (np.array(GRID) + 1.5)
    for k in range(VIEWS):
        turn = 2.0 * np.pi * k / VIEWS
        place = 0.5 * np.array([CAMERA.width, CAMERA.height]) + room * np.array([np.cos(turn), np.sin(turn)])
        picture = _checkerboard(place, 0.12 * np.sin(3.0 * turn), pitch_px)
        noisy = picture + random.normal(0.0, NOISE, picture.shape)
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _checkerboard(place_px: NDArray[np.float64], turn_rad: float, pitch_px: float) -> NDArray[np.float64]:
    """One picture (height, width), each pixel the mean of points within it."""
    (columns, rows), c, s = GRID, np.cos(turn_rad), np.sin(turn_rad)
    y, x = np.indices((CAMERA.height, CAMERA.width), dtype=float)
    total = np.zeros(x.shape)
    shifts = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    for dx in shifts:
        for dy in shifts:
            east, south = x + dx - place_px[0], y + dy - place_px[1]
            u = (c * east + s * south) / pitch_px + 0.5 * (columns - 1)
            v = (-s * east + c * south) / pitch_px + 0.5 * (rows - 1)
            inside = (np.abs(u - 0.5 * (columns - 1)) < 0.5 * (columns + 1)) & (
                np.abs(v - 0.5 * (rows - 1)) < 0.5 * (rows + 1)
            )
            total += np.where(inside & ((np.floor(u) + np.floor(v)) % 2 == 0), DARK, BRIGHT)
    return total / SUBPIXELS**2
