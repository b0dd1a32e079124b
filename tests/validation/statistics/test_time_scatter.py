"""Scatter in time: known shifts are found, scatter in value is none, and the reach is where the mean comes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from validation.statistics import repeatability_band as bands
from validation.statistics.repeatability_band import TIME_CONFIDENCE, estimate_time_scatter, extend_in_time

T = np.arange(600.0)[:, None]
LATE = np.array([-3.0, -1.0, 0.0, 1.0, 3.0])


def blow(late, strength=1.0):
    """A stroke down and up again, its return later by twice as much."""
    return strength * (np.tanh((T - 150 - late) / 15) - np.tanh((T - 400 - 2 * late) / 15))


def test_the_shift_of_each_part_is_found_and_stays():
    s = estimate_time_scatter(blow(LATE))
    sd = LATE.std(ddof=1)
    assert s[0] == 0.0
    assert s[150] == pytest.approx(sd, rel=0.05)
    assert s[300] == pytest.approx(sd, rel=0.1)  # nothing moves: the delay stays
    assert s[400] == pytest.approx(2 * sd, rel=0.05)
    assert np.all(np.diff(s) >= 0)


def test_the_shift_of_a_bounce_that_is_over_sooner_is_not_told_too_short(monkeypatch):
    later = blow(0.0) - 0.1 * np.exp(-(((T - 520 - 6 * LATE) / 5) ** 2))
    assert estimate_time_scatter(later)[560] > 6 * LATE.std(ddof=1)
    monkeypatch.setattr(bands, "SCALES", (1,))  # not of the curves as they are
    assert estimate_time_scatter(later)[560] < 6 * LATE.std(ddof=1)


def test_scatter_in_value_is_no_shift():
    strength = 1 + 0.05 * LATE
    held = np.exp(-(((T - 275) / 60) ** 2))
    level = estimate_time_scatter(blow(0.0) + 0.02 * LATE * held)
    assert level[140] < 0.1
    assert estimate_time_scatter(blow(0.0, strength))[140] < 1.5
    assert estimate_time_scatter(np.random.default_rng(1).normal(0, 1, (600, 5))).max() == 0.0  # no motion in common


def test_what_looks_like_a_delay_of_creeping_yields_to_the_next_fast_motion():
    creeping = blow(0.0) + 0.02 * LATE * np.exp(-(((T - 275) / 60) ** 2))
    fast_after = estimate_time_scatter(creeping)
    assert fast_after[300] < 1.0  # 9.9 samples by the creeping alone
    late_after = estimate_time_scatter(creeping + blow(LATE) - blow(0.0))
    assert late_after[-1] == pytest.approx(2 * LATE.std(ddof=1), rel=0.15)


def test_equal_and_resting_curves_have_none():
    assert estimate_time_scatter(np.zeros((50, 5))).max() == 0.0
    assert estimate_time_scatter(np.repeat(blow(0.0), 5, axis=1)).max() == pytest.approx(0.0, abs=1e-9)


def test_the_reach_is_the_largest_change_within_the_shift():
    mean = np.where(np.arange(100) < 50, 0.0, 1.0)
    scatter = np.where(np.arange(100) < 20, 0.0, 2.0)
    reach = extend_in_time(mean, scatter, 10)
    far = np.flatnonzero(reach > 0)
    assert np.all(reach[far] == 1.0)
    assert far[0] == 100 - 1 - far[-1]  # as far before the step as after it
    further = stats.t.ppf(0.5 + TIME_CONFIDENCE / 2, 9) * np.sqrt(1 + 1 / 10)
    assert 50 - far[0] == round(2.0 * further)  # the shift of a further trial
    assert extend_in_time(mean, 0 * scatter, 10).max() == 0.0
