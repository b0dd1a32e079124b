"""Spacing of stamps: even, with gaps, uneven, or a ramp; and the scale that a stated rate gives them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vision import FilmError, VisionInputError, VisionWarning
from vision.film.source import ArrayFilm
from vision.film.time_scale import classify_spacing, frame_times_at_rate, warn_of_uneven_times

GAP = np.r_[0:30, 40:70]


@given(
    rate=st.floats(10.0, 12_000.0),
    tick=st.sampled_from([1e-3, 1 / 600, 1 / 12_800, 1 / 90_000, 1e-6]),
    n=st.integers(24, 300),
    shift=st.floats(0.0, 1.0),
)
def test_a_constant_rate_is_even_however_it_is_rounded(rate: float, tick: float, n: int, shift: float) -> None:
    stamps = np.rint(np.arange(n) / rate / tick + shift) * tick
    found = classify_spacing(stamps, tick)
    # a tick that lasts nearly a frame cannot tell rounding from a frame left out; times are off by less than one then
    if found.kind == "gaps":
        assert 1.0 <= 1.0 / (rate * tick) < 8.0
        assert np.abs(np.cumsum(found.missing + 1) * found.interval_s - np.arange(1, n) / rate).max() <= 2.1 * tick
    else:
        assert found.kind == "even" and not found.missing.any()
        assert np.abs(np.arange(n) * (found.interval_s - 1.0 / rate)).max() <= 2.0 * tick


def test_single_frames_dropped_at_random_are_gaps() -> None:
    rng = np.random.default_rng(5)
    kept = np.flatnonzero(rng.random(400) > 0.2)
    found = classify_spacing(kept / 240.0, 1 / 90_000, None)
    assert found.kind == "gaps"
    np.testing.assert_array_equal(found.missing, np.diff(kept) - 1)


def test_a_rate_that_varies_without_order_is_no_ramp() -> None:
    """The stated share of false alarms is one in 10,000."""
    rng = np.random.default_rng(1)
    kinds = [classify_spacing(np.cumsum(rng.uniform(0.7, 1.3, 60)), 0.0).kind for _ in range(500)]
    assert kinds.count("variable") == 500


RAMPS = {
    "slower and back": 1.0 + 7.0 * np.sin(np.linspace(0.0, np.pi, 59)) ** 2,
    "slower and slower": np.linspace(1.0, 2.0, 59),
    "eight times slower for a while": np.r_[np.ones(20), np.full(20, 8.0), np.ones(19)],
    "half as fast again": np.r_[np.ones(30), np.full(29, 1.5)],
}


@pytest.mark.parametrize("name", RAMPS)
def test_a_ramp_is_refused(name: str) -> None:
    time_s = np.r_[0.0, np.cumsum(RAMPS[name])] / 25.0
    assert classify_spacing(time_s, 1 / 12_800).kind == "ramp"
    film = Stamped(time_s)
    with pytest.raises(FilmError, match=r"change pace, from .* frames/s.*without the ramp"):
        frame_times_at_rate(film, 2000.0)


class Stamped(ArrayFilm):
    """Frames in memory with time stamps."""

    def __init__(self, time_s: np.ndarray, from_camera: bool = False, rate_hz: float | None = None) -> None:
        super().__init__(np.zeros((len(time_s), 4, 6), np.uint8), frame_rate_hz=rate_hz)
        self.camera_time_s, self.has_camera_times = time_s, from_camera


def test_uneven_stamps_keep_their_pattern_at_the_true_rate() -> None:
    with pytest.warns(
        VisionWarning, match=r"10 frames missing in 1 gap, after frame 29.* 25 frames/s, 2000 are stated"
    ):
        times = frame_times_at_rate(Stamped(GAP / 25.0), 2000.0)
    np.testing.assert_allclose(times, GAP / 2000.0, atol=1e-12)
    jitter = np.r_[0.0, np.cumsum(np.random.default_rng(2).uniform(0.8, 1.2, 59))]
    with pytest.warns(VisionWarning, match="variable rate"):
        times = frame_times_at_rate(Stamped(jitter / 25.0), 2000.0)
    np.testing.assert_allclose(times, jitter / np.median(np.diff(jitter)) / 2000.0, atol=1e-12)
    np.testing.assert_allclose(frame_times_at_rate(Stamped(np.arange(60) / 25.0), 2000.0), np.arange(60) / 2000.0)


def test_a_rate_is_compared_with_the_camera_s_own_times() -> None:
    micro = np.rint(np.arange(60) / 3000.0 * 1e6) * 1e-6
    film = Stamped(micro, from_camera=True)
    assert frame_times_at_rate(film, 3000.0) is micro
    for wrong in (2990.0, 3001.0, 6000.0, 1000.0, 25.0):
        with pytest.raises(FilmError, match=rf"{wrong:g} frames/s is stated, the camera's own times say (3000|2999.9)"):
            frame_times_at_rate(film, wrong)
    fourth = Stamped(np.arange(60) * 4 / 2000.0, from_camera=True, rate_hz=2000.0)
    with pytest.raises(FilmError, match=r"2000 frames/s is stated, .* say 500 \(it took 2000 and saved every 4th\)"):
        frame_times_at_rate(fourth, 2000.0)
    assert frame_times_at_rate(fourth, 500.0)[-1] == 59 * 4 / 2000.0
    with pytest.raises(FilmError, match="say 2000, and 10 frames missing in 1 gap, after frame 29; leave out"):
        frame_times_at_rate(Stamped(GAP / 2000.0, from_camera=True), 2000.0)


def test_a_rate_that_is_none_is_refused() -> None:
    for wrong in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(VisionInputError, match="needs a positive number"):
            frame_times_at_rate(ArrayFilm(np.zeros((3, 4, 6), np.uint8)), wrong)


def test_stamps_that_go_back_are_refused() -> None:
    with pytest.raises(FilmError, match="frames 1 and 2 have the same time stamp, or stamps that go back"):
        classify_spacing(np.array([0.0, 1.0, 0.5, 2.0, 3.0]), 1e-4)
    coarse = np.floor(GAP / 2400.0 / 1e-3) * 1e-3
    with pytest.raises(FilmError, match="at 1 ms too coarse to tell which frames are missing"):
        classify_spacing(coarse, 1e-3)


@pytest.mark.parametrize(("rate", "tick"), [(240.0, 1e-3), (120.0, 1e-3), (960.0, 1 / 12800), (5000.0, 1 / 90_000)])
@pytest.mark.parametrize("seed", range(5))
def test_frames_left_out_are_counted_in_rounded_stamps(rate: float, tick: float, seed: int) -> None:
    """Rounding makes the usual interval 4 % too short here, so that a long gap would be half a frame off."""
    rng = np.random.default_rng(seed)
    places = np.arange(300)
    for at in (40, 170):
        places[at:] += rng.integers(8, 40)
    spacing = classify_spacing(np.rint(places / rate / tick + rng.uniform()) * tick, tick)
    assert spacing.kind == "gaps"
    np.testing.assert_array_equal(spacing.missing, np.diff(places) - 1)
    assert abs(spacing.interval_s * rate - 1.0) < 2.0 * tick * rate / 300


def test_a_long_interval_that_is_no_multiple_is_said() -> None:
    film = ArrayFilm(np.zeros((40, 4, 5), np.uint8))
    times = np.cumsum(np.random.default_rng(5).uniform(0.8, 1.25, 40)) * 1e-3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_uneven_times(film, times)
    times[25:] += 0.0037
    with pytest.warns(VisionWarning, match=r"unevenly: 4\.\d+ ms after frame 24"):
        warn_of_uneven_times(film, times)
