"""Compiled loops against plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from tests.vision.known_films import PIVOT, bar_scene, still_bar
from vision import ArrayFilm
from vision.fitting.bspline import coefficients, noise_gain
from vision.fitting.icgn import IcgnFitter
from vision.fitting.kernels import (
    Region,
    Settings,
    State,
    Subset,
    fit_rigid,
)
from vision.fitting.pose_covariance import TUKEY
from vision.fitting.template import Template, build_template


def plain_fit(
    spline: NDArray[np.float64], template: Template, start: NDArray[np.float64], rounds: int
) -> tuple[NDArray[np.float64], float, float]:
    """The same fit written with arrays, SciPy's spline sampling and NumPy's solver: pose, gain, scale."""
    phi, tx, ty = start
    dx, dy = template.offset_px.astype(float)
    design = np.column_stack([*template.columns.astype(float), np.ones(dx.size)])
    weight = np.ones(dx.size)
    for _ in range(rounds):
        c, s = np.cos(phi), np.sin(phi)
        x = template.centre_px[0] + tx + c * dx - s * dy
        y = template.centre_px[1] + ty + s * dx + c * dy
        value = ndimage.map_coordinates(spline, [y, x], order=3, prefilter=False)
        q = np.linalg.solve(design.T @ (weight[:, None] * design), design.T @ (weight * value))
        residual = value - design @ q
        scale = 1.4826 * np.median(np.abs(residual))
        weight = np.clip(1 - (residual / (TUKEY * scale)) ** 2, 0, None) ** 2
        turn, step_x, step_y = q[:3] / q[3]
        phi -= turn
        tx -= np.cos(phi) * step_x - np.sin(phi) * step_y
        ty -= np.sin(phi) * step_x + np.cos(phi) * step_y
    return np.array([phi, tx, ty]), q[3], scale


@pytest.mark.parametrize("texture", ["speckle", "wood"])
def test_fit_against_plain_numpy(texture: str) -> None:
    (still, mask), rng = still_bar(texture), np.random.default_rng(2)
    template = build_template("bar", still + 0.2 * rng.standard_normal(still.shape), mask, 10)
    light = bar_scene(texture).light(np.array([[[0.05, PIVOT[0] + 1.3, PIVOT[1] - 0.7]]]))
    frame = (1.1 * light + 2.0 * rng.standard_normal(light.shape)).astype(np.float32)
    frame[85:110, 100:115] = 20.0  # something covers the body
    start = np.array([-0.045, 0.9, -0.8])
    pose, weight = start.copy(), np.ones(template.n_pixels, dtype=np.float32)
    uncovered = np.zeros(template.n_pixels, dtype=np.uint8)
    subset = Subset(template.offset_px, template.columns, uncovered, *template.centre_px, template.radius_px)
    settings = Settings(noise_gain(), scale_floor=0.5, tolerance_px=1e-4, stop_u=0.0, max_iterations=30)
    work, at = np.zeros((5, template.n_pixels), dtype=np.float32), np.zeros(template.n_pixels, dtype=np.int32)
    state = State(pose, weight, work, at, 2.0)
    fit = fit_rigid(Region(coefficients(frame), 0.0, 0.0), subset, settings, state)
    rounds = fit.iterations
    assert 3 <= rounds < 30
    expected, gain, scale = plain_fit(coefficients(frame).astype(float), template, start, rounds)
    assert pose[0] == pytest.approx(expected[0], abs=2e-6)
    np.testing.assert_allclose(pose[1:], expected[1:], atol=2e-4)
    assert fit.gain == pytest.approx(gain, rel=1e-4)
    assert fit.sums.scale == pytest.approx(scale, rel=0.02)


def test_fit_reports_failure_instead_of_raising() -> None:
    still, mask = still_bar("speckle")
    fitter = IcgnFitter(build_template("bar", still, mask, 10))
    flat = ArrayFilm(np.full((1, *still.shape), 90, dtype=np.uint8))
    for start in ([0.0, 0.0, 0.0], [0.0, 5000.0, 0.0], [np.nan, 0.0, 0.0]):
        fit = fitter.fit(flat, 0, np.array(start), None)
        assert not fit.converged or fit.zncc < 0.1
