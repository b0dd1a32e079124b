"""Synthetic films with known poses, never square, with a scene that has no symmetry."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from benchmarks import tracking_stress as stress_films
from vision.bodies.outlines import Body
from vision.errors import VisionWarning
from vision.film.source import ArrayFilm
from vision.results.track_result import TrackResult
from vision.tracking.track_film import track as track_film


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
    with warnings.catch_warnings(action="ignore", category=VisionWarning):
        result = track_film(ArrayFilm(film.frames, 2000.0), [Body("bar", film.outline_px)])
    still = min(result.n_still, stress.STILL)
    error = (result.angle_rad[:, 0] - film.angle_rad + film.angle_rad[:still].mean())[stress.STILL :]
    return result, error, error / result.u_angle_rad[stress.STILL :, 0]


@pytest.fixture(scope="session")
def tracked(shared: Callable[..., Any]) -> Callable[..., tuple[TrackResult, np.ndarray, np.ndarray]]:
    """Track a film of the stress benchmark, once in a run; as `track_stress_film`."""
    return partial(shared, track_stress_film)
