"""The still run ends before the first motion, and noise alone does not end it."""

from __future__ import annotations

import numpy as np
import pytest

from vision import ArrayFilm
from vision.reference.still_average import average_still_frames, count_still_frames


def test_noise_alone_is_still() -> None:
    rng = np.random.default_rng(1)
    u = np.array([2e-5, 0.004, 0.006])
    counts = [count_still_frames(u * rng.standard_normal((64, 3)), np.tile(u, (64, 1))) for _ in range(200)]
    assert np.mean(np.array(counts) == 64) > 0.99


def test_understated_uncertainty_is_noticed() -> None:
    """Compressed film: the poses scatter by twice what is stated, but stand still."""
    rng = np.random.default_rng(5)
    counts = [count_still_frames(2.0 * rng.standard_normal((64, 3)), np.ones((64, 3))) for _ in range(100)]
    assert np.mean(np.array(counts) == 64) > 0.93


@pytest.mark.parametrize("power", [1, 2, 3])
def test_motion_ends_it_before_it_matters(power: int) -> None:
    """Drifts that start at frame 30: those counted as still shift the zero, in RMS, by less than its uncertainty."""
    rng = np.random.default_rng(power)
    shifts = []
    for _ in range(50):
        move = 0.4 * np.clip(np.arange(64) - 30, 0, None) ** power
        pose = (move + rng.standard_normal(64))[:, None]
        count = count_still_frames(pose, np.ones((64, 1)))
        assert 10 <= count <= 40
        shifts.append(np.mean(move[:count]) * np.sqrt(count))
    assert np.sqrt(np.mean(np.square(shifts))) < 1.0


def test_lost_frame_ends_it() -> None:
    pose = np.zeros((20, 2))
    pose[12, 1] = np.nan
    assert count_still_frames(pose, np.ones((20, 2))) == 12


def test_average_and_its_noise() -> None:
    rng = np.random.default_rng(2)
    base = rng.integers(60, 190, (40, 70)).astype(float)
    gain = 1 + 0.05 * np.sin(np.arange(30))
    frames = np.rint(base * gain[:, None, None] + 3.0 * rng.standard_normal((30, 40, 70)))
    frames[22:] = np.roll(frames[22:], 4, axis=2)
    film = ArrayFilm(frames.astype(np.uint8), 1000.0)
    region = np.zeros((40, 70), dtype=bool)
    region[5:35, 8:60] = True
    reference = average_still_frames(film, region)
    assert reference.n_averaged == 22
    assert reference.noise_grey == pytest.approx(np.hypot(3.0, 1 / np.sqrt(12)), rel=0.03)
    expected = base * gain[:22].mean()
    assert np.sqrt(np.mean((reference.picture - expected) ** 2)) == pytest.approx(3.01 / np.sqrt(22), rel=0.05)


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_noise_of_a_film_that_never_rests(noise: float) -> None:
    """A textured body moves by a pixel in each frame: the noise is found where nothing moves, not in its texture."""
    rng = np.random.default_rng(6)
    wall, body = rng.integers(60, 190, (80, 120)).astype(float), rng.integers(60, 190, (30, 40)).astype(float)
    frames = np.repeat(wall[None], 12, axis=0)
    for k, frame in enumerate(frames):
        frame[25:55, 30 + k : 70 + k] = body
    frames = np.rint(frames + noise * rng.standard_normal(frames.shape))
    region = np.zeros(wall.shape, dtype=bool)
    region[29:51, 34:66] = True
    reference = average_still_frames(ArrayFilm(frames.astype(np.uint8), 1000.0), region, n_still=1)
    assert reference.noise_grey == pytest.approx(np.hypot(noise, 1 / np.sqrt(12)), rel=0.06)
