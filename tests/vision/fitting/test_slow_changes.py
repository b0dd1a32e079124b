"""Light and scale that change across a body are measured and taken out; where they do not, nothing is."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from tests.vision.known_films import PIVOT, bar_motion, bar_scene, blurred, film_of, smooth_step, still_bar, z_of
from vision import ArrayFilm, track
from vision.fitting.icgn import IcgnFitter
from vision.fitting.slow_changes import UNCHANGED, SlowChanges
from vision.fitting.template import build_template


@pytest.mark.parametrize("light", [(0.12, 0.0), (-0.05, 0.1), (0.0, 0.0)])
def test_measured_light(light: tuple[float, float]) -> None:
    (still, mask), rng = still_bar("speckle"), np.random.default_rng(1)
    template = build_template("bar", still, mask, 10, noise_grey=2.0)
    y, x = np.mgrid[0 : still.shape[0], 0 : still.shape[1]]
    centre, radius = template.centre_px, template.radius_px
    factor = 1.0 + light[0] * (x - centre[0]) / radius + light[1] * (y - centre[1]) / radius
    frame = np.clip(np.rint(still * factor + 2.0 * rng.standard_normal(still.shape)), 0, 255).astype(np.uint8)
    fitter = IcgnFitter(template)
    fit = fitter.fit(ArrayFilm(frame[None]), 0, np.array([0.002, 0.2, -0.1]), None)
    found = fitter.state()["changes"]
    assert fit.converged and abs(fit.gain - 1.0) < 0.02
    if light == (0.0, 0.0):
        assert tuple(found) == UNCHANGED
    else:
        np.testing.assert_allclose(found, [*light, *UNCHANGED[2:]], atol=0.01)
        assert fit.noise_grey < 2.3
    u = np.sqrt(np.diag(fit.covariance))
    assert np.all(np.abs(fit.pose) < 4.0 * u + [2e-5, 2e-3, 2e-3])
    assert np.all(SlowChanges(template).variance_factor((0.1,) * 6 + (0.0, 0.0)) < 1.25)


def test_light_that_grows_on_one_side() -> None:
    n = 80
    pose = bar_motion(n, PIVOT, 0.25)
    grown = 0.4 * smooth_step((np.arange(n) - 14) / 50.0)

    def lamp(i: int, light: NDArray[np.float32]) -> None:
        light *= 1.0 + grown[i] * (np.arange(light.shape[1], dtype=np.float32) - 100.0) / 200.0

    known = film_of(bar_scene("wood"), pose, cover=lamp)
    unlit = film_of(bar_scene("wood"), pose)
    result, plain = track(known.film, known.bodies), track(unlit.film, unlit.bodies)
    assert not result.is_lost.any()
    assert np.abs(z_of(result, pose)).max() < 5.0
    assert np.median(result.u_angle_rad[20:]) < 2.0 * np.median(plain.u_angle_rad[20:])


@pytest.mark.parametrize("changes", [(0.0, 0.0, 0.004), (0.05, 0.0, 0.0, -0.1, 0.06, 0.08)])
def test_scale_and_bent_light(changes: tuple[float, ...]) -> None:
    """A body that has grown about its middle, and light whose factor is bent, as bands of flicker make it."""
    changes = (*changes, *UNCHANGED)[: len(UNCHANGED)]
    (still, mask), rng = still_bar("speckle"), np.random.default_rng(2)
    template = build_template("bar", still, mask, 10, noise_grey=1.0)
    y, x = np.mgrid[0 : still.shape[0], 0 : still.shape[1]].astype(float)
    (cx, cy), radius = template.centre_px, template.radius_px
    grown = 1.0 + changes[2]
    drawn = ndimage.map_coordinates(still, [cy + (y - cy) / grown, cx + (x - cx) / grown], order=3, mode="nearest")
    u, v = (x - cx) / radius, (y - cy) / radius
    drawn *= 1.0 + changes[0] * u + changes[1] * v + changes[3] * u * u + changes[4] * u * v + changes[5] * v * v
    frame = np.clip(np.rint(drawn + rng.standard_normal(still.shape)), 0, 255).astype(np.uint8)
    fitter = IcgnFitter(template)
    fit = fitter.fit(ArrayFilm(frame[None]), 0, np.array([0.001, 0.1, -0.1]), None)
    found = fitter.state()["changes"]
    np.testing.assert_allclose(found, changes, atol=0.0008 if changes[2] else 0.02)
    u_pose = np.sqrt(np.diag(fit.covariance))
    assert fit.converged and np.all(np.abs(fit.pose) < 5.0 * u_pose + [3e-5, 3e-3, 3e-3])
    assert fit.noise_grey < 1.3


def test_a_change_is_followed_where_it_leaves_the_turn_known() -> None:
    """Texture at one end: growth about the middle is hardly told from a shift along the body, well from a turn."""
    (still, mask), rng = still_bar("speckle"), np.random.default_rng(3)
    y, x = np.mgrid[0 : still.shape[0], 0 : still.shape[1]].astype(float)
    first, last = np.flatnonzero(mask.any(axis=0))[[0, -1]]
    still = 100.0 + (still - 100.0) * (0.02 + 0.98 / (1.0 + np.exp((first + 0.7 * (last - first) - x) / 3.0)))
    template = build_template("bar", still, mask, 10, noise_grey=1.0)
    (cx, cy), grown = template.centre_px, 1.01
    u_turn, u_along, _ = SlowChanges(template).variance_factor((0.0, 0.0, grown, *UNCHANGED[3:]))
    assert u_turn < 1.1 and u_along > 5.0
    drawn = ndimage.map_coordinates(still, [cy + (y - cy) / grown, cx + (x - cx) / grown], order=3, mode="nearest")
    frame = np.clip(np.rint(drawn + rng.standard_normal(still.shape)), 0, 255).astype(np.uint8)
    fitter = IcgnFitter(template)
    fit = fitter.fit(ArrayFilm(frame[None]), 0, np.zeros(3), None)
    np.testing.assert_allclose(fitter.state()["changes"], (0.0, 0.0, grown - 1.0, *UNCHANGED[3:]), atol=0.001)
    assert np.all(np.abs(fit.pose) < 4.0 * np.sqrt(np.diag(fit.covariance)) + [3e-5, 3e-3, 3e-3])


@pytest.mark.parametrize(("texture", "seed"), [("speckle", 0), ("wood", 3)])
def test_defocus_that_drifts_does_not_drag_the_pose(texture: str, seed: int) -> None:
    """Up to 1.5 px in the last frame: contours that do not balance would drag the angle by up to 160 mdeg."""
    n = 80
    pose, width = bar_motion(n, PIVOT, 0.25), 1.5 * np.arange(n) / (n - 1)
    known = film_of(bar_scene(texture, 5 + seed), pose, seed=seed, cover=blurred(width))
    result = track(known.film, known.bodies)
    z = z_of(result, pose)
    assert not result.is_lost.any() and np.mean(np.abs(z) < 1.96) > 0.9 and np.abs(z).max() < 4.5
    assert result.u_angle_rad[-5:, 0].max() < 3.0 * result.u_angle_rad[:10, 0].mean()
