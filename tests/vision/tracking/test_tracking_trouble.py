"""Tracking in trouble: lost, covered, out of the picture, never still; and a real film."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from tests.vision.known_films import (
    PIVOT,
    bar_motion,
    bar_scene,
    dark,
    error_of,
    film_of,
    quietly_tracked,
    smooth_step,
    z_of,
)
from vision import Body, VisionWarning, track
from vision.synthetic import Scene, SyntheticBody, background, box, speckle

MDEG = np.radians(1e-3)
REAL_FILM = Path(__file__).resolve().parents[4] / "shared" / "data" / "ball_12bit.mraw"


def test_lost_frames_are_nan_and_found_again() -> None:
    """10 dark frames in which the bar turns by 13 degrees: all flagged, found on the first visible frame."""
    n, out = 64, range(32, 42)
    pose = bar_motion(n, PIVOT, 0.0)
    pose[:, 0, 0] = np.radians(13.0) * smooth_step((np.arange(n) - 30) / 13.0)
    known = film_of(bar_scene("speckle"), pose, cover=dark(out))
    result = track(known.film, known.bodies)
    lost = np.zeros(n, dtype=bool)
    lost[out] = True
    np.testing.assert_array_equal(result.is_lost[:, 0], lost)
    assert np.all(np.isnan(result.angle_rad[lost])) and np.all(np.isnan(result.u_angle_rad[lost]))
    assert np.all(result.flag[lost] != 0) and result.flag[out.stop, 0] == 32
    assert np.nanmax(np.abs(z_of(result, pose))) < 4.5
    assert np.nanmax(result.u_angle_rad) < 8 * MDEG


@pytest.mark.parametrize("texture", ["speckle", "wood"])
def test_unknown_object_covers_the_body(texture: str) -> None:
    """A dark bar sweeps over up to 30 % of the body: weights bring the error near the bound of the visible pixels."""
    n = 110
    pose = bar_motion(n, PIVOT, 0.25)

    def sweep(i: int, light: NDArray[np.float32]) -> None:
        left = int(20 + 1.6 * i)
        light[:, left : left + 30] = 25.0 if i > 16 else light[:, left : left + 30]

    known = film_of(bar_scene(texture), pose, cover=sweep)
    result = track(known.film, known.bodies)
    assert not result.is_lost.any()
    assert np.abs(error_of(result, pose)).max() < np.radians(0.05)
    assert result.inlier.min() < 0.78
    assert np.mean(np.abs(z_of(result, pose)) < 1.96) > 0.88
    assert (
        np.sqrt(np.mean(error_of(result, pose) ** 2)) < 1.6 * known.bound()[0]
    )  # the hidden third costs about 1.3 by itself


def test_leaving_the_picture() -> None:
    """The bar moves half out of the picture: pixels outside do not count, the uncertainty grows, the angle holds."""
    n = 100
    pose = bar_motion(n, PIVOT, 0.1)
    pose[:, 0, 1] += 70.0 * smooth_step((np.arange(n) - 14) / 75.0)
    known = film_of(bar_scene("speckle"), pose)
    result = track(known.film, known.bodies)
    assert not result.is_lost.any()
    assert result.inlier[-1, 0] < 0.75
    assert result.u_angle_rad[-1, 0] > 1.3 * result.u_angle_rad[0, 0]
    assert np.mean(np.abs(z_of(result, pose)) < 1.96) > 0.88


def test_moving_from_the_first_frame_on() -> None:
    """No still frame: the first one is the zero, with its own error in the stated uncertainty."""
    n = 25
    errors, stated = [], []
    for seed in range(12):
        pose = np.tile([0.0, *PIVOT], (n, 1))[:, None, :]
        pose[:, 0] += np.outer(np.arange(n), [0.006, 0.4, 1.1])
        known = film_of(bar_scene("speckle"), pose, seed=seed)
        with pytest.warns(VisionWarning, match="only 1 still"):
            result = track(known.film, known.bodies)
        assert result.n_still == 1 and not result.is_lost.any()
        assert 0.5 * known.noise_grey < float(result.info["noise_grey"]) < 12 * known.noise_grey
        errors.append(result.angle_rad[1:, 0] - pose[1:, 0, 0])
        stated.append(result.u_angle_rad[1:, 0])
    z = np.array(errors) / np.array(stated)
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.3
    assert 0.5 < np.std(z.mean(axis=1)) * np.sqrt(2.0) < 1.6  # half the variance is common to a film


@pytest.mark.skipif(not REAL_FILM.exists(), reason="the real Photron film is not shipped (see ../shared/data)")
def test_real_film_of_a_falling_ball() -> None:
    """A ball in free flight before a strip at rest: steps of one size, the strip still within its uncertainty."""
    around = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    bodies = [
        Body("ball", np.column_stack([175.5 + 64.0 * np.cos(around), 110.0 + 64.0 * np.sin(around)])),
        Body("strip", np.array([[5.0, 335.0], [378.0, 335.0], [378.0, 366.0], [5.0, 366.0]])),
    ]
    with pytest.warns(VisionWarning, match="only 1 still"):
        result = track(REAL_FILM, bodies)
    assert not result.is_lost.any()
    step = np.diff(result.y_px[:, 0])
    assert np.all(np.abs(step - 2.66) < 0.04) and np.all(np.abs(np.diff(result.x_px[:, 0])) < 0.03)
    strip = result.angle_rad[1:, 1] / result.u_angle_rad[1:, 1]
    assert np.sqrt(np.mean(strip**2)) < 1.6
    assert np.ptp(result.y_px[:, 1]) < 0.01
    turn = np.polyfit(result.time_s, result.angle_rad[:, 0], 1)
    assert np.std(result.angle_rad[:, 0] - np.polyval(turn, result.time_s)) < np.radians(0.05)


def test_steps_of_45_degrees() -> None:
    """A bar that jumps by an eighth of a turn every few frames, beyond half a turn: found at once, and counted on."""
    n = 34
    pose = bar_motion(n, (120.0, 100.0), 0.0)
    pose[:, 0, 0] = np.radians(45.0) * np.maximum(0, (np.arange(n) - 10) // 4)
    known = film_of(bar_scene("speckle"), pose)
    result = track(known.film, known.bodies, n_still=12)
    assert not result.is_lost.any()
    jumps = np.flatnonzero(np.diff(pose[:, 0, 0]) > 0.0) + 1
    np.testing.assert_array_equal(np.flatnonzero(result.flag[:, 0] & 32), jumps)
    assert np.abs(z_of(result, pose)).max() < 4.5 and result.angle_rad[-1, 0] > np.pi


def test_a_body_that_leaves_the_picture_and_returns_elsewhere() -> None:
    """It leaves to the right and comes back from above, turned by half a radian: lost while it is out, then found."""
    n = 32
    pose = bar_motion(n, (110.0, 100.0), 0.0)
    away = np.clip(np.arange(n) - 12, 0, None)
    pose[:, 0, 1] += np.where(away < 10, 16.0 * away, 0.0)
    back = np.clip(away - 11, 0, None)
    pose[away >= 10, 0, 0] = 0.5
    pose[away >= 10, 0, 2] += np.minimum(-260.0 + 40.0 * back, -10.0)[away >= 10]
    known = film_of(bar_scene("speckle"), pose)
    result = track(known.film, known.bodies, n_still=12)
    found = ~result.is_lost[:, 0]
    error = result.angle_rad[found, 0] - (pose[found, 0, 0] - pose[:12, 0, 0].mean())
    assert np.abs(error / result.u_angle_rad[found, 0]).max() < 5.0
    assert found[:15].all() and not found[20:25].any() and found[-2:].all()


@pytest.mark.parametrize(("texture", "light"), [("speckle", 0.4), ("wood", 0.55), ("speckle", 1.6)])
def test_light_that_changes_at_once_and_stays_loses_no_frame(texture: str, light: float) -> None:
    """In the middle of the motion; then back again, so that both ways are taken both up and down."""
    n = 70
    pose, gain = bar_motion(n, PIVOT, 0.25), np.ones(n)
    gain[30:55] = light
    known = film_of(bar_scene(texture), pose, gain=gain)
    result = track(known.film, known.bodies)
    assert not result.is_lost.any()
    z = z_of(result, pose)
    assert np.mean(np.abs(z) < 1.96) > 0.9 and np.abs(z).max() < 4.5
    if light < 1.0:  # where it is darker there is less contrast over the same noise
        ratio = np.median(result.u_angle_rad[32:54, 0]) / np.median(result.u_angle_rad[16:28, 0])
        assert 0.85 < ratio * light < 1.15


def test_light_that_changes_on_one_body_alone() -> None:
    """A lamp's edge falls between two bodies."""
    n, change = 60, 32
    ends = [box(-30.0, -20.0, 30.0, 20.0)] * 2
    bodies = [
        SyntheticBody(name, ends[k], speckle((-36.0, -26.0, 36.0, 26.0), 3 + k))
        for k, name in enumerate(("lit", "dark"))
    ]
    scene = Scene(bodies, background(150, 210, 9))
    s = smooth_step((np.arange(n) - 14) / 40.0)
    pose = np.stack(
        [np.column_stack([t * s, x + 4.0 * s, 70.0 + 5.0 * s]) for t, x in ((0.2, 55.0), (-0.15, 150.0))], 1
    )

    def half_dark(i: int, light: NDArray[np.float32]) -> None:
        if i >= change:
            light[:, 103:] *= np.float32(0.45)

    known = film_of(scene, pose, cover=half_dark)
    result = track(known.film, known.bodies)
    assert not result.is_lost.any()
    z = (result.angle_rad - (pose[..., 0] - pose[: result.n_still, :, 0].mean(axis=0))) / result.u_angle_rad
    assert np.mean(np.abs(z) < 1.96) > 0.9 and np.abs(z).max() < 4.5


def test_another_surface_is_not_taken_for_other_light() -> None:
    """A board of another texture and half the contrast slides before the bar and stays: those frames are lost."""
    n = 36
    pose = bar_motion(n, PIVOT, 0.25)
    board = 0.5 * one_picture(np.random.default_rng(8))

    def hidden(i: int, light: NDArray[np.float32]) -> None:
        if i >= 30:
            light[:] = board

    known = film_of(bar_scene("speckle"), pose, cover=hidden)
    result = quietly_tracked(known.film, known.bodies)
    np.testing.assert_array_equal(result.is_lost[:, 0], np.arange(n) >= 30)


def one_picture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Smooth noise as large as the pictures of the tests."""
    return (110.0 + 250.0 * ndimage.gaussian_filter(rng.standard_normal((150, 210)), 2.0)).astype(np.float32)
