"""Phases by the key, the band calibrated on left-out strokes, and its score."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.validation.positions.test_measured import PRESS_M, RATE, TIME_S, trial
from validation.events.strikes import HOLD, PHASES, RELEASE, STRIKE, find_phases, find_stroke_events
from validation.infer.positions import SCATTER, fit, misfit
from validation.measurement.positions import measure_stroke
from validation.prediction.positions import Mixture
from validation.statistics.bands import (
    FLOORS,
    PredictedStroke,
    PredictionBand,
    estimate_spread,
    half_width,
    interval_score,
    prediction_band,
    quantiles,
    score,
)


@pytest.fixture(scope="module")
def stroke():
    return measure_stroke(trial())


def with_key(stroke, key_m):
    return replace(stroke, key=replace(stroke.key, value_m=key_m))


def test_phases_follow_the_key(stroke) -> None:
    at = find_phases(stroke)
    order = [PHASES[i] for i in at[np.concatenate([[True], np.diff(at) != 0])]]
    assert order == ["rest", "strike", "hold", "release", "rest"][: len(order)] and "release" in order
    assert TIME_S[np.argmax(at == 1)] == pytest.approx(0.402, abs=0.003)


def test_each_repetition_is_a_strike_with_its_events(stroke) -> None:
    key = PRESS_M.copy()
    again = (TIME_S > 0.84) & (TIME_S < 1.1)
    key[again] = 0.002 + 0.007 * np.sin(np.pi * (TIME_S[again] - 0.84) / 0.26) ** 2
    shown = with_key(stroke, key)
    at, found = find_phases(shown), find_stroke_events(shown, 0.9 * key)
    assert len(found) == 2 and found[0]["impact_s"] < 0.5 < 0.9 < found[1]["impact_s"]
    assert int(np.sum(np.diff((at == 1).astype(int)) == 1)) == 2


def test_a_key_that_returns_part_way_and_is_never_held_is_struck_again(stroke) -> None:
    share = np.interp(TIME_S, [0.4, 0.44, 0.46, 0.5, 0.54, 0.58, 0.62, 0.7], [0, 1, 1, 0.4, 0.95, 0.3, 1, 0])
    at = find_phases(with_key(stroke, 0.009 * share))
    assert int(np.sum(np.diff((at == STRIKE).astype(int)) == 1)) == 3
    assert np.all(at[(TIME_S > 0.487) & (TIME_S < 0.495)] == RELEASE) and HOLD not in at


def test_interval_score_by_hand() -> None:
    measured, made, half = np.array([0.0, 1.0]), np.zeros(2), np.full(2, 0.5)
    assert interval_score(measured, made, half) == pytest.approx(1.0 + 40.0 * 0.25)


def off_by(stroke, error_m, number=1):
    return PredictedStroke(replace(stroke, number=number), stroke.hammer.value_m + error_m, np.zeros(TIME_S.size))


def test_band_covers_errors_of_the_size_it_was_calibrated_on(stroke) -> None:
    random = np.random.default_rng(0)

    def wrong(number=1):
        return off_by(stroke, 3e-4 * random.standard_normal(TIME_S.size), number)

    found = prediction_band([wrong(k) for k in (1, 2, 3)])
    new = wrong()
    half = half_width(new, found, found.q)
    assert 0.93 < score(new.stroke, new.prediction_m, half)["inside"] < 0.97
    assert np.median(half) == pytest.approx(1.96 * 3e-4, rel=0.15)
    assert set(found.left_out) == {"1", "2", "3"} and min(row["inside"] for row in found.left_out.values()) > 0.9


def test_every_training_stroke_has_the_same_weight_and_the_largest_has_all(stroke) -> None:
    pooled, largest = PredictionBand(0.02, True, "pooled"), PredictionBand(0.02, True, "largest")
    long = replace(stroke, key=replace(stroke.key, value_m=np.zeros(TIME_S.size)))  # all of it rest
    one = 0.02 * stroke.hammer.travel_m
    assert quantiles([off_by(long, one)], pooled)["rest"] == pytest.approx(1.0)
    assert quantiles([off_by(long, one), off_by(stroke, 5 * one)], pooled)["rest"] == pytest.approx(5.0)
    many = [off_by(stroke, one)] * 30 + [off_by(stroke, 5 * one)]
    assert quantiles(many, pooled)["hold"] == pytest.approx(1.0)
    assert quantiles(many, largest)["hold"] == pytest.approx(5.0)


def test_a_phase_that_no_training_stroke_shows_has_the_number_of_the_whole(stroke) -> None:
    long = replace(stroke, key=replace(stroke.key, value_m=np.zeros(TIME_S.size)))
    q = quantiles([off_by(long, 0.02 * stroke.hammer.travel_m)], PredictionBand(0.02, True, "pooled"))
    assert q["release"] == q["whole"] == pytest.approx(1.0)


def test_the_choice_is_that_of_the_training_strokes(stroke) -> None:
    """Errors in one phase only want numbers by phase; a u that has nothing to do with the error wants a high floor."""
    late = np.where(find_phases(stroke) == RELEASE, 8e-4, 4e-5)
    by_phase = prediction_band([off_by(stroke, late, 1), off_by(stroke, -late, 2)])
    assert by_phase.by_phase and by_phase.q["release"] > 5 * by_phase.q["hold"]
    slope = np.linspace(0.0, 0.02 * stroke.hammer.travel_m, TIME_S.size)  # an u that says nothing of the error
    even = prediction_band([replace(off_by(stroke, 4e-4, k), u_m=slope) for k in (1, 2)])
    assert even.floor == max(FLOORS)


def test_the_reported_score_of_a_left_out_stroke_does_not_know_it(stroke) -> None:
    small, large = off_by(stroke, 1e-4, 1), off_by(stroke, 1e-3, 2)
    found = prediction_band([small, replace(small, stroke=replace(stroke, number=3)), large])
    assert found.left_out["2"]["inside"] == 0.0 and found.left_out["1"]["inside"] == 1.0


def test_spread_carries_the_keys_calibration_and_no_stray_draw(stroke) -> None:
    def predict(z, of, displacement_m):
        return 3.0 * (of.key.value_m if displacement_m is None else displacement_m)

    count = iter(range(100))

    def stray(z, of, displacement_m):
        return predict(z, of, displacement_m) + (0.01 if next(count) % 4 == 0 else 0.0)

    made = predict(np.zeros(1), stroke, None)
    u, top = estimate_spread(stroke, predict, Mixture.of_one(np.zeros(1)), made), int(np.argmax(made))
    own = stroke.hammer.position.u_calibration_m
    assert u[0] == pytest.approx(own[0], rel=0.2) and 1.1 * u[0] < u[top]
    assert estimate_spread(stroke, stray, Mixture.of_one(np.zeros(1)), made)[top] < 3 * u[top]


def test_fit_finds_parameters_through_outliers(stroke) -> None:
    truth = np.array([2.0, -1.5])

    def predict(z, of, displacement_m):
        return (0.6 + 0.1 * z[0]) * of.key.value_m + 1e-3 * z[1] * (TIME_S > 0.6)

    measured = predict(truth, stroke, None)
    measured[(TIME_S > 0.95) & (TIME_S < 1.0)] += 0.004
    shown = replace(stroke, hammer=replace(stroke.hammer, value_m=measured))
    found = fit([shown], predict, np.zeros(2))
    u = np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(found.z - truth) < 3 * u) and np.all(u < 0.3)
    assert found.cost < found.cost_before


def test_misfit_weighs_strokes_alike_however_long(stroke) -> None:
    def predict(z, of, displacement_m):
        return of.hammer.value_m + SCATTER * of.hammer.travel_m * 1e-3

    r = misfit(np.zeros(1), [stroke], predict)
    assert r[1:] @ r[1:] == pytest.approx(60 * 1e-6, rel=1e-3)


def test_events_of_a_hammer(stroke) -> None:
    hammer = np.interp(TIME_S, [0.4, 0.45, 0.46, 0.5, 0.8, 0.85], [0.0, 0.008, 0.008, 0.005, 0.005, 0.0])
    (found,) = find_stroke_events(stroke, hammer)
    assert found["impact_s"] == pytest.approx(0.45, abs=1.5 / RATE)
    assert found["speed_m_per_s"] == pytest.approx(0.008 / 0.05, rel=0.01)
    assert found["check_m"] == pytest.approx(0.005, abs=1e-5)
    assert np.isnan(found["let_off_m"])
    assert 0.01 < found["release_s"] < 0.05
