"""Compiled loops against plain NumPy, and the rule that keeps numba's cache honest."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

import vision
from vision.bodies.occlusion import mark_covered
from vision.fitting.bspline import coefficients, noise_gain
from vision.fitting.icgn import IcgnFitter
from vision.fitting.kernels import Region, Settings, Subset, fit_rigid, robust_scale, solve5
from vision.fitting.pose_covariance import TUKEY
from vision.fitting.template import Template, build_template
from vision.synthetic import Scene, box, speckle


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
def test_fit_against_plain_numpy(bar_scene: Callable[[str], Scene], pivot: tuple[float, float], texture: str) -> None:
    scene = bar_scene(texture)
    rng = np.random.default_rng(2)
    still = scene.light(np.array([[[0.0, *pivot]]]))
    mask = np.zeros(still.shape, dtype=bool)
    mask[80:112, 68:166] = True
    template = build_template("bar", still + 0.2 * rng.standard_normal(still.shape), mask, 10)
    light = scene.light(np.array([[[0.05, pivot[0] + 1.3, pivot[1] - 0.7]]]))
    frame = (1.1 * light + 2.0 * rng.standard_normal(light.shape)).astype(np.float32)
    frame[85:110, 100:115] = 20.0  # something in the way
    start = np.array([-0.045, 0.9, -0.8])
    pose, weight = start.copy(), np.ones(template.n_pixels, dtype=np.float32)
    uncovered = np.zeros(template.n_pixels, dtype=np.uint8)
    subset = Subset(template.offset_px, template.columns, uncovered, *template.centre_px)
    settings = Settings(noise_gain(), scale_floor=0.5, tolerance_px=1e-4, max_iterations=30)
    fit = fit_rigid(Region(coefficients(frame), 0.0, 0.0), subset, settings, pose, weight, 2.0)
    rounds = fit.iterations
    assert 3 <= rounds < 30
    expected, gain, scale = plain_fit(coefficients(frame).astype(float), template, start, rounds)
    assert pose[0] == pytest.approx(expected[0], abs=2e-6)
    np.testing.assert_allclose(pose[1:], expected[1:], atol=2e-4)
    assert fit.gain == pytest.approx(gain, rel=1e-4)
    assert fit.sums.scale == pytest.approx(scale, rel=0.02)


def test_fit_reports_failure_instead_of_raising(bar_scene: Callable[[str], Scene], pivot: tuple[float, float]) -> None:
    from vision.film.source import ArrayFilm

    still = bar_scene("speckle").light(np.array([[[0.0, *pivot]]]))
    mask = np.zeros(still.shape, dtype=bool)
    mask[80:112, 68:166] = True
    fitter = IcgnFitter(build_template("bar", still, mask, 10))
    flat = ArrayFilm(np.full((1, *still.shape), 90, dtype=np.uint8))
    for start in ([0.0, 0.0, 0.0], [0.0, 5000.0, 0.0], [np.nan, 0.0, 0.0]):
        fit = fitter.fit(flat, 0, np.array(start), None)
        assert not fit.converged or fit.zncc < 0.1


def test_solve5_against_numpy() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        a = rng.standard_normal((9, 5)) * [1e4, 1.0, 3.0, 50.0, 1.0]
        matrix, right, found = a.T @ a, rng.standard_normal(5), np.empty(5)
        assert solve5(matrix, right, found)
        np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-7)
    assert not solve5(np.ones((5, 5)), np.ones(5), np.empty(5))
    assert not solve5(np.full((5, 5), np.nan), np.ones(5), np.empty(5))


def test_robust_scale_is_the_median() -> None:
    rng = np.random.default_rng(5)
    residual = (3.0 * rng.standard_normal(5000)).astype(np.float32)
    visible = (rng.uniform(size=5000) < 0.7).astype(np.float32)
    expected = 1.4826 * np.median(np.abs(residual[visible > 0]))
    assert robust_scale(residual, visible, 24.0) == pytest.approx(expected, rel=0.01)
    assert robust_scale(residual, np.zeros(5000, dtype=np.float32), 24.0) == 0.0


def test_mark_covered_against_plain_geometry() -> None:
    """Template pixels carried into the frame, then back into the axes of the one in front."""
    rng = np.random.default_rng(6)
    offset = rng.uniform(-40, 40, (2, 500)).astype(np.float32)
    centre, pose = np.array([70.0, 50.0]), np.array([0.2, 3.0, -2.0])
    other_centre, other_pose = np.array([90.0, 60.0]), np.array([-0.3, -4.0, 5.0])
    outline = np.zeros((120, 180), dtype=np.uint8)
    outline[45:70, 70:120] = 1
    covered = np.zeros(500, dtype=np.uint8)
    count = mark_covered(offset, centre, pose, outline, other_centre, other_pose, covered)

    def turn(phi: float) -> NDArray[np.float64]:
        return np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])

    there = (centre + pose[1:])[:, None] + turn(0.2) @ offset
    back = other_centre[:, None] + turn(0.3) @ (there - (other_centre + other_pose[1:])[:, None])
    column, row = np.floor(back + 0.5).astype(int)
    inside = (row >= 0) & (row < 120) & (column >= 0) & (column < 180)
    expected = inside & (outline[np.clip(row, 0, 119), np.clip(column, 0, 179)] > 0)
    np.testing.assert_array_equal(covered.astype(bool), expected)
    assert count == expected.sum() > 50


def test_drawn_body_is_the_formula() -> None:
    """A rendered picture against the texture's formula at the back-rotated pixel, away from the edge."""
    texture = speckle((-30.0, -20.0, 60.0, 20.0), 3)
    from vision.synthetic import SyntheticBody

    scene = Scene([SyntheticBody("plate", box(-25, -15, 55, 15), texture)], np.zeros((80, 130), dtype=np.float32))
    angle, x0, y0 = 0.31, 48.3, 41.7
    picture = scene.light(np.array([[[angle, x0, y0]]]))
    y, x = np.mgrid[0:80, 0:130].astype(float)
    # counter-clockwise by `angle` with y down: body axes from picture axes
    u = np.cos(angle) * (x - x0) - np.sin(angle) * (y - y0)
    v = np.sin(angle) * (x - x0) + np.cos(angle) * (y - y0)
    inner = (u > -23) & (u < 53) & (v > -13) & (v < 13)
    np.testing.assert_allclose(picture[inner], texture.at(u[inner], v[inner]), atol=0.03)
    outer = (u < -27) | (u > 57) | (v < -17) | (v > 17)
    assert np.all(picture[outer] == 0.0)


def test_no_compiled_function_is_called_from_another_file() -> None:
    """numba's disk cache notices only changes of the cached function's own file."""
    root = Path(vision.__file__).parent
    compiled: dict[Path, set[str]] = {}
    imported: dict[Path, set[str]] = {}
    for path in root.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        compiled[path] = {
            node.name
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(d) for d in node.decorator_list)
        }
        imported[path] = {
            alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names
        }
    with_kernels = {path for path, found in compiled.items() if found}
    assert {path.name for path in with_kernels} == {"kernels.py", "occlusion.py"}
    everything = set().union(*compiled.values())
    for path in with_kernels:
        assert not imported[path] & everything, f"{path} imports a compiled function"
