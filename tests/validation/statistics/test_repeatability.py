"""Repeatability: published factors, few trials."""

from __future__ import annotations

import numpy as np
import pytest

from validation import EVENTS, Event
from validation.events.detect import make_absent_event
from validation.statistics.repeatability import (
    STANDS_OUT,
    compute_distance_ratios,
    curve_repeatability,
    event_repeatability,
    few_trials_warning,
    limit_factor,
    s_interval_factors,
)


@pytest.mark.parametrize(("n", "factor"), [(5, 3.93), (10, 3.20), (20, 2.96)])
def test_limit_factor_of_few_trials(n, factor):
    assert limit_factor(n) == pytest.approx(factor, abs=0.005)


def test_limit_factor_tends_to_that_of_the_standard():
    assert limit_factor(100_000) == pytest.approx(1.96 * np.sqrt(2), abs=1e-3)


@pytest.mark.parametrize(("n", "low", "high"), [(3, 0.52, 6.28), (5, 0.60, 2.87), (10, 0.69, 1.83), (20, 0.76, 1.46)])
def test_interval_of_s(n, low, high):
    assert s_interval_factors(n) == pytest.approx((low, high), abs=0.006)


def test_s_r_of_a_known_table():
    r = curve_repeatability(np.array([[1.0, 2.0, 3.0], [4.0, 4.0, 7.0]]))
    np.testing.assert_allclose(r.s_r, [1.0, np.sqrt(3.0)])
    np.testing.assert_allclose(r.mean, [2.0, 5.0])
    assert r.pooled == pytest.approx(np.sqrt(2.0))
    assert r.largest == pytest.approx(np.sqrt(3.0))


def test_lost_samples_are_left_out_one_by_one():
    r = curve_repeatability(np.array([[1.0, np.nan, 3.0], [np.nan, np.nan, 5.0], [np.nan] * 3]))
    assert r.s_r[0] == pytest.approx(np.sqrt(2.0))
    assert np.isnan(r.s_r[1:]).all()
    assert r.mean[1] == 5.0
    assert np.isnan(r.mean[2])


def test_one_trial_has_no_repeatability():
    r = curve_repeatability(np.arange(10.0)[:, None])
    assert np.isnan(r.pooled)
    assert np.isnan(r.limit)
    assert np.isnan(limit_factor(1))
    assert all(np.isnan(s_interval_factors(1)))


def test_one_trial_that_stands_out_is_found_and_good_ones_are_not():
    rng = np.random.default_rng(17)
    base = np.sin(np.linspace(0, 9, 800))
    shapes = rng.normal(size=(300, 6, 5)) @ np.array([np.cos(np.linspace(0, k, 800)) for k in range(1, 6)])
    false = [compute_distance_ratios((base + 0.01 * s).T).max() > STANDS_OUT for s in shapes]
    assert np.mean(false) < 0.03
    bad = base + 0.01 * shapes[0]
    bad[3] = np.roll(bad[3], 40)
    ratios = compute_distance_ratios(bad.T)
    assert ratios.argmax() == 3
    assert ratios[3] > STANDS_OUT
    assert np.delete(ratios, 3).max() < STANDS_OUT
    assert np.isnan(compute_distance_ratios(bad[:3].T)).all()
    assert np.isnan(compute_distance_ratios(np.ones((10, 5)))).all()


def trial(speed):
    events = {name: make_absent_event(name) for name in EVENTS}
    if speed is not None:
        events["hammer_speed"] = Event("hammer_speed", speed, 0.01, "found")
    return events


@pytest.mark.parametrize("n", [4, 5, 30])
def test_the_distance_is_from_the_median_of_the_other_trials_ties_and_gaps_included(n):
    curves = np.round(np.random.default_rng(n).normal(size=(200, n)), 1)
    curves[3, 1] = np.nan
    known = np.delete(curves, 3, axis=0)
    apart = [known[:, i] - np.median(np.delete(known, i, axis=1), axis=1) for i in range(n)]
    distance = np.sqrt(np.mean(np.square(apart), axis=1))
    np.testing.assert_allclose(compute_distance_ratios(curves), distance / np.median(distance), rtol=1e-12)


def test_event_repeatability_counts_presence_and_uses_found_events_only():
    table = event_repeatability({1: trial(2.0), 2: trial(2.2), 3: trial(None)}).set_index("event")
    row = table.loc["hammer_speed"]
    assert (row["n_found"], row["n_absent"], row["n_ambiguous"]) == (2, 1, 0)
    assert row["mean"] == pytest.approx(2.1)
    assert row["s"] == pytest.approx(np.sqrt(0.02))
    assert row["limit"] == pytest.approx(np.sqrt(0.02) * limit_factor(2))
    assert np.isnan(table.loc["rest", "s"])


def test_warning_below_six_trials():
    assert "factor of 0.60 to 2.87" in few_trials_warning(5)
    assert "One trial" in few_trials_warning(1)
    assert few_trials_warning(6) == ""


def test_two_kinds_of_stroke_are_compared_within_each():
    rng = np.random.default_rng(6)
    curves = rng.normal(0, 1.0, (4000, 6)) + np.array([0, 10, 0, 10, 0, 10])
    kinds = [0, 1, 0, 1, 0, 1]
    apart = curve_repeatability(curves, kinds)
    assert apart.pooled == pytest.approx(1.0, rel=0.03)
    assert np.isnan(apart.mean).all()
    assert apart.limit == pytest.approx(apart.pooled * limit_factor(5))  # four degrees of freedom
    assert curve_repeatability(curves).pooled > 5
    one = curve_repeatability(curves[:, :3], [4, 4, 4])
    np.testing.assert_allclose(one.s_r, curve_repeatability(curves[:, :3]).s_r)
    assert np.isfinite(one.mean).all()
    lost = curves.copy()
    lost[0, [1, 3, 5]] = np.nan
    assert apart.s_r[1] == curve_repeatability(lost, kinds).s_r[1]
    assert curve_repeatability(lost, kinds).s_r[0] == pytest.approx(lost[0, [0, 2, 4]].std(ddof=1))


def test_events_of_two_kinds_scatter_within_each():
    speeds = {1: 2.0, 2: 4.0, 3: 2.2, 4: 4.2}
    table = event_repeatability({n: trial(v) for n, v in speeds.items()}, [(1, 3), (2, 4)]).set_index("event")
    row = table.loc["hammer_speed"]
    assert row["s"] == pytest.approx(np.sqrt(0.02))
    assert row["limit"] == pytest.approx(row["s"] * limit_factor(3))
    assert row["range"] == pytest.approx(0.2)
