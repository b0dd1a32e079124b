"""Fit of the key's motion: linear algebra, noise found in the angles, stated against actual errors."""

from __future__ import annotations

import numpy as np
import pytest

from model.motion_driven.spline_fit import find_resolution, fit_key_motion, fit_noise, repeated_share
from tests.model.key_blows import COUNT, PROFILES, counted, key_truth


def test_width_of_a_count_is_found() -> None:
    random = np.random.default_rng(3)
    angle = np.cumsum(random.normal(0.0, 2e-5, 500))
    assert find_resolution(np.floor(angle / COUNT) * COUNT - 0.0123) == pytest.approx(COUNT, rel=1e-9)
    assert find_resolution(np.round(angle, 6)) == pytest.approx(1e-6, rel=1e-6)
    assert find_resolution(angle) == 0.0 and find_resolution(np.zeros(30)) == 0.0


def test_share_of_rounding_that_repeats() -> None:
    """Against readings of angles anywhere within a count: variance of the mean reading's error."""
    random = np.random.default_rng(4)
    place = random.uniform(size=(400, 1))
    for jitter in (0.0, 0.1, 0.2, 0.4):
        error = np.floor(place + random.normal(0.0, 1.0, (400, 2000)) * jitter) + 0.5 - place
        assert repeated_share(1.0, jitter) == pytest.approx(12.0 * np.var(error.mean(axis=1)), abs=0.06)


def test_noise_of_angle_and_clock_are_told_apart() -> None:
    speed = np.linspace(-1.0, 2.0, 200)
    a, b = fit_noise(4.0 + 9.0 * speed**2, speed, np.ones(200))
    assert (a, b) == pytest.approx((2.0, 3.0))
    assert fit_noise(4.0 - 0.1 * speed**2, speed, np.ones(200))[1] == 0.0
    assert fit_noise(9.0 * speed**2 - 0.1, speed, np.ones(200))[0] == 0.0
    assert fit_noise(np.full(9, -1.0), np.zeros(9), np.ones(9)) == (0.0, 0.0)
    time, truth = key_truth("forte")
    fit = fit_key_motion(time, counted(truth, 1, jitter=0.6, clock_s=2e-5))
    assert fit.resolution_rad == pytest.approx(COUNT, rel=1e-6)
    assert fit.jitter_rad == pytest.approx(0.6 * COUNT, rel=0.1)
    assert fit.clock_s == pytest.approx(2e-5, rel=0.2)


def test_the_motion_is_the_spline_and_draws_scatter_as_stated() -> None:
    time, truth = key_truth("forte")
    fit = fit_key_motion(time[450:750], counted(truth, 2)[450:750])
    inside = np.linspace(time[455], time[745], 97)
    value, u = fit.evaluate(inside)
    np.testing.assert_allclose(fit.motion().at(inside), value, rtol=1e-7, atol=1e-9)
    random = np.random.default_rng(5)
    draws = np.array([fit.draw(random).at(inside) for _ in range(400)])
    np.testing.assert_allclose(draws.std(axis=0) / u, 1.0, atol=0.2)
    np.testing.assert_allclose(draws.mean(axis=0), value, atol=0.25 * u.max(axis=0).max())
    shifted = np.array([fit.draw(random, 1e-3).at(inside)[:, 0].mean() for _ in range(200)])
    assert np.std(shifted) == pytest.approx(1e-3, rel=0.2)


def test_stated_uncertainty_is_the_actual_error() -> None:
    """Share of samples inside 1.96 u: of angle, speed and acceleration, everywhere and around the bumps."""
    everywhere, bumps, ratio = [], [], []
    for name in PROFILES:
        time, truth = key_truth(name)
        bump = np.abs(np.gradient(truth[:, 2], time)) > 1e5
        bump = np.convolve(bump, np.ones(21), "same") > 0.0
        value, u = fit_key_motion(time, counted(truth, 10, 0.2, 1e-5)).evaluate(time)
        inside = np.abs(value - truth) < 1.96 * u
        everywhere.append(inside.mean(axis=0))
        bumps.append(inside[bump].mean(axis=0))
        ratio.append(np.mean((value - truth)[bump] ** 2, axis=0) / np.mean(u[bump] ** 2, axis=0))
    assert np.all(np.mean(everywhere, axis=0) > 0.93) and np.all(np.mean(everywhere, axis=0) < 0.985)
    assert np.all(np.mean(bumps, axis=0) > 0.92), np.mean(bumps, axis=0)
    assert np.all(np.sqrt(np.mean(ratio, axis=0)) > 0.5) and np.all(np.sqrt(np.mean(ratio, axis=0)) < 1.4)


def test_noiseless_angles_leave_what_happens_between_the_samples() -> None:
    time, truth = key_truth("forte")
    for every in (1, 2):
        fit = fit_key_motion(time[::every], truth[::every, 0])
        value, u = fit.evaluate(time[: 1 + (len(time) - 1) // every * every])
        error = (value - truth[: len(value)])[:, 2]
        assert 0.8 < np.mean(np.abs(error) < 1.96 * u[:, 2]) <= 1.0
        assert 0.3 < np.sqrt(np.mean(error**2) / np.mean(u[:, 2] ** 2)) < 1.5


def test_lost_angles_widen_the_uncertainty_and_stay_inside_it() -> None:
    time, truth = key_truth("piano")
    angle = counted(truth, 6)
    whole = fit_key_motion(time, angle)
    angle[900:925] = np.nan  # 5 ms of the descent
    fit = fit_key_motion(time, angle)
    assert len(fit.time_s) == len(time) - 25
    at = time[900:925]
    value, u = fit.evaluate(at)
    assert np.all(np.abs(value - truth[900:925]) < 4.0 * u)
    assert u[12, 0] > 2.0 * whole.evaluate(at)[1][12, 0]
