"""Simultaneous band: closed forms, coverage by simulation (on the bench: `python -m benchmarks band_on_bench`)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from validation.statistics.repeatability_band import critical_value, exceedance, repeatability_band, roughness_length


def smooth_curves(rng: np.random.Generator, shape: tuple[int, int], fwhm: float) -> np.ndarray:
    """Stationary Gaussian curves (n_samples, n) with unit variance and given smoothness, without edge effects."""
    sigma = fwhm / np.sqrt(4 * np.log(2))  # of the curve's derivative; white noise through a kernel of sigma/√2
    kernel_sigma = sigma / np.sqrt(2)
    reach = int(np.ceil(4 * kernel_sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / kernel_sigma) ** 2)
    kernel /= np.sqrt(np.sum(kernel**2))
    noise = rng.standard_normal((shape[0] + 2 * reach, shape[1]))
    size = 1 << int(np.ceil(np.log2(noise.shape[0] + kernel.size)))
    spectrum = np.fft.rfft(noise, size, axis=0) * np.fft.rfft(kernel, size)[:, None]
    return np.fft.irfft(spectrum, size, axis=0)[2 * reach : 2 * reach + shape[0]]


def even(rng: np.random.Generator, n: int) -> np.ndarray:
    return smooth_curves(rng, (200, n), 20.0)


def rig_like(rng: np.random.Generator, n: int) -> np.ndarray:
    whole = smooth_curves(rng, (400, n), 20.0)
    at = 399 * (0.4 * np.linspace(0, 1, 200) + 0.6 * np.linspace(0, 1, 200) ** 2.5)
    warped = np.column_stack([np.interp(at, np.arange(400), column) for column in whole.T])
    return warped * np.linspace(0.1, 1.0, 200)[:, None]


def counts(rng: np.random.Generator, n: int) -> np.ndarray:
    """Encoder readings: at rest for a fifth, then scatter growing to 30 counts; each trial has its own phase."""
    scatter = 30 * np.clip((np.linspace(0, 1, 1000) - 0.2) / 0.4, 0, 1) ** 2
    true = smooth_curves(rng, (1000, n), 40.0) * scatter[:, None]
    return np.floor(true + rng.uniform(0, 1, n))


CURVES = {"even": even, "rig-like": rig_like, "counts": counts}
U_SAMPLE = {"counts": np.sqrt(2 / 12)}  # of a sample and of its zero, in counts


def coverage(kind: str, n: int, sessions: int) -> float:
    """Share of sessions whose band contains the true mean, zero."""
    rng = np.random.default_rng([18571, n, list(CURVES).index(kind)])
    bands = (repeatability_band(CURVES[kind](rng, n), u_sample=U_SAMPLE.get(kind, 0.0)) for _ in range(sessions))
    return float(np.mean([band.covers(np.zeros(band.mean.size)) for band in bands]))


def test_a_single_value_gets_student_s_t():
    for freedom in (2, 4, 19):
        assert critical_value(freedom, 0.0, 1) == pytest.approx(stats.t.ppf(0.975, freedom), rel=1e-9)


def test_critical_value_of_a_smooth_curve_is_that_of_random_field_theory():
    # n = 5, 200 nodes, full width at half maximum of 20.19: 9.255 by the formula, 9.214 by spm1d
    length = 199 / 20.19 * np.sqrt(4 * np.log(2))
    u = critical_value(4, length, 200)
    assert u == pytest.approx(9.255, abs=0.01)
    assert exceedance(u, 4, length) == pytest.approx(0.05, rel=1e-6)


def test_a_rough_curve_is_bounded_by_independent_samples():
    assert critical_value(4, 1e6, 100) == pytest.approx(stats.t.isf(0.025 / 100, 4), rel=1e-9)


def test_length_of_a_known_path():
    # residuals of three trials that turn once round a circle in the plane of zero sum: 2π, however large they are
    turn = np.linspace(0, 2 * np.pi, 4001)
    a, b = np.array([1.0, -1.0, 0.0]) / np.sqrt(2), np.array([1.0, 1.0, -2.0]) / np.sqrt(6)
    residual = np.cos(turn)[:, None] * a + np.sin(turn)[:, None] * b
    assert roughness_length(residual) == pytest.approx(2 * np.pi, rel=1e-6)
    assert roughness_length(residual * np.linspace(1, 50, 4001)[:, None]) == pytest.approx(2 * np.pi, rel=1e-6)
    noisy = residual + np.random.default_rng(2).normal(0, 0.02, residual.shape)
    assert roughness_length(noisy) > 50  # what noise makes of it
    assert roughness_length(noisy, 0.02) == pytest.approx(2 * np.pi, rel=0.2)


@pytest.mark.parametrize("n", [5, 20])
@pytest.mark.parametrize("kind", ["even", "rig-like", "counts"])
def test_the_band_holds_the_true_curve_at_its_stated_rate(kind, n):
    share = coverage(kind, n, 400)
    # 400 sessions: one standard error is 0.011; 0.925 to 0.97 widened by three of them
    assert 0.89 < share < 1.0


def test_the_band_of_known_scatter_is_wider_than_pointwise_and_follows_the_scatter():
    curves = CURVES["rig-like"](np.random.default_rng(4), 10) + 5.0
    band = repeatability_band(curves)
    s = curves.std(axis=1, ddof=1)
    assert band.factor > stats.t.ppf(0.975, 9)
    np.testing.assert_allclose(band.half_width, band.factor * s / np.sqrt(10))  # no scatter in time is told here
    np.testing.assert_allclose(band.mean, curves.mean(axis=1))


COUNT = 2e-4  # of jumps of 0.1


def bounces(late):
    """Curves (n_samples, n): a stroke alike in all, then a jump up and down, late by so many samples."""
    t = np.arange(500.0)[:, None]
    stroke = np.tanh((t - 100) / 30) + 1 + 0 * late
    return stroke + 0.05 * (np.tanh((t - 300 - late) / 2) - np.tanh((t - 400 - late) / 2))


@pytest.mark.parametrize("n", [5, 10])
def test_jumps_that_scatter_in_time_are_covered_where_values_alone_are_not(n):
    rng = np.random.default_rng(8)
    truth = bounces(6 * stats.norm.ppf((np.arange(1000) + 0.5) / 1000)).mean(axis=1)  # at times of s 6 samples
    held, by_value, sessions = 0, 0, 200
    for _ in range(sessions):
        curves = bounces(rng.normal(0, 6, n))
        band = repeatability_band(curves, u_sample=COUNT)
        held += band.covers(truth)
        s = np.maximum(curves.std(axis=1, ddof=1), COUNT)
        by_value += np.all(np.abs(band.mean - truth) <= band.factor * s / np.sqrt(n))
    assert by_value < 0.1 * sessions
    assert held > 0.7 * sessions  # as of writing 0.77 and 0.9
    assert band.half_width[:200].max() < 5 * COUNT  # before the jumps nothing is late


def test_the_band_is_nowhere_narrower_than_a_count():
    count = 1.0
    still = np.zeros((200, 6))
    still[100:] = np.round(np.random.default_rng(3).normal(0, 30, 6))
    band = repeatability_band(still, u_sample=count / np.sqrt(6))
    assert band.half_width.min() >= count - 1e-12


def test_few_trials_lost_samples_and_equal_curves():
    curves = CURVES["even"](np.random.default_rng(5), 6)
    assert np.isnan(repeatability_band(curves[:, :2]).half_width).all()
    assert np.isnan(repeatability_band(curves[:, :4]).half_width).all()  # four are too few as well
    curves[17, 3] = np.nan
    band = repeatability_band(curves)
    assert np.isnan(band.half_width[17])
    assert np.isfinite(np.delete(band.half_width, 17)).all()
    still = repeatability_band(np.ones((50, 5)), u_sample=0.1)
    np.testing.assert_allclose(still.half_width, stats.t.ppf(0.975, 4) * 0.1 / np.sqrt(5))
    assert repeatability_band(np.ones((50, 5))).half_width.max() == 0.0
