"""Positions of a stroke: drift and hum are taken off, noise is averaged where the ruler is steep, doubts are named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rig.session.info import NO_FORCE, ChannelInfo, RulerInfo
from rig.session.trial_data import TrialData
from validation.errors import TrialError
from validation.events.strikes import find_stroke_events
from validation.measurement.positions import measure_stroke, smoothed

RATE = 2000.0
RULER_M = np.linspace(0.0, 0.010, 21)
TIME_S = np.arange(int(1.2 * RATE)) / RATE
PRESS_M = 0.009 * np.clip((TIME_S - 0.4) / 0.03, 0, 1) * (1 - np.clip((TIME_S - 0.8) / 0.05, 0, 1))


def reading(displacement_m):
    return 0.05 * (np.exp(3.0 * np.asarray(displacement_m) / 0.010) - 1.0)


def channel(body: str) -> ChannelInfo:
    ruler = RulerInfo(body, "there", "here", tuple(reading(RULER_M)), tuple(RULER_M), 2e-5, 1e-4)
    return ChannelInfo(body, "position", "1", "s", "ruler", (0.0, 1.0), (0.0, 1.0), u_noise=5e-4, ruler=ruler)


def trial(key_m=PRESS_M, hammer_m=0.8 * PRESS_M, extra=0.0, seed=1) -> TrialData:
    random = np.random.default_rng(seed)
    values = np.column_stack([reading(key_m), reading(hammer_m)]) + 5e-4 * random.standard_normal((TIME_S.size, 2))
    missing = np.full(TIME_S.size, np.nan)
    return TrialData(
        number=1, status="complete", started_utc="", simulated=True, sample_rate_hz=RATE, time_s=TIME_S,
        force_n=missing, force_raw=missing, motor_command_v=missing, blow_start_s=0.4,
        encoder_count=np.empty((TIME_S.size, 0), dtype=np.int64), encoders=(), force_info=NO_FORCE,
        channels=(channel("key"), channel("hammer")), channel_values=values + np.asarray(extra).reshape(-1, 1),
        provenance={"mains_frequency_hz": "50"},
    )  # fmt: skip


def test_displacement_is_found_under_drift_and_hum() -> None:
    extra = 0.02 + 0.004 * np.sin(2 * np.pi * 50.0 * TIME_S + 1.0)
    stroke = measure_stroke(trial(extra=extra))
    assert stroke.key.zero_reading == pytest.approx(0.02, abs=2e-4)
    error = stroke.key.value_m - PRESS_M
    assert np.sqrt(np.mean(error**2)) < 8e-5
    raw = trial(extra=extra).position("key").displacement_m - PRESS_M
    assert np.sqrt(np.mean(raw**2)) > 8e-4  # what drift does that is not taken off


def test_mains_of_another_country_is_not_fitted() -> None:
    hum = 0.004 * np.sin(2 * np.pi * 50.0 * TIME_S)
    wrong = dataclasses.replace(trial(extra=hum), provenance={"mains_frequency_hz": "60"})
    left = measure_stroke(wrong).key.value_m[:400].std()
    assert left > 5 * measure_stroke(trial(extra=hum)).key.value_m[:400].std()


def test_smoothing_averages_only_where_noise_asks() -> None:
    step = np.where(np.arange(400) < 200, 0.0, 1.0)
    assert np.abs(smoothed(step, np.full(400, 1e-6), 1e-5) - step).max() < 3e-3
    noise = np.random.default_rng(0).standard_normal(4000)
    assert smoothed(noise, np.full(4000, 5.0), 1.0)[100:-100].std() == pytest.approx(0.2, rel=0.15)


def test_a_trial_without_a_hammer_is_named() -> None:
    data = trial()
    alone = dataclasses.replace(data, channels=data.channels[:1], channel_values=data.channel_values[:, :1])
    with pytest.raises(TrialError, match="0 position sensors of the hammer, allowed 1"):
        measure_stroke(alone)


def begun(start_s: float, seed: int, hum: float = 0.004, rise_s: float = 0.03) -> tuple[TrialData, np.ndarray]:
    """A trial whose stroke leaves its rest at a time, and the true displacement of its key."""
    key_m = 0.009 * np.clip((TIME_S - start_s) / rise_s, 0, 1) * (1 - np.clip((TIME_S - start_s - 0.4) / 0.05, 0, 1))
    extra = 0.02 + hum * np.sin(2 * np.pi * 50.0 * TIME_S + seed)
    triggered = float(TIME_S[np.argmax(key_m > 0.15 * RULER_M[-1])])
    return dataclasses.replace(trial(key_m, 0.8 * key_m, extra, seed), blow_start_s=triggered), key_m


@pytest.mark.parametrize("start_s", [0.04, 0.05, 0.062, 0.1, 0.2])
def test_a_short_rest_is_used_with_the_uncertainty_that_it_leaves(start_s: float) -> None:
    errors, stated = [], []
    for seed in range(20):
        data, key_m = begun(start_s, seed)
        stroke = measure_stroke(data)
        held = (key_m > 0.0045) & (start_s + 0.05 < TIME_S) & (start_s + 0.35 > TIME_S)
        errors.append((stroke.key.value_m - key_m)[held].mean())
        stated.append(stroke.key.u_zero_m[held].mean())
        assert abs(stroke.key.zero_reading - 0.02) < 0.002
    u = float(np.hypot(np.mean(stated), stroke.key.position.u_calibration_m[held].mean()))
    assert np.sqrt(np.mean(np.square(errors))) < 2.0 * u < 2e-3


def test_the_shorter_the_rest_the_larger_its_uncertainty() -> None:
    u = [measure_stroke(begun(start, 3)[0]).key.u_zero_m.max() for start in (0.04, 0.1, 0.2)]
    assert u[0] > 1.3 * u[1] > 1.6 * u[2] > 0
    assert measure_stroke(begun(0.35, 3)[0]).key.u_zero_m.max() < 1e-6  # a whole rest


@pytest.mark.parametrize("rise_s", [0.01, 0.03, 0.3, 1.0])
@pytest.mark.parametrize("start_s", [0.0, 0.005, 0.01, 0.02])
def test_a_stroke_without_a_period_of_rest_is_left_out_and_says_why(start_s: float, rise_s: float) -> None:
    for seed in range(10):
        with pytest.raises(TrialError, match="at rest, one period .*; needed 20, .* is left out") as e:
            measure_stroke(begun(start_s, seed, rise_s=rise_s)[0])
        assert "\n" not in str(e.value)


@pytest.mark.parametrize("seed", range(5))
def test_a_slow_press_is_not_taken_for_rest(seed: int) -> None:
    data, key_m = begun(0.062, seed, hum=0.001, rise_s=1.0)
    assert data.blow_start_s > 0.2  # most of what comes before the trigger is motion
    stroke = measure_stroke(data)
    assert np.abs((stroke.key.value_m - key_m)[:120]).max() < 4e-4
    assert abs((stroke.key.value_m - key_m)[600:800].mean()) < 2.5e-4


def test_another_calibration_stays_within_its_uncertainty() -> None:
    stroke = measure_stroke(trial())
    random = np.random.default_rng(2)
    away = np.array([stroke.key.draw(random) - stroke.key.value_m for _ in range(40)])
    assert np.abs(away[:, :200]).max() < 5e-5  # zero at rest, by definition
    assert 1e-5 < away.std(axis=0).max() < 1e-4


def test_a_hammer_still_rising_at_the_recordings_end_has_struck_nothing() -> None:
    stroke = measure_stroke(trial())
    (whole,) = find_stroke_events(stroke, stroke.hammer.value_m)
    assert whole["impact_s"] == pytest.approx(0.43, abs=3e-3) and whole["speed_m_per_s"] == pytest.approx(0.24, rel=0.1)
    n = int(np.searchsorted(stroke.time_s, 0.425))
    parts = [dataclasses.replace(one, value_m=one.value_m[:n]) for one in (stroke.key, stroke.hammer)]
    cut = dataclasses.replace(stroke, time_s=stroke.time_s[:n], key=parts[0], hammer=parts[1])
    (seen,) = find_stroke_events(cut, cut.hammer.value_m)
    assert all(np.isnan(value) for value in seen.values())
