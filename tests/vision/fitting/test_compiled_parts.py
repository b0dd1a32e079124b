"""Compiled parts of a fit against the plain functions they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from vision.film.source import saturated_areas
from vision.fitting.assessment import inverse_and_covariance
from vision.fitting.bspline import coefficients
from vision.fitting.frame_spline import count_saturated_inside, prefilter
from vision.fitting.template import invert_normal


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(17, 17), (64, 90), (33, 201)])
def test_prefilter_against_opencv(kind: type, shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(1).integers(3, 250, shape).astype(kind)
    out = np.empty(shape, dtype=np.float32)
    assert prefilter(picture, out) == picture.max()
    # OpenCV's filter is cut along both axes, by 1.3e-4 of the largest coefficient each
    np.testing.assert_allclose(out, coefficients(picture), atol=2.6e-4 * np.abs(out).max())


def test_prefilter_gives_the_picture_back() -> None:
    picture = np.random.default_rng(2).integers(0, 255, (40, 50)).astype(np.uint8)
    out = np.empty(picture.shape, dtype=np.float32)
    prefilter(picture, out)
    smooth = np.array([1.0, 4.0, 1.0]) / 6.0
    around = np.pad(out, 1, mode="reflect").astype(float)
    back = sum(smooth[i] * smooth[j] * around[i : i + 40, j : j + 50] for i in range(3) for j in range(3))
    np.testing.assert_allclose(back, picture, atol=0.03)


@pytest.mark.parametrize("level", [240, 200, 40])
def test_saturated_pixels_are_counted(level: int) -> None:
    picture = np.random.default_rng(3).integers(0, 256, (60, 80)).astype(np.uint8)
    picture[picture >= level] = 255
    marked = saturated_areas(picture, 255)
    assert count_saturated_inside(picture, 255) == (0 if marked is None else np.count_nonzero(marked))
    assert count_saturated_inside(np.full((20, 30), 255, dtype=np.uint8), 255) == 600


def test_inverse_and_covariance() -> None:
    rng = np.random.default_rng(4)
    inverse, covariance = np.empty((5, 5)), np.empty((3, 3))
    for _ in range(20):
        design = rng.standard_normal((40, 5)) * [1e4, 1.0, 3.0, 50.0, 1.0]
        normal, noise = design.T @ design, np.diag([1e8, 1.0, 9.0, 0.0, 0.0])
        assert inverse_and_covariance(normal, noise, 0.7, 2.5, inverse, covariance)
        expected = invert_normal(normal - 0.7 * noise)
        assert expected is not None
        np.testing.assert_allclose(inverse, expected, rtol=1e-8)
        np.testing.assert_allclose(covariance, 2.5 * (expected @ normal @ expected)[:3, :3], rtol=1e-8)
    for bad in (np.ones((5, 5)), np.full((5, 5), np.nan), np.diag([1.0, 1.0, 0.0, 1.0, 1.0])):
        assert not inverse_and_covariance(bad, np.zeros((5, 5)), 0.0, 1.0, inverse, covariance)
