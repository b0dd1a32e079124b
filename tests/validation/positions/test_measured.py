"""Positions of a stroke: drift and hum are taken off, noise is averaged where the ruler is steep, doubts are named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rig.session.info import NO_FORCE, ChannelInfo, RulerInfo
from rig.session.trial_data import TrialData
from validation.errors import TrialError
from validation.measurement.position_sensors import SensorCalibration, reference_turns
from validation.measurement.positions import measure_positions, smooth_to_noise
from validation.measurement.trial import MeasuredTrial

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
        raw_force_n=missing, force_raw=missing, motor_command_v=missing, blow_start_s=0.4,
        encoder_count=np.empty((TIME_S.size, 0), dtype=np.int64), encoders=(), force_info=NO_FORCE,
        channels=(channel("key"), channel("hammer")), channel_values=values + np.asarray(extra).reshape(-1, 1),
        provenance={"mains_frequency_hz": "50"},
    )  # fmt: skip


def measure(data: TrialData) -> MeasuredTrial:
    return measure_positions(data, SensorCalibration())


def key_of(m: MeasuredTrial) -> np.ndarray:
    assert m.sensors is not None
    return m.sensors.key_m


def test_displacement_is_found_under_drift_and_hum() -> None:
    extra = 0.02 + 0.004 * np.sin(2 * np.pi * 50.0 * TIME_S + 1.0)
    error = key_of(measure(trial(extra=extra))) - PRESS_M
    assert np.sqrt(np.mean(error**2)) < 8e-5
    raw = trial(extra=extra).position("key").displacement_m - PRESS_M
    assert np.sqrt(np.mean(raw**2)) > 8e-4  # what drift does that is not taken off


def test_mains_of_another_country_is_not_fitted() -> None:
    hum = 0.004 * np.sin(2 * np.pi * 50.0 * TIME_S)
    wrong = dataclasses.replace(trial(extra=hum), provenance={"mains_frequency_hz": "60"})
    left = key_of(measure(wrong))[:400].std()
    assert left > 5 * key_of(measure(trial(extra=hum)))[:400].std()


def test_smoothing_averages_only_where_noise_asks() -> None:
    step = np.where(np.arange(400) < 200, 0.0, 1.0)
    assert np.abs(smooth_to_noise(step, np.full(400, 1e-6), 1e-5) - step).max() < 3e-3
    noise = np.random.default_rng(0).standard_normal(4000)
    assert smooth_to_noise(noise, np.full(4000, 5.0), 1.0)[100:-100].std() == pytest.approx(0.2, rel=0.15)


def test_a_trial_without_a_hammer_is_named() -> None:
    data = trial()
    alone = dataclasses.replace(data, channels=data.channels[:1], channel_values=data.channel_values[:, :1])
    with pytest.raises(TrialError, match="0 position sensors of the hammer, allowed 1"):
        measure(alone)


def begun(start_s: float, seed: int, hum: float = 0.004, rise_s: float = 0.03) -> tuple[TrialData, np.ndarray]:
    """A trial whose stroke leaves its rest at a time, and the true displacement of its key."""
    key_m = 0.009 * np.clip((TIME_S - start_s) / rise_s, 0, 1) * (1 - np.clip((TIME_S - start_s - 0.4) / 0.05, 0, 1))
    extra = 0.02 + hum * np.sin(2 * np.pi * 50.0 * TIME_S + seed)
    triggered = float(TIME_S[np.argmax(key_m > 0.15 * RULER_M[-1])])
    return dataclasses.replace(trial(key_m, 0.8 * key_m, extra, seed), blow_start_s=triggered), key_m


@pytest.mark.parametrize("start_s", [0.04, 0.062, 0.2])
def test_a_short_rest_is_used_with_the_uncertainty_that_it_leaves(start_s: float) -> None:
    errors, stated = [], []
    for seed in range(20):
        data, key_m = begun(start_s, seed)
        m = measure(data)
        held = (key_m > 0.0045) & (start_s + 0.05 < TIME_S) & (start_s + 0.35 > TIME_S)
        errors.append((key_of(m) - key_m)[held].mean())
        stated.append(m.u_rad[0] * 0.010 / reference_turns()[0])
    assert np.sqrt(np.mean(np.square(errors))) < 2.0 * np.mean(stated) < 2e-3


def test_the_shorter_the_rest_the_larger_its_uncertainty() -> None:
    u = [measure(begun(start, 3)[0]).u_rad[0] for start in (0.04, 0.1, 0.35)]
    assert u[0] > 1.1 * u[1] > 1.1 * u[2] > 0


@pytest.mark.parametrize("rise_s", [0.01, 0.03, 0.3, 1.0])
@pytest.mark.parametrize("start_s", [0.0, 0.005, 0.01, 0.02])
def test_a_stroke_without_a_period_of_rest_is_left_out_and_says_why(start_s: float, rise_s: float) -> None:
    for seed in range(10):
        with pytest.raises(TrialError, match="at rest, one period .*; needed 20, .* is left out") as e:
            measure(begun(start_s, seed, rise_s=rise_s)[0])
        assert "\n" not in str(e.value)


@pytest.mark.parametrize("seed", range(5))
def test_a_slow_press_is_not_taken_for_rest(seed: int) -> None:
    data, key_m = begun(0.062, seed, hum=0.001, rise_s=1.0)
    assert data.blow_start_s > 0.2  # most of what comes before the trigger is motion
    apart = key_of(measure(data)) - key_m
    assert np.abs(apart[:120]).max() < 4e-4
    assert abs(apart[600:800].mean()) < 2.5e-4


def test_only_the_hammer_is_compared_and_the_key_drives() -> None:
    m = measure(trial())
    assert m.driven_by_key and m.channels == ("hammer",) and not m.has_force
    way = -m.change_rad[:, 2] / reference_turns()[1]
    assert way.max() == pytest.approx(1.01 * 0.72, abs=0.01)  # of the ruler of 10 mm; its end lies beyond the string
    assert -m.change_rad[:, 0].max() == pytest.approx(0.0, abs=1e-3)
    assert -m.change_rad[:, 0].min() == pytest.approx(0.9 * reference_turns()[0], rel=0.01)


def test_a_recording_that_ends_within_a_stroke_is_used_as_far_as_it_goes() -> None:
    m = measure(dataclasses.replace(trial(), status="incomplete", reason="the recording ends"))
    assert m.notes == ("recorded incomplete: the recording ends",)


def test_sensors_elsewhere_than_those_of_the_calibration_are_refused() -> None:
    there = {"key sensor": "there", "hammer sensor": "there"}
    assert measure_positions(trial(), SensorCalibration(sensors=there)).sensors is not None
    with pytest.raises(TrialError, match="key sensor is 'there', the identified set holds for 'front'; identify"):
        measure_positions(trial(), SensorCalibration(sensors={"key sensor": "front"}))
