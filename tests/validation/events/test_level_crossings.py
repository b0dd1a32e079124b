"""Level crossings: closed forms, hysteresis, lost samples, uncertainty of a crossing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from validation.events.crossings import (
    bend_uncertainty_s,
    down_crossings,
    read_level_with_uncertainty,
    up_crossings,
)


@given(slope=st.floats(0.1, 50), at=st.floats(0.011, 0.989))
def test_a_straight_line_is_crossed_exactly_between_samples(slope, at):
    time = np.linspace(0, 1, 101)
    signal = slope * (time - at)
    assert up_crossings(time, signal, 0.0) == pytest.approx([at], abs=1e-12)
    assert down_crossings(time, -signal, 0.0) == pytest.approx([at], abs=1e-12)


def test_noise_around_the_level_makes_one_crossing_with_hysteresis():
    time = np.arange(0, 1, 1e-3)
    signal = time - 0.5 + np.random.default_rng(0).normal(0, 0.02, time.size)
    assert len(up_crossings(time, signal, 0.0)) > 3
    assert len(up_crossings(time, signal, 0.0, 0.2)) == 1


def test_lost_samples_are_never_interpolated_over():
    time = np.arange(6.0)
    assert up_crossings(time, np.array([-1.0, -1, np.nan, 1, 1, 1]), 0.0) == []
    assert up_crossings(time, np.array([-1.0, np.nan, -1, 1, 1, 1]), 0.0) == pytest.approx([2.5])


def test_a_crossing_that_jumps_to_the_next_swing_gets_a_large_uncertainty():
    time = np.arange(0, 2, 1e-3)
    signal = np.exp(-time) * np.sin(2 * np.pi * time)  # second maximum 0.29

    def last(level):
        return max(up_crossings(time, signal, level), default=None)

    value, u = read_level_with_uncertainty(last, 0.28, 0.02)
    assert value == pytest.approx(1.2, abs=0.05)
    assert u == pytest.approx(value - up_crossings(time, signal, 0.30)[0])  # a whole swing earlier


def test_a_bent_signal_is_missed_by_no_more_than_its_bend():
    z = []
    for phase in np.linspace(0, 1, 41)[:-1]:
        time = (np.arange(60) + phase) * 1e-3
        signal = 1.0 - 700.0 * (time - 0.05) ** 2
        true = 0.05 - np.sqrt(0.5 / 700.0)
        (found,) = [t for t in up_crossings(time, signal, 0.5) if t < 0.05]
        z.append((found - true) / bend_uncertainty_s(time, signal, found))
    assert 0.9 < np.sqrt(np.mean(np.square(z))) < 1.1
    assert bend_uncertainty_s(np.arange(5.0), np.zeros(5), 2.5) == 0.0
