"""Noise that a camera has filtered in time, in frames made here."""

from __future__ import annotations

import numpy as np
import pytest

from vision import ArrayFilm
from vision.reference.temporal_noise import estimate_delay_frames

HEIGHT, WIDTH, N = 100, 150, 16


def _film(rng: np.random.Generator, kept: float = 0.0, blend: float = 0.0) -> ArrayFilm:
    """Still frames of a texture, with noise of two grey levels after a filter."""
    noise = rng.normal(0.0, 4.0, (N + 30, HEIGHT, WIDTH))
    for k in range(1, len(noise)):
        noise[k] += kept * (noise[k - 1] - noise[k])
    noise[1:] = (1.0 - blend) * noise[1:] + blend * noise[:-1]
    texture = rng.normal(120.0, 20.0, (HEIGHT, WIDTH))
    return ArrayFilm(np.clip(np.rint(texture + noise[30:]), 0, 255).astype(np.uint8), 1000.0)


def test_white_noise_is_said_to_be_filtered_at_the_stated_level() -> None:
    """Of 120 films at the level 0.05, 1 to 13 with a probability of 0.99; none of them at the level used."""
    rng = np.random.default_rng(5)
    films = [_film(rng) for _ in range(120)]
    assert 1 <= sum(estimate_delay_frames(film, N, level=0.05) > 0.0 for film in films) <= 13
    assert not any(estimate_delay_frames(film, N) for film in films)


@pytest.mark.parametrize("kept", [0.2, 0.5, 0.7])
def test_a_recursive_filter_delays_by_its_steady_lag(kept: float) -> None:
    found = estimate_delay_frames(_film(np.random.default_rng(6), kept=kept), N)
    assert 0.6 * kept / (1.0 - kept) < found < 1.3 * kept / (1.0 - kept)


def test_blended_frames_are_late_by_at_most_a_frame() -> None:
    assert 0.5 <= estimate_delay_frames(_film(np.random.default_rng(7), blend=0.5), N) <= 1.1


def test_few_frames_or_none_of_noise_cannot_tell() -> None:
    film = _film(np.random.default_rng(8), kept=0.5)
    assert estimate_delay_frames(film, 3) == 0.0
    assert estimate_delay_frames(ArrayFilm(np.repeat(film.read(0)[None], 12, axis=0), 1000.0), 12) == 0.0
