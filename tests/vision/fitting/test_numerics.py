"""The Cramer-Rao bound against its closed form."""

from __future__ import annotations

import numpy as np
import pytest

from vision import BodyError, cramer_rao_bound
from vision.fitting.pose_covariance import predicted_u_angle
from vision.fitting.template import build_template

RNG = np.random.default_rng(11)


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
