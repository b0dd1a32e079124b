"""Splines, noise gain, Cramer-Rao bound and robust factor against independent computations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from vision import BodyError, cramer_rao_bound
from vision.fitting import bspline
from vision.fitting.pose_covariance import TUKEY, TUKEY_FACTOR, predicted_u_angle
from vision.fitting.template import build_template

RNG = np.random.default_rng(11)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_prefilter_against_scipy(kind: type) -> None:
    picture = RNG.integers(0, 255, (48, 71)).astype(kind)
    reference = ndimage.spline_filter(picture.astype(float), order=3, mode="mirror")
    found = bspline.coefficients(picture)
    assert found.shape == (48, 71)
    # what is cut off: 2 sqrt(3) z^8 / (1 - z) per axis, of the largest coefficient
    z = 2.0 - np.sqrt(3.0)
    cut = 2 * 2 * np.sqrt(3.0) * z**8 / (1 - z)
    np.testing.assert_allclose(found, reference, atol=cut * np.abs(reference).max())


def test_gradient_of_a_known_wave() -> None:
    y, x = np.mgrid[0:60, 0:83].astype(float)
    kx, ky = 2 * np.pi / 17.0, 2 * np.pi / 23.0
    gx, gy = bspline.gradient((100 + 30 * np.sin(kx * x + ky * y)).astype(np.float32))
    inner = (slice(8, -8), slice(8, -8))
    np.testing.assert_allclose(gx[inner], (30 * kx * np.cos(kx * x + ky * y))[inner], atol=0.02)
    np.testing.assert_allclose(gy[inner], (30 * ky * np.cos(kx * x + ky * y))[inner], atol=0.02)


def test_noise_gain_by_monte_carlo() -> None:
    """Variance of scipy's own spline samples of white noise, at several fractions."""
    noise = RNG.standard_normal(400_000)
    spline = ndimage.spline_filter1d(noise, order=3, mode="mirror")
    for i in (0, 9, 16, 32, 53, 64):
        points = np.arange(10, noise.size - 12) + i / 64
        sample = ndimage.map_coordinates(spline, points[None], order=3, prefilter=False)
        assert bspline.noise_gain()[i] == pytest.approx(np.var(sample), rel=0.01)
    # mean over all fractions in two dimensions, as measured before this code was written
    assert np.mean(bspline.noise_gain()[:-1]) ** 2 == pytest.approx(0.7643, abs=0.002)


def test_cramer_rao_bound_of_a_grating() -> None:
    """Crossed gratings: the mean square gradient is (k A)^2 / 2 along each axis, so the bounds have a closed form."""
    height, width, amplitude, wave, noise = 128, 192, 25.0, 16.0, 1.7
    y, x = np.mgrid[0:height, 0:width]
    k = 2 * np.pi / wave
    picture = (120 + amplitude * (np.sin(k * x) + np.sin(k * y))).astype(np.float32)
    mask = np.zeros((height, width), dtype=bool)
    mask[16:112, 16:176] = True
    n = 96 * 160
    u_angle, u_x, u_y = cramer_rao_bound(picture, mask, noise)
    slope = amplitude * k / np.sqrt(2.0)
    rho2 = (96**2 - 1) / 12 + (160**2 - 1) / 12
    assert u_x == pytest.approx(noise / (slope * np.sqrt(n)), rel=0.01)
    assert u_y == pytest.approx(noise / (slope * np.sqrt(n)), rel=0.01)
    assert u_angle == pytest.approx(noise / (slope * np.sqrt(n * rho2)), rel=0.02)
    # five parameters, all pixels, 25 averaged frames: the prediction before tracking follows from the bound
    template = build_template("plate", picture, mask, 25)
    assert predicted_u_angle(template, noise) == pytest.approx(u_angle * np.sqrt(1.04 / 0.95), rel=1e-3)
    with pytest.raises(BodyError, match="no texture"):
        cramer_rao_bound(np.full((64, 96), 99.0, dtype=np.float32), mask[:64, :96], noise)


def test_tukey_factor_by_monte_carlo() -> None:
    """Location estimates of many normal samples: their spread is what the factor says, 95 % efficiency."""
    sample = RNG.standard_normal((4000, 400))
    centre = np.zeros((4000, 1))
    for _ in range(12):
        weight = np.clip(1 - ((sample - centre) / TUKEY) ** 2, 0, None) ** 2
        centre = (weight * sample).sum(1, keepdims=True) / weight.sum(1, keepdims=True)
    variance = float(np.var(centre))
    stated = TUKEY_FACTOR * float(np.mean((weight * (sample - centre) ** 2).sum(1) / weight.sum(1) ** 2))
    assert stated == pytest.approx(variance, rel=0.08)
    assert 1.0 / (400 * stated) == pytest.approx(0.95, abs=0.005)


def test_best_pixels_beat_random_pixels() -> None:
    picture = ndimage.gaussian_filter(RNG.standard_normal((90, 140)), 1.6).astype(np.float32) * 100 + 120
    mask = np.zeros(picture.shape, dtype=bool)
    mask[10:80, 10:130] = True
    best = build_template("plate", picture, mask, 10, max_pixels=2000)
    assert best.n_pixels == 2000
    thinned = np.zeros(mask.size, dtype=bool)
    thinned[RNG.choice(np.flatnonzero(mask), 2000, replace=False)] = True
    random = build_template("plate", picture, thinned.reshape(mask.shape), 10)
    assert predicted_u_angle(best, 2.0) < 0.75 * predicted_u_angle(random, 2.0)
