"""Offset and mains hum against known truth: what is fitted, what is refused, how far it can be trusted."""

from __future__ import annotations

import numpy as np
import pytest

from rig.session.force_correction import correlation_inflation, fit_hum

RATE_HZ = 5000.0


def hum_n(time_s, frequency_hz=60.03, amplitude_n=(0.5, 0.0, 0.12), phase_rad=(0.7, 0.0, -1.1)):
    return sum(
        a * np.cos(2 * np.pi * k * frequency_hz * time_s + p)
        for k, (a, p) in enumerate(zip(amplitude_n, phase_rad, strict=True), start=1)
    )


def blow_n(time_s):
    """4 ms rise to 40 N and an exponential decay; zero before 0.4 s."""
    t = time_s - 0.4
    return np.where(t > 0, 40 * np.clip(t / 0.004, 0, 1) * np.exp(-np.clip(t - 0.004, 0, None) / 0.02), 0.0)


@pytest.mark.parametrize("baseline_s", [0.05, 0.21, 0.39])
def test_hum_is_removed_from_the_blow_and_the_peak_is_untouched(baseline_s):
    time = np.arange(int(1.0 * RATE_HZ)) / RATE_HZ
    rng = np.random.default_rng(3)
    frequency = 60.03 if baseline_s >= 0.2 else 60.0
    force = blow_n(time) + 0.3 + hum_n(time, frequency) + rng.normal(0, 0.01, time.size)
    begin = int((0.395 - baseline_s) * RATE_HZ)
    quiet = slice(begin, int(0.395 * RATE_HZ))
    fit = fit_hum(time[quiet], force[quiet], 60.0)
    assert fit.accepted
    assert fit.frequency_searched == (baseline_s >= 0.2)
    during = (time > 0.39) & (time < 0.5)
    error = (force - fit.baseline_n(time) - blow_n(time))[during]
    # what is left is the noise of the channel, and the peak is where it was
    assert np.sqrt(np.mean(error**2)) < 0.0125
    peak = np.argmax(blow_n(time))
    assert abs((force - fit.baseline_n(time))[peak] - 40.0) < 0.04


def test_amplitude_phase_frequency_and_offset_are_those_put_in():
    time = np.arange(2000) / RATE_HZ
    fit = fit_hum(time, -0.2 + hum_n(time), 60.0)
    assert fit.offset_n == pytest.approx(-0.2, abs=1e-6)
    assert fit.frequency_hz == pytest.approx(60.03, abs=1e-4)
    assert fit.amplitude_n == pytest.approx((0.5, 0.0, 0.12), abs=1e-5)
    assert fit.phase_rad[0] == pytest.approx(0.7, abs=1e-4)
    assert fit.phase_rad[2] == pytest.approx(-1.1, abs=1e-3)


def test_the_mains_frequency_is_found_when_not_told():
    time = np.arange(2000) / RATE_HZ
    rng = np.random.default_rng(1)
    for nominal in (50.0, 60.0):
        force = hum_n(time, nominal - 0.04, (0.2, 0.05, 0.03)) + rng.normal(0, 0.02, time.size)
        assert fit_hum(time, force).frequency_hz == pytest.approx(nominal - 0.04, abs=0.02)


def test_a_baseline_without_hum_is_left_alone_at_the_stated_rate():
    rng = np.random.default_rng(5)
    time = np.arange(1750) / RATE_HZ
    accepted = sum(fit_hum(time, rng.normal(0.1, 0.02, time.size), 60.0).accepted for _ in range(40))
    assert accepted <= 1  # one in a thousand by the F test, a few more because the frequency is searched


def test_a_refused_fit_subtracts_the_offset_only():
    time = np.arange(1750) / RATE_HZ
    force = np.random.default_rng(8).normal(0.1, 0.02, time.size)
    fit = fit_hum(time, force, 60.0)
    assert not fit.accepted
    assert "does not lower" in fit.reason
    np.testing.assert_array_equal(fit.baseline_n(time), np.full(time.size, force.mean()))


def test_a_baseline_shorter_than_two_periods_gives_an_offset_and_a_reason():
    time = np.arange(150) / RATE_HZ
    fit = fit_hum(time, 0.4 + hum_n(time), 60.0)
    assert not fit.accepted
    assert "30 ms is shorter than two periods of 60 Hz" in fit.reason


def test_a_drifting_signal_that_is_not_hum_is_refused_by_the_held_back_third():
    time = np.arange(1000) / RATE_HZ
    rng = np.random.default_rng(2)
    step = np.where(time > 0.14, 0.3, 0.0) + rng.normal(0, 0.005, time.size)
    fit = fit_hum(time, step, 60.0)
    assert not fit.accepted


@pytest.mark.parametrize("with_hum", [True, False])
def test_the_uncertainty_of_the_baseline_covers_the_truth(with_hum):
    rng = np.random.default_rng(11)
    time = np.arange(int(1.2 * RATE_HZ)) / RATE_HZ
    n = int(0.35 * RATE_HZ)
    at = np.array([0, n - 1, time.size - 1])
    z = []
    for _ in range(80):
        phase = tuple(rng.uniform(-np.pi, np.pi, 3))
        hum = hum_n(time, 60 + rng.uniform(-0.1, 0.1), (0.3, 0.0, 0.1), phase) if with_hum else np.zeros(time.size)
        true = 0.15 + hum
        fit = fit_hum(time[:n], true[:n] + rng.normal(0, 0.02, n), 60.0)
        if fit.accepted == with_hum:
            z.append((fit.baseline_n(time[at]) - true[at]) / fit.u_baseline_n(time[at]))
    z = np.array(z)
    assert len(z) >= 78
    # 80 draws: the standard deviation of z is known to 8 %
    assert np.all(np.abs(z.std(axis=0) - 1) < 0.2)
    assert np.all(np.abs(z.mean(axis=0)) < 0.25)


def test_correlated_noise_widens_the_uncertainty_of_the_offset():
    rng = np.random.default_rng(4)
    white = rng.normal(size=200_000)
    smooth = np.convolve(white, np.ones(2) / 2, mode="valid")  # lag-one correlation 1/2
    assert correlation_inflation(white) == pytest.approx(1.0, abs=0.02)
    assert correlation_inflation(smooth) == pytest.approx(3.0, abs=0.05)
