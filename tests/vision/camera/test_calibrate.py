"""Calibration from targets filmed through a known lens, and what it does to tracked angles."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.command_line import run
from tests.vision.camera.target_picture import target_picture
from tests.vision.known_films import quietly_tracked, smooth_step
from vision import (
    ArrayFilm,
    AssumedCamera,
    Body,
    CalibratedCamera,
    Calibration,
    InputError,
    Projection,
    Target,
    calibrate,
    load_calibration,
    save_calibration,
    track,
)
from vision.camera.model import tilt_homography
from vision.synthetic import Scene, Sensor, SyntheticBody, background, box, speckle

WIDTH, HEIGHT = 300, 220
MDEG = math.radians(1e-3)


def true_parameters(lens: Projection) -> np.ndarray:
    """The five parameters of a tilted lens: its matrix over the mean scale at the centre."""
    matrix = lens.homography / lens.homography[2, 2]
    scale = np.sqrt(np.linalg.det(matrix[:2, :2]))
    half = lens.half_diagonal_px
    return np.array(
        [
            0.5 * (matrix[0, 0] - matrix[1, 1]) / scale,
            matrix[0, 1] / scale,
            matrix[2, 0] * half / scale,
            matrix[2, 1] * half / scale,
            lens.radial,
        ]
    )


def target_film(lens: Projection, kind: str, seed: int, views: int = 3) -> ArrayFilm:
    rng = np.random.default_rng(seed)
    sensor = Sensor(2.0, 8, seed)
    frames = []
    for _ in range(views):
        place = lens.centre_px + rng.uniform(-18, 18, 2)
        picture = target_picture(lens, kind, (9, 7), 22.0, turn_rad=rng.uniform(-0.2, 0.2), place_px=tuple(place))
        frames += [sensor.expose(picture), sensor.expose(picture)]
    return ArrayFilm(np.stack(frames), 1000.0)


def calibrated(seed: int, kind: str) -> tuple[Projection, Calibration]:
    rng = np.random.default_rng(100 + seed)
    lean = tilt_homography(math.radians(rng.uniform(0, 4)), rng.uniform(0, 2 * math.pi), 12.0 * WIDTH)
    lens = Projection(WIDTH, HEIGHT, lean, rng.uniform(-0.008, 0.008))
    return lens, calibrate(target_film(lens, kind, seed), Target(kind, 9, 7, 5e-3))


def test_tilted_projection_is_a_pinhole_camera() -> None:
    """Against OpenCV's projectPoints: a camera 2000 px away that leans by 7 degrees."""
    tilt, distance = math.radians(7.0), 2000.0
    lens = Projection(WIDTH, HEIGHT, tilt_homography(tilt, 0.0, distance))
    points = np.array([[0.0, 0.0], [120.0, 30.0], [-90.0, 80.0]])
    space = np.column_stack([points, np.zeros(3)])
    turned = np.array([0.0, -tilt, 0.0])
    camera = np.array([[distance, 0, lens.centre_px[0]], [0, distance, lens.centre_px[1]], [0, 0, 1.0]])
    expected, _ = cv2.projectPoints(space, turned, np.array([0.0, 0.0, distance]), camera, None)
    np.testing.assert_allclose(lens.seen(points + lens.centre_px), expected[:, 0], atol=1e-6)
    bent = Projection(WIDTH, HEIGHT, tilt_homography(tilt, 1.1, distance), -0.02)
    np.testing.assert_allclose(bent.rectified(bent.seen(points + 100.0)), points + 100.0, atol=1e-9)
    corner = Projection(WIDTH, HEIGHT, radial=0.01).seen([[WIDTH - 1.0, HEIGHT - 1.0]])[0]
    np.testing.assert_allclose(corner - lens.centre_px, 1.01 * lens.centre_px)


@pytest.mark.parametrize(("kind", "seeds"), [("checkerboard", 2), ("dots", 1)])
def test_parameters_lie_within_their_uncertainty(kind: str, seeds: int) -> None:
    z, scale_z = [], []
    for seed in range(seeds):
        lens, found = calibrated(seed, kind)
        assert found.n_frames == 6 and found.n_points % 63 == 0
        assert found.residual_px < (0.1 if kind == "checkerboard" else 0.03)
        camera = found.camera
        z.append((camera.parameters - true_parameters(lens)) / np.sqrt(np.diag(camera.covariance)))
        true_scale = 22.0 / 5e-3 * math.sqrt(np.linalg.det(lens.homography[:2, :2]))
        scale_z.append((camera.scale_px_per_m - true_scale) / camera.u_scale_px_per_m)
        assert found.u_effect_rad < 8 * MDEG
        assert found.effect_rad > found.u_effect_rad
    assert np.abs(z).max() < 4.0 and 0.5 < np.sqrt(np.mean(np.square(z))) < 1.7
    assert np.abs(scale_z).max() < 4.0


def test_views_of_a_long_film_are_spread_over_it() -> None:
    """The target moves along the picture in more views than are used; those at its end are among them."""
    lens = Projection(150, 60)
    places = np.linspace(30.0, 119.0, 56)
    frames = []
    for i, x in enumerate(places):
        picture = target_picture(lens, "checkerboard", (3, 3), 12.0, turn_rad=0.02 * (i % 3), place_px=(x, 29.5))
        frames.append(Sensor(2.0, 8, i).expose(picture))
    found = calibrate(ArrayFilm(np.stack(frames), 1000.0), Target("checkerboard", 3, 3, 5e-3))
    assert found.n_frames > 40 >= found.n_views > 35
    width, height = places[-1] - places[0] + 24.0, 24.0
    assert found.coverage * 150 * 60 == pytest.approx(width * height, rel=0.1)


def bar_through(lens: Projection, turn_rad: float = 0.35) -> tuple[ArrayFilm, list[Body], np.ndarray]:
    """A bar that turns about an off-centre point of the plane, filmed through a lens; its true angle."""
    body = SyntheticBody("bar", box(-40.0, -25.0, 110.0, 25.0), speckle((-46.0, -31.0, 116.0, 31.0), 5))
    scene = Scene([body], background(HEIGHT, WIDTH, 6), lens)
    angle = turn_rad * smooth_step((np.arange(40) - 14) / 20)
    sensor = Sensor(2.0, 8, 3)
    frames = [sensor.expose(scene.light(np.array([[[a, 110.0, 140.0]]]))) for a in angle]
    outline = lens.seen(body.outline(0.0, 110.0, 140.0))
    return ArrayFilm(np.stack(frames), 1000.0), [Body("bar", outline)], angle


def test_calibration_takes_the_cameras_error_out() -> None:
    lens = Projection(WIDTH, HEIGHT, tilt_homography(math.radians(4.0), 2.4, 12.0 * WIDTH), 0.003)
    camera = calibrate(target_film(lens, "dots", 3), Target("dots", 9, 7, 5e-3)).camera
    film, bodies, angle = bar_through(lens)
    plain = track(film, bodies)
    true = angle - angle[: plain.n_still].mean()
    late = slice(34, None)
    bias = np.mean(plain.angle_rad[late, 0] - true[late])
    assert abs(bias) > 10 * MDEG, "the lens must matter for this test"
    corrected = track(film, bodies, camera=camera)
    left = np.mean(corrected.angle_rad[late, 0] - true[late])
    u = float(np.mean(corrected.u_total_rad[late, 0]))
    assert abs(left) < 2.0 * u and u < 3 * MDEG
    assert "calibrated" in corrected.budget.camera
    with pytest.raises(InputError, match="pictures of 300 x 220"):
        track(ArrayFilm(film.frames(0, film.n_frames)[:, :-2], 1000.0), bodies, camera=camera)


def test_budget_covers_lenses_of_the_assumed_size() -> None:
    """Tilt in any direction and distortion, drawn from the assumed standard uncertainties: error over stated total."""
    rng = np.random.default_rng(8)
    assumed = AssumedCamera(math.radians(3.0), 0.004, 12.0)
    z, narrow = [], []
    for _ in range(5):
        lean = tilt_homography(abs(rng.normal(0, math.radians(3.0))), rng.uniform(0, 2 * math.pi), 12.0 * WIDTH)
        lens = Projection(WIDTH, HEIGHT, lean, rng.normal(0, 0.004))
        film, bodies, angle = bar_through(lens)
        result = quietly_tracked(film, bodies, n_still=14, camera=assumed)  # large ones show in the bodies' shapes
        error = result.angle_rad[:, 0] - (angle - angle[: result.n_still].mean())
        z.append(error[34:] / result.u_total_rad[34:, 0])
        narrow.append(error[34:] / result.u_angle_rad[34:, 0])
    # chi-squared of five lenses, 0.1 % to each side
    assert 0.2 < np.sqrt(np.mean(np.square(z))) < 2.03
    assert np.sqrt(np.mean(np.square(narrow))) > 3.0, "noise alone is far from the whole"


def test_file_round_trip_and_damage(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    square = rng.normal(size=(5, 5)) * 1e-4
    camera = CalibratedCamera(300, 220, rng.normal(size=5) * 1e-2, square @ square.T, 5012.25, 0.125)
    path = tmp_path / "camera.toml"
    save_calibration(path, camera, {"film": 'a "film"', "points": 63})
    found = load_calibration(path)
    assert (found.width, found.height) == (300, 220)
    np.testing.assert_array_equal(found.parameters, camera.parameters)
    np.testing.assert_array_equal(found.covariance, camera.covariance)
    assert (found.scale_px_per_m, found.u_scale_px_per_m) == (5012.25, 0.125)
    text = path.read_text()
    for change, words in (
        (("scale_px_per_m = 5012.25", "scale_px_per_m = -1"), "scale"),
        (("width_px = 300", "width_px = 0"), "width_px"),
        (("[camera]", "[lens]"), r"\[camera\]"),
        (("height_px = 220", ""), "height_px"),
        (("parameters = [", "parameters = [1.0, "), "5 finite"),
        (("width_px", "width_px ="), "TOML"),
    ):
        path.write_text(text.replace(*change, 1))
        with pytest.raises(InputError, match=words) as caught:
            load_calibration(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., None]) -> None:
    from vision import write_mraw

    lens = Projection(WIDTH, HEIGHT, tilt_homography(math.radians(3.0), 0.5, 12.0 * WIDTH), 0.005)
    film, out = tmp_path / "target.mraw", tmp_path / "camera.toml"
    source = target_film(lens, "checkerboard", 2, views=2)
    write_mraw(film, [source.read(i) for i in range(source.n_frames)], 1000.0)
    base = ["calibrate", "camera", str(film), "--pitch-mm", "5", "--out", str(out)]
    assert run(*base, "--grid", "9x7", "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["scale_px_per_m"] == pytest.approx(4400.0, rel=2e-3) and facts["views"] == 2
    assert facts["effect_on_angles_rad"] > facts["u_after_correction_rad"] > 0
    assert load_calibration(out).width == WIDTH
    assert run(*base, "--grid", "9x7", "--figure", str(figure := tmp_path / "camera.svg")) == 0
    assert "mdeg without correction" in capsys.readouterr().out
    corners = np.array([[0, 0], [WIDTH - 1, 0], [0, HEIGHT - 1], [WIDTH - 1, HEIGHT - 1]], dtype=float)
    found = load_calibration(out).nominal(WIDTH, HEIGHT)
    assert found is not None
    largest = float(np.hypot(*(found.to_picture(corners) - corners).T).max())
    assert float(re.search(r"ten times: ([\d.]+) px", figure.read_text())[1]) == pytest.approx(largest, abs=5e-3)
    for grid, words in (("9", "COLUMNSxROWS"), ("10x7", "no checkerboard of 10 x 7"), ("2x7", "3 or more")):
        refused(words, *base, "--grid", grid)
