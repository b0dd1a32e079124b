"""Offset of a film's clock against an encoder, with its uncertainty."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vision.known_films import smooth_step
from vision import InputError, estimate_offset


def blow(t: np.ndarray) -> np.ndarray:
    """Up within 30 ms, hold, down within 60 ms, 0.09 rad."""
    return 0.09 * (smooth_step((t - 0.1) / 0.03) - smooth_step((t - 0.3) / 0.06))


@pytest.mark.parametrize("free_scale", [False, True])
def test_offset_is_found_within_its_uncertainty(free_scale: bool) -> None:
    """40 films of 2000 frames/s against an encoder with steps of 0.15 mrad at 10 kHz."""
    z, size = [], []
    clock = np.arange(6000) / 10_000.0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        offset, u = rng.uniform(-2e-3, 2e-3), 1e-4
        time = 0.03 + np.arange(1000) / 2000.0 + rng.uniform(0, 5e-4)
        angle = 0.013 + (1.04 if free_scale else 1.0) * blow(time + offset) + rng.normal(0, u, time.size)
        angle[rng.integers(0, 1000, 30)] = np.nan
        step = 1.5e-4
        encoder = step * np.floor(blow(clock) / step + rng.uniform())
        found = estimate_offset(time, angle, np.full(time.size, u), clock, encoder, free_scale=free_scale)
        z.append((found.offset_s - offset) / found.u_offset_s)
        size.append(found.u_offset_s)
        if free_scale:
            assert found.scale == pytest.approx(1.04, abs=2e-3)
    # on the plateaus the steps of the encoder look like a correlated error, which makes u somewhat large
    assert 0.6 < np.std(z) < 1.2 and np.abs(np.mean(z)) < 0.35
    assert np.median(size) < 2e-5  # far below the frame of 500 us


def test_offset_refuses_uninformative_films() -> None:
    clock = np.arange(6000) / 10_000.0
    time = 0.1 + np.arange(600) / 2000.0
    u = np.full(600, 1e-4)
    with pytest.raises(InputError, match="hardly moves"):
        estimate_offset(time, np.zeros(600), u, clock, blow(clock))
    with pytest.raises(InputError, match="within the encoder"):
        estimate_offset(time + 5.0, blow(time), u, clock, blow(clock))
    with pytest.raises(InputError, match="do not fit"):
        estimate_offset(time, blow(time), u, clock, np.ones(6000) + 1e-3 * clock)
