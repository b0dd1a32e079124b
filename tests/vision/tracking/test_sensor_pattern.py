"""A fixed pattern of the sensor is found from the moving film and taken off; other disturbances are left alone."""

from __future__ import annotations

import numpy as np
import pytest

import vision.tracking.track_film
from tests.vision.known_films import PIVOT, bar_motion, bar_scene, film_of, sliding_bar, smooth_step, z_of
from vision import ArrayFilm, track


def with_pattern(film: ArrayFilm, rms: float, seed: int = 0) -> tuple[ArrayFilm, np.ndarray]:
    """The film with an offset of its own for every pixel and every column."""
    rng = np.random.default_rng(seed)
    pattern = rng.normal(0.0, rms, (film.height, film.width)) + rng.normal(0.0, 0.4 * rms, film.width)
    frames = np.stack([film.read(i) for i in range(film.n_frames)])
    return ArrayFilm(np.clip(np.rint(frames + pattern), 0, 255).astype(np.uint8), film.frame_rate_hz), pattern


@pytest.fixture
def passes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many rows each pass through a film tracks, as they come."""
    found, plain = [], vision.tracking.track_film.track_forward
    monkeypatch.setattr(
        vision.tracking.track_film, "track_forward", lambda *a: found.append(a[1].frame.size) or plain(*a)
    )
    return found


def test_a_fixed_pattern_is_taken_off(passes: list[int]) -> None:
    pose = bar_motion(110, PIVOT, 0.35)
    known = film_of(bar_scene("speckle"), pose)
    film, pattern = with_pattern(known.film, 2.5)
    result = track(film, known.bodies)
    assert not result.is_lost.any()
    assert result.info["pattern_grey"] == pytest.approx(pattern.std(), rel=0.25)
    z = z_of(result, pose)[result.n_still :]
    assert np.abs(z).max() < 5.0 and np.sqrt(np.mean(z**2)) < 1.6
    plain = track(known.film, known.bodies)
    assert passes == [110, 110, 110]  # twice with the pattern, once without
    assert plain.info["pattern_grey"] == 0.0
    assert np.median(result.u_angle_rad) < 2.0 * np.median(plain.u_angle_rad)


def test_a_body_held_back_by_a_pattern_in_a_quiet_film() -> None:
    """It moves too little for the pattern to be taken off; noise far below a grey level leaves less of u than that."""
    s = smooth_step((np.arange(90) - 20) / 60)
    pose = np.column_stack([0.03 * s, PIVOT[0] + 2.0 * s, PIVOT[1] + 0.5 * s])[:, None, :]
    known = film_of(bar_scene("wood"), pose, noise_grey=0.1)
    result = track(with_pattern(known.film, 2.5)[0], known.bodies)
    assert result.info["pattern_grey"] == 0.0
    z = z_of(result, pose)[result.n_still :]
    assert np.abs(z).max() < 5.0 and np.sqrt(np.mean(z**2)) < 2.5


def test_a_film_that_no_pattern_disturbs_is_tracked_once(passes: list[int]) -> None:
    known = film_of(bar_scene("speckle"), bar_motion(110, PIVOT, 0.35), cover=sliding_bar)
    result = track(known.film, known.bodies)
    assert passes == [110] and result.info["pattern_grey"] == 0.0
