"""Positions of a stroke: drift and hum are taken off, noise is averaged where the ruler is steep, doubts are named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rig.session.channel_info import NO_FORCE, ChannelInfo
from rig.session.ruler_info import RulerInfo
from rig.session.trial_data import TrialData
from validation.errors import TrialError
from validation.positions.measured import measure_stroke, smoothed

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


def test_a_trial_without_rest_is_named() -> None:
    with pytest.raises(TrialError, match="50 ms of rest before the stroke, 125 needed"):
        measure_stroke(dataclasses.replace(trial(), blow_start_s=0.05))


def test_another_calibration_stays_within_its_uncertainty() -> None:
    stroke = measure_stroke(trial())
    random = np.random.default_rng(2)
    away = np.array([stroke.key.draw(random) - stroke.key.value_m for _ in range(40)])
    assert np.abs(away[:, :200]).max() < 5e-5  # zero at rest, by definition
    assert 1e-5 < away.std(axis=0).max() < 1e-4
