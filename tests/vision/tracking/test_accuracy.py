"""Tracking against known poses: accuracy near the physical limit, stated uncertainty equal to the actual error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.vision.known_films import PIVOT, bar_motion, bar_scene, error_of, film_of, smooth_step
from vision import ArrayFilm, Body, FrameFlag, InputError, TrackingError, preview, track
from vision.fitting.icgn import IcgnFitter
from vision.synthetic import Scene, SyntheticBody, background, box, speckle

MDEG = np.radians(1e-3)


@pytest.mark.parametrize("texture", ["speckle", "wood"])
def test_error_and_stated_uncertainty_over_random_poses(texture: str) -> None:
    """Independent random poses and flicker: RMS, coverage of the 95 % interval, spread of error over uncertainty."""
    n_still, n = 40, 400
    rng = np.random.default_rng(17)
    scene = bar_scene(texture)
    pose = np.tile([0.0, *PIVOT], (n_still + n, 1))[:, None, :]
    pose[n_still:, 0] += rng.uniform([-0.15, -4.0, -4.0], [0.15, 4.0, 4.0], (n, 3))
    gain = 1.0 + 0.1 * np.sin(np.arange(n_still + n))
    known = film_of(scene, pose, gain=gain, seed=23)
    template = known.template(n_still)
    fitter = IcgnFitter(template)
    errors, stated = [], []
    for i in range(n_still, n_still + n):
        true = known.true_fit(i, template)
        fit = fitter.fit(known.film, i, true + rng.normal(0.0, [0.004, 0.3, 0.3]), None)
        assert fit.converged
        # the error of the reference is common to all; it is checked by the films below
        errors.append(fit.pose - true)
        stated.append(np.sqrt(np.diag(fit.covariance)))
    error, u = np.array(errors), np.array(stated)
    error -= error.mean(axis=0)
    bound = known.bound()
    for k in range(3):
        z = error[:, k] / u[:, k]
        ratio = np.sqrt(np.mean(error[:, k] ** 2)) / bound[k]
        coverage = np.mean(np.abs(z) < 1.96)
        assert 0.9 < ratio < 1.15, f"parameter {k}: RMS is {ratio:.3f} of the Cramer-Rao bound"
        assert 0.90 <= coverage <= 0.99, f"parameter {k}: 95 % interval covers {coverage:.3f}"
        assert 0.85 <= np.std(z) <= 1.15, f"parameter {k}: error over stated uncertainty spreads {np.std(z):.3f}"


@pytest.mark.parametrize("texture", ["speckle", "wood"])
def test_film_of_a_turning_bar(texture: str) -> None:
    pose = bar_motion(160, PIVOT, 0.3)
    known = film_of(bar_scene(texture), pose, gain=1 + 0.08 * np.cos(0.37 * np.arange(160)))
    result = track(known.film, known.bodies)
    assert not result.is_lost.any()
    assert 10 <= result.n_still <= 22
    error = error_of(result, pose)
    assert np.sqrt(np.mean(error**2)) < 1.25 * known.bound()[0]  # 1.15 and the error of a zero from 14 frames
    assert np.mean(np.abs(error) < 1.96 * result.u_angle_rad[:, 0]) > 0.90
    # what was promised before tracking is what came out
    assert result.predicted_u_rad[0] == pytest.approx(float(np.mean(result.u_angle_rad)), rel=0.1)
    np.testing.assert_allclose(result.time_s, np.arange(160) / 2000.0)


def test_sign_datum_and_axes() -> None:
    """One bright spot right of the pivot: counter-clockwise lifts it, that is, towards smaller rows."""
    spot = speckle((-36.0, -28.0, 86.0, 28.0), 9)
    marked = replace(
        spot, x=np.append(spot.x, 60.0), y=np.append(spot.y, 0.0), height=np.append(spot.height, 400.0),
        along=np.append(spot.along, 3.0), across=np.append(spot.across, 3.0),
        direction=np.append(spot.direction, 0.0),
    )  # fmt: skip
    body = SyntheticBody("bar", box(-30.0, -22.0, 80.0, 22.0), marked)
    scene = Scene([body], background(150, 210, 1))
    pose = bar_motion(60, (70.0, 80.0), 0.2, still=12)
    pose[:, 0, 0] += 0.1  # the datum is the still frames, not the axes
    frames = np.stack([np.clip(np.rint(scene.light(p[None])), 0, 255).astype(np.uint8) for p in pose])
    before, after = (np.unravel_index(np.argmax(scene.light(p[None])), (150, 210)) for p in (pose[0], pose[-1]))
    assert after[0] < before[0] - 5, "the film itself must turn counter-clockwise"
    result = track(ArrayFilm(frames, 1000.0), [Body("bar", body.outline(*pose[0, 0]))])
    assert result.angle_rad[0, 0] == pytest.approx(0.0, abs=1e-5)
    assert result.angle_rad[-1, 0] == pytest.approx(0.2, abs=2e-5)
    assert result.x_px[-1, 0] > result.x_px[0, 0] + 4.0
    mirrored = track(ArrayFilm(np.ascontiguousarray(frames[:, :, ::-1]), 1000.0), [
        Body("bar", np.column_stack([209.0 - body.outline(*pose[0, 0])[:, 0], body.outline(*pose[0, 0])[:, 1]]))
    ])  # fmt: skip
    assert mirrored.angle_rad[-1, 0] == pytest.approx(-0.2, abs=2e-5)


def two_body_film(n: int = 120) -> object:
    """A bar with a finger pinned on its end, in front of it, that sweeps over it."""
    bar = SyntheticBody("beam", box(-60.0, -16.0, 70.0, 16.0), speckle((-66.0, -22.0, 76.0, 22.0), 1))
    finger = SyntheticBody("finger", box(-9.0, -60.0, 9.0, 8.0), speckle((-15.0, -66.0, 15.0, 14.0), 2))
    scene = Scene([bar, finger], background(150, 210, 3))
    s = smooth_step((np.arange(n) - 14) / 70.0)
    swing = smooth_step((np.arange(n) - 30) / 40.0)
    beam_angle, relative = 0.06 * s, 0.9 * swing
    x, y = 90.0 + 0.0 * s, 104.0 - 4.0 * s
    pin_x = x + 50.0 * np.cos(beam_angle)
    pin_y = y - 50.0 * np.sin(beam_angle)
    pose = np.stack(
        [np.column_stack([beam_angle, x, y]), np.column_stack([beam_angle + relative, pin_x, pin_y])], axis=1
    )
    return film_of(scene, pose, parents={"finger": "beam"})


def test_relative_angle_and_moving_cover() -> None:
    known = two_body_film()
    result = track(known.film, known.bodies)
    assert not result.is_lost.any()
    angle, u, flag = result.relative("finger")
    pose = known.pose
    relative = pose[:, 1, 0] - pose[:, 0, 0]
    error = angle - (relative - relative[: result.n_still].mean())
    assert np.mean(np.abs(error) < 1.96 * u) > 0.88
    assert np.all(flag & ~np.uint16(FrameFlag.IMPRECISE | FrameFlag.WIDENED) == 0)  # the finger is narrow
    np.testing.assert_allclose(u, np.hypot(*result.u_angle_rad.T))
    # at the end the finger lies over the beam: those pixels are left out, the beam stays unbiased
    late = slice(80, None)
    assert np.all(result.inlier[late, 0] < 0.97)
    beam = result.angle_rad[late, 0] - (pose[late, 0, 0] - pose[: result.n_still, 0, 0].mean())
    assert np.abs(np.mean(beam)) < 3 * np.sqrt(np.mean(result.u_angle_rad[late, 0] ** 2) / beam.size + 1e-12)


def test_table_every_and_times() -> None:
    known = two_body_film(70)
    time_s = 0.5 + np.arange(70) / 1000.0
    seen: list[tuple[int, int]] = []
    result = track(
        known.film,
        known.bodies,
        time_s,
        every=3,
        n_still=12,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert result.frame.tolist() == list(range(0, 70, 3)) and seen[-1] == (24, 24)
    table = result.to_frame()
    assert list(table.columns[:11]) == [
        "time_s", "frame", "beam_rad", "beam_u_rad", "beam_u_total_rad", "beam_x_px", "beam_y_px", "beam_u_x_px",
        "beam_u_y_px", "beam_quality", "beam_inlier",
    ]  # fmt: skip
    for name in ("rad", "u_rad", "relative_rad", "relative_u_rad", "relative_u_total_rad", "quality", "flag"):
        assert f"finger_{name}" in table
    np.testing.assert_allclose(table["time_s"], time_s[::3])
    np.testing.assert_allclose(table["finger_relative_rad"], table["finger_rad"] - table["beam_rad"])
    with pytest.raises(InputError, match="no parent"):
        result.relative("beam")
    with pytest.raises(InputError, match="'thumb'"):
        result.relative("thumb")


@pytest.mark.parametrize("texture", ["speckle", "wood"])
def test_positions_have_their_uncertainty(texture: str) -> None:
    n, still, rng = 260, 20, np.random.default_rng(3)
    pose = np.tile([0.0, *PIVOT], (n, 1))[:, None, :]
    pose[still:, 0, 1:] += np.cumsum(rng.uniform(-0.4, 0.4, (n - still, 2)), axis=0)
    known = film_of(bar_scene(texture), pose, seed=9)
    result = track(known.film, known.bodies, n_still=still)
    moved = np.stack([result.x_px[:, 0], result.y_px[:, 0]], axis=1)[still:]
    error = moved - moved[0] - (pose[still:, 0, 1:] - pose[still, 0, 1:])
    z = (error - error.mean(axis=0)) / result.u_position_px[still:, 0]
    assert np.all(np.abs(np.mean(np.abs(z) < 1.96, axis=0) - 0.95) < 0.045)
    if texture == "wood":  # along the grain the texture says less
        assert np.median(result.u_position_px[:, 0, 0]) > 2.0 * np.median(result.u_position_px[:, 0, 1])


def test_position_uncertainty_of_a_turned_body_is_along_the_picture() -> None:
    """Scatter of the places of a wooden bar that rests at 40 degrees, whose grain says less along itself."""
    n, still = 180, 14
    turn = np.radians(40.0) * smooth_step((np.arange(n) - still) / 60)
    pose = np.column_stack([turn, np.full(n, 100.0), np.full(n, 80.0)])[:, None, :]
    result = track((known := film_of(bar_scene("wood"), pose)).film, known.bodies)
    late = slice(still + 60, n)
    found = np.cov(result.x_px[late, 0], result.y_px[late, 0])
    stated = result.covariance[late, 0, 1:, 1:].mean(axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(stated)), np.sqrt(np.diag(found)), rtol=0.3)
    np.testing.assert_allclose(np.median(result.u_position_px[late, 0], axis=0), np.sqrt(np.diag(found)), rtol=0.3)
    assert stated[0, 1] == pytest.approx(found[0, 1], rel=0.5) and stated[0, 1] < 0.0


def test_a_preview_is_what_the_whole_film_gives() -> None:
    known = two_body_film(90)
    clock = {"frame_time_s": np.arange(90) / 2000.0, "u_time_s": 2e-4}
    few, whole = preview(known.film, known.bodies, 4, **clock), track(known.film, known.bodies, **clock)
    assert few.frame.tolist() == [22, 44, 67, 89] and not few.is_lost.any()
    apart = np.abs(few.angle_rad - whole.angle_rad[few.frame])
    assert np.all(apart < 0.5 * whole.u_angle_rad[few.frame])
    moved, truth = few.budget.absolute["synchronisation"], whole.budget.absolute["synchronisation"][few.frame]
    assert np.ptp(truth) > 1e-4  # some frames are of fast motion, some of none
    np.testing.assert_allclose(moved, truth, atol=0.1 * truth.max())
    with pytest.raises(InputError, match="0 frames to preview"):
        preview(known.film, known.bodies, 0)


def test_what_cannot_be_tracked() -> None:
    known = film_of(bar_scene("speckle"), bar_motion(40, PIVOT, 0.2))
    film, bodies = known.film, known.bodies
    with pytest.raises(InputError, match="every"):
        track(film, bodies, every=0)
    with pytest.raises(InputError, match="39 frame times"):
        track(film, bodies, np.arange(39.0))
    with pytest.raises(InputError, match="increase"):
        track(film, bodies, np.zeros(40))
    with pytest.raises(InputError, match="no frame rate"):
        track(ArrayFilm(known.frames), bodies)
    with pytest.raises(TrackingError, match="1 frame"):
        track(ArrayFilm(known.frames[:1], 1000.0), bodies)
    with pytest.raises(TrackingError, match="41 still"):
        track(film, bodies, n_still=41)
