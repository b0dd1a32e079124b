"""Frame times: exposure centres, counted pulses, and the offset against an encoder with its uncertainty."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vision.known_films import smooth_step
from vision import InputError, estimate_offset, times_of_counts, times_of_edges


def blow(t: np.ndarray) -> np.ndarray:
    """Up within 30 ms, hold, down within 60 ms, 0.09 rad."""
    return 0.09 * (smooth_step((t - 0.1) / 0.03) - smooth_step((t - 0.3) / 0.06))


def test_exposure_centre_and_delay() -> None:
    edges = np.array([0.5, 0.502, 0.505])
    np.testing.assert_allclose(times_of_edges(edges, 4e-4, 3e-5), edges + 2.3e-4)
    with pytest.raises(InputError, match="increase"):
        times_of_edges(edges[::-1])
    with pytest.raises(InputError, match="longer than a frame"):
        times_of_edges(edges, 2.1e-3)


@pytest.mark.parametrize("derived", [True, False])
def test_counted_pulses(derived: bool) -> None:
    """Error over stated uncertainty, for a frame clock derived from the sample clock and for a free one."""
    rng = np.random.default_rng(4)
    z = []
    for _ in range(60):
        sample = np.arange(6000) / 10_000.0
        period = 5e-4 if derived else rng.uniform(4.7e-4, 5.4e-4)
        start = rng.uniform(0.02, 0.021)
        edges = start + period * np.arange(700)
        count = np.searchsorted(edges, sample, side="right")
        found = times_of_counts(sample, count, 1e-4, 2e-5)
        true = edges[: found.time_s.size] + 7e-5
        assert np.abs(found.time_s - true).max() < 6e-5  # never more than half a sample
        z.append((found.time_s - true).mean() / found.u_time_s)
    assert np.max(np.abs(z)) < 2.5
    # with a free clock the line narrows the interval below the stated floor of a quarter of a sample
    assert (0.4 if derived else 0.0) < np.std(z) < 1.3


def test_counted_pulses_start_anywhere_and_gaps_are_refused() -> None:
    sample = np.arange(2000) / 10_000.0
    edges = 1e-4 * 0.3 + 5e-4 * np.arange(400)
    late = times_of_counts(sample[700:], np.searchsorted(edges, sample[700:], side="right"))
    assert np.abs(late.time_s[0] - edges[edges > sample[700]][0]) < 6e-5
    lost = np.delete(edges, 120)
    with pytest.raises(InputError, match=r"lies [234]\d\d us off a regular clock; pulses were lost"):  # of a gap of 500
        times_of_counts(sample, np.searchsorted(lost, sample, side="right"))
    with pytest.raises(InputError, match="faster"):
        times_of_counts(sample[::40], np.searchsorted(edges, sample[::40], side="right"))
    with pytest.raises(InputError, match="never fall"):
        times_of_counts(sample, -np.searchsorted(edges, sample, side="right"))


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
