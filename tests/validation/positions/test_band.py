"""Phases by the key, the band calibrated on left-out strokes, and its score."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.validation.positions.test_measured import PRESS_M, RATE, TIME_S, trial
from validation.positions.band import PHASES, half_width, interval_score, phases, quantiles, spread
from validation.positions.events import find
from validation.positions.identify import SCATTER, fit, misfit
from validation.positions.measured import measure_stroke


@pytest.fixture(scope="module")
def stroke():
    return measure_stroke(trial())


def with_key(stroke, key_m):
    return replace(stroke, key=replace(stroke.key, value_m=key_m))


def test_phases_follow_the_key(stroke) -> None:
    at = phases(stroke)
    order = [PHASES[i] for i in at[np.concatenate([[True], np.diff(at) != 0])]]
    assert order == ["rest", "strike", "hold", "release", "rest"][: len(order)] and "release" in order
    assert TIME_S[np.argmax(at == 1)] == pytest.approx(0.402, abs=0.003)


def test_each_repetition_is_a_strike(stroke) -> None:
    key = PRESS_M.copy()
    again = (TIME_S > 0.84) & (TIME_S < 1.1)
    key[again] = 0.002 + 0.007 * np.sin(np.pi * (TIME_S[again] - 0.84) / 0.26) ** 2
    at = phases(with_key(stroke, key))
    assert int(np.sum(np.diff((at == 1).astype(int)) == 1)) == 2


def test_interval_score_by_hand() -> None:
    measured, made, half = np.array([0.0, 1.0]), np.zeros(2), np.full(2, 0.5)
    assert interval_score(measured, made, half) == pytest.approx(1.0 + 40.0 * 0.25)


def test_band_covers_errors_of_the_size_it_was_calibrated_on(stroke) -> None:
    random = np.random.default_rng(0)
    u = np.full(TIME_S.size, 1e-4)

    def wrong():
        return stroke.hammer.value_m + 3e-4 * random.standard_normal(TIME_S.size)

    q = quantiles([(stroke, wrong(), u), (stroke, wrong(), u)])
    assert min(q.values()) > 5.0 and max(q.values()) < 9.0  # 1.96 times three
    inside = np.abs(wrong() - stroke.hammer.value_m) <= half_width(stroke, u, q)
    assert 0.93 < inside.mean() < 0.995


def test_every_left_out_stroke_has_the_same_weight(stroke) -> None:
    u = np.full(TIME_S.size, 1e-4)
    long = replace(stroke, key=replace(stroke.key, value_m=np.zeros(TIME_S.size)))  # all of it rest
    good, bad = stroke.hammer.value_m + 1e-4, stroke.hammer.value_m + 5e-4
    alone = quantiles([(long, good, u)])
    assert alone["rest"] == pytest.approx(1.0) and alone["hold"] == 0.0
    assert quantiles([(long, good, u), (stroke, bad, u)])["rest"] == pytest.approx(5.0)


def test_spread_carries_the_keys_calibration_and_no_stray_draw(stroke) -> None:
    def predict(z, of, displacement_m):
        return 3.0 * (of.key.value_m if displacement_m is None else displacement_m)

    count = iter(range(100))

    def stray(z, of, displacement_m):
        return predict(z, of, displacement_m) + (0.01 if next(count) % 4 == 0 else 0.0)

    made = predict(np.zeros(1), stroke, None)
    u, top = spread(stroke, predict, np.zeros(1), made), int(np.argmax(made))
    assert u[0] == pytest.approx(2.0e-4, rel=0.02) and 1.1 * u[0] < u[top] < 2.0 * u[0]
    assert spread(stroke, stray, np.zeros(1), made)[top] < 3 * u[top]


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
    (found,) = find(stroke, hammer)
    assert found["impact_s"] == pytest.approx(0.45, abs=1.5 / RATE)
    assert found["speed_m_per_s"] == pytest.approx(0.008 / 0.05, rel=0.01)
    assert found["check_m"] == pytest.approx(0.005, abs=1e-5)
    assert np.isnan(found["let_off_m"])
    assert 0.01 < found["release_s"] < 0.05


def test_every_repetition_has_its_events(stroke) -> None:
    key = PRESS_M.copy()
    again = (TIME_S > 0.84) & (TIME_S < 1.1)
    key[again] = 0.002 + 0.007 * np.sin(np.pi * (TIME_S[again] - 0.84) / 0.26) ** 2
    shown = with_key(stroke, key)
    found = find(shown, 0.9 * key)
    assert len(found) == 2 and found[0]["impact_s"] < 0.5 < 0.9 < found[1]["impact_s"]
