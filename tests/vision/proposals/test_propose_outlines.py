"""Proposed outlines lie on the bodies that move, each on its own, and can be tracked as they are."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

import vision.proposals.point_tracks
from rig.simulated import ActionGeometry, CameraSettings, FilmTruth, film_trial
from tests.command_line import run
from tests.vision.known_films import smooth_step
from vision import ArrayFilm, Body, TrackingError, load_bodies, open_film, propose_bodies, track, write_mraw
from vision.bodies.outlines import signed_distance
from vision.proposals.point_tracks import frames_by_activity
from vision.synthetic import Scene, Sensor, SyntheticBody, background, box, speckle

BENCH_FRAMES = 76


@pytest.fixture(scope="module")
def bench_film(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FilmTruth]:
    """A film of the virtual bench, bare wood, and its true angles."""
    geometry, camera = ActionGeometry(), CameraSettings(texture="wood")
    x = np.clip((np.arange(BENCH_FRAMES) / camera.frame_rate_hz - 0.01) / 0.024, 0.0, 1.0)
    angles = geometry.rest_angle_rad + np.outer(x * x * (3.0 - 2.0 * x), [0.08, -0.3, 0.2])
    path = tmp_path_factory.mktemp("bench") / "film.mraw"
    times = np.arange(BENCH_FRAMES) / camera.frame_rate_hz

    def motion(t: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(t, times, column) for column in angles.T], axis=-1)

    truth = film_trial(path, times, motion, geometry, camera, seed=4)
    return path, truth


@pytest.fixture
def few_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half as many frames as usual, where the motion is slow enough for them."""
    monkeypatch.setattr(vision.proposals.point_tracks, "MOST_FRAMES", 30)


@cache  # drawn once for the tests that look at the same motion
def film_of_two(
    beam_rad: float = 0.12, finger_rad: float = 0.5, moving: int = 50
) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Frames, true outlines and true angles of a beam and of a finger that turns on its end; a third thing rests."""
    beam = SyntheticBody("beam", box(-60.0, -16.0, 80.0, 16.0), speckle((-66.0, -22.0, 86.0, 22.0), 1))
    finger = SyntheticBody("finger", box(-14.0, -70.0, 14.0, 10.0), speckle((-20.0, -76.0, 20.0, 16.0), 2))
    rest = SyntheticBody("rest", box(-20.0, -15.0, 20.0, 15.0), speckle((-26.0, -21.0, 26.0, 21.0), 4))
    scene = Scene([rest, beam, finger], background(170, 230, 3))
    s = smooth_step((np.arange(moving + 30) - 14) / moving)
    angle = np.column_stack([beam_rad * s, finger_rad * s])
    pin = np.column_stack([90 + 60 * np.cos(angle[:, 0]), 125 - 60 * np.sin(angle[:, 0])])
    sensor, frames = Sensor(2.0, 8, 7), []
    for (a, b), (u, v) in zip(angle, pin, strict=True):
        frames.append(sensor.expose(scene.light(np.array([[[0.0, 45.0, 40.0], [a, 90.0, 125.0], [b, u, v]]]))))
    outlines = [beam.outline(0.0, 90.0, 125.0), finger.outline(0.0, 150.0, 125.0)]
    return np.stack(frames), outlines, angle


@pytest.mark.usefixtures("few_frames")
def test_each_moving_body_gets_its_outline(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., None]
) -> None:
    frames, outlines, angle = film_of_two()
    film = tmp_path / "film.mraw"
    write_mraw(film, frames, 2000.0)
    out = tmp_path / "bodies.toml"
    assert run("track", film, "--propose-bodies", out) == 0
    said = capsys.readouterr().out
    assert "body1, body2" in said and "bodies.png" in said
    bodies = load_bodies(out)
    assert len(bodies) == 2 and (tmp_path / "bodies.png").stat().st_size > 5000
    true = [signed_distance(outline, 170, 230) > 0 for outline in outlines]
    true[0] &= ~true[1]  # the finger hides the end of the beam
    for mask in true:
        covered, right = best_shares(bodies, mask)
        assert covered > 0.6 and right > 0.85
    result = track(film, bodies)
    end = sorted(np.nanmax(result.angle_rad, axis=0))
    np.testing.assert_allclose(end, angle[-1], atol=2e-3)
    refused(str(out), "track", film, "--propose-bodies", out)  # corrected outlines are never overwritten


def best_shares(bodies: list[Body], mask: np.ndarray) -> tuple[float, float]:
    """Share of a true region that the best outline covers, and share of that outline that lies in it."""
    shares = []
    for body in bodies:
        own = signed_distance(body.polygon_px, *mask.shape) > 0
        shares.append((float((own & mask).sum() / mask.sum()), float((own & mask).sum() / own.sum())))
    return max(shares)


def overlapping(bodies: list[Body], height: int, width: int) -> int:
    """Pixels that lie inside more than one outline."""
    inside = [signed_distance(body.polygon_px, height, width) > 0 for body in bodies]
    return int(np.count_nonzero(np.sum(inside, axis=0) > 1))


@pytest.mark.usefixtures("few_frames")
def test_the_bodies_of_the_bench_can_be_tracked_as_proposed(bench_film: tuple[Path, FilmTruth]) -> None:
    path, truth = bench_film
    with open_film(path) as film:
        bodies = propose_bodies(film)
        assert overlapping(bodies, film.height, film.width) == 0
    assert [body.parent for body in bodies] == [None, "body1", "body1"]  # whippen, jack, repetition lever
    assert max(len(body.polygon_px) for body in bodies) <= 20
    assert bodies[1].layer >= bodies[0].layer <= bodies[2].layer
    result = track(path, bodies, truth.frame_time_s, confirm="none")
    assert not result.is_lost.any()
    still = result.n_still
    error = result.angle_rad - (truth.mean_angle_rad - truth.mean_angle_rad[:still].mean(axis=0))
    for child in (1, 2):
        error[:, child] -= result.angle_rad[:, 0]
    u = result.u_angle_rad.copy()
    u[:, 1:] = np.hypot(u[:, 1:], u[:, :1])
    assert np.abs(error / u).max() < 5.0


@pytest.mark.usefixtures("few_frames")
def test_bodies_before_a_black_background() -> None:
    frames, outlines, _ = film_of_two()
    light = np.maximum(frames.astype(float) - 66.0, 0.0) * (1.0 + 0.1 * np.cos(0.9 * np.arange(80)))[:, None, None]
    black = np.rint(light).clip(0, 255).astype(np.uint8)
    assert np.median(black) == 0.0
    bodies = propose_bodies(ArrayFilm(black, 2000.0))
    assert len(bodies) == 2
    covered, right = best_shares(bodies, signed_distance(outlines[1], 170, 230) > 0)
    assert covered > 0.6 and right > 0.85


def test_a_real_ball_that_never_rests() -> None:
    film = Path(__file__).resolve().parents[4] / "shared" / "data" / "ball_12bit.mraw"
    if not film.is_file():
        pytest.skip("the film of the ball is not here")
    with open_film(film) as source:
        (ball,) = propose_bodies(source)
        true = (
            np.hypot(*(np.mgrid[0 : source.height, 0 : source.width] - np.array([110.0, 175.0])[:, None, None])) < 64.0
        )
        own = signed_distance(ball.polygon_px, source.height, source.width) > 0
    assert (own & true).sum() / true.sum() > 0.95 and (own & true).sum() / own.sum() > 0.9
    assert ball.parent is None and len(ball.polygon_px) <= 20


def test_bodies_that_turn_so_fast_that_points_are_lost() -> None:
    """Their beginning tells them apart."""
    frames, outlines, _ = film_of_two(beam_rad=0.3, finger_rad=2.6, moving=24)
    bodies = propose_bodies(ArrayFilm(frames, 2000.0))
    finger = signed_distance(outlines[1], 170, 230) > 0
    covered, right = best_shares(bodies, finger)
    assert covered > 0.6 and right > 0.85
    assert overlapping(bodies, 170, 230) == 0


@pytest.mark.usefixtures("few_frames")
def test_a_motion_of_half_a_pixel() -> None:
    frames, outlines, _ = film_of_two(beam_rad=0.0, finger_rad=0.008)
    (finger,) = propose_bodies(ArrayFilm(frames, 2000.0))
    covered, right = best_shares([finger], signed_distance(outlines[1], 170, 230) > 0)
    assert covered > 0.2 and right > 0.85  # what lies near the pin does not move by enough to be told from the beam


def test_a_camera_that_shakes_is_no_body() -> None:
    still = film_of_two()[0][0]
    shake = 0.3 * np.random.default_rng(5).standard_normal((20, 2))
    noise = np.random.default_rng(6)
    frames = []
    for dx, dy in shake:
        moved = cv2.warpAffine(
            still, np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]]), still.shape[::-1], flags=cv2.INTER_CUBIC
        )
        frames.append(np.clip(np.rint(moved + 2.0 * noise.standard_normal(still.shape)), 0, 255).astype(np.uint8))
    with pytest.raises(TrackingError, match="by hand"):
        propose_bodies(ArrayFilm(np.stack(frames), 2000.0))


def test_where_nothing_moves_there_are_frames_to_draw_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = film_of_two()[0][:12]
    with pytest.raises(TrackingError, match=r"of \d+ textured points move by less than .*by hand"):
        propose_bodies(ArrayFilm(frames, 2000.0))
    film = tmp_path / "film.mraw"
    write_mraw(film, frames, 2000.0)
    assert run("track", film, "--propose-bodies", tmp_path / "bodies.toml") == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "bodies.png" in said and "bodies_frame.png" in said
    assert not (tmp_path / "bodies.toml").exists()
    plain = cv2.imread(str(tmp_path / "bodies_frame.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(plain, frames[0])
    drawn = cv2.imread(str(tmp_path / "bodies.png"))
    assert drawn.shape[1] > 2 * 800 and drawn.shape[0] > 1000  # four frames, two by two


def test_a_flat_film_says_so() -> None:
    with pytest.raises(TrackingError, match="no part of the picture has texture"):
        propose_bodies(ArrayFilm(np.full((4, 90, 120), 90, np.uint8), 2000.0))
    with pytest.raises(TrackingError, match="needs at least 4"):
        propose_bodies(ArrayFilm(np.full((3, 90, 120), 90, np.uint8), 2000.0))


def test_frames_are_spread_over_what_changes() -> None:
    """A motion of thirty frames in a film of three thousand."""
    frames = film_of_two()[0]
    long = np.concatenate([np.repeat(frames[:1], 1200, axis=0), frames[14:64], np.repeat(frames[-1:], 1750, axis=0)])
    chosen = frames_by_activity(ArrayFilm(long, 2000.0))
    assert np.count_nonzero((chosen > 1195) & (chosen < 1255)) > 20
    assert chosen[0] == 0 and chosen[-1] == len(long) - 1
