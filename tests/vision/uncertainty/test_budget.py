"""Terms of the error budget against closed forms and against films in which only that error is present."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.vision.film.avi_file import write_avi
from tests.vision.known_films import PIVOT, bar_scene, film_of
from vision import ArrayFilm, AssumedCamera, Body, InputError, VisionWarning, open_film, track
from vision.synthetic import Sensor
from vision.tracking.prepare import prepare
from vision.uncertainty.budget import TERMS
from vision.uncertainty.budget_terms import ExpectedMotion, expected_budget

SQUARE = AssumedCamera(0.0, 0.0)


def poses(n: int, angle: np.ndarray) -> np.ndarray:
    return np.column_stack([angle, np.full(n, PIVOT[0]), np.full(n, PIVOT[1])])[:, None, :]


def test_terms_that_follow_the_motion() -> None:
    n, rate, exposure, acceleration = 38, 2000.0, 4e-4, 4000.0
    i = np.arange(n)
    angle = 0.5 * acceleration * (np.maximum(i - 20, 0) / rate) ** 2
    known = film_of(bar_scene("speckle"), poses(n, angle))
    film = ArrayFilm(known.frames, rate, exposure)
    result = track(film, known.bodies, n_still=16, camera=SQUARE, u_time_s=2e-5)
    terms = result.budget.absolute
    assert set(terms) == set(TERMS)
    speed = acceleration * (i[26:36] - 20) / rate
    np.testing.assert_allclose(terms["synchronisation"][26:36, 0], 2e-5 * speed, rtol=0.05)
    expected = acceleration / rate * exposure * np.sqrt(exposure * rate / 320)
    assert np.median(terms["shutter"][26:36, 0]) == pytest.approx(expected, rel=0.25)
    assert terms["shutter"][:15].max() < 0.35 * expected  # noise alone
    # of rows three frames apart: a step may lie anywhere between them
    few = track(film, known.bodies, n_still=16, camera=SQUARE, every=3).budget.absolute["shutter"]
    assert np.median(few[9:12, 0]) == pytest.approx(expected * np.sqrt(3.0), rel=0.25)
    np.testing.assert_allclose(np.hypot(terms["noise"], terms["reference"]), result.u_angle_rad)
    assert max(terms["tilt"].max(), terms["distortion"].max(), terms["codec"].max()) < 1e-12
    total = result.budget.total()
    np.testing.assert_allclose(total**2, sum(terms[name] ** 2 for name in TERMS))
    without = result.budget.total(without=("synchronisation",))
    np.testing.assert_allclose(result.u_total_rad, without)
    with pytest.raises(InputError, match="u_time_s"):
        track(film, known.bodies, u_time_s=-1.0)


def test_relative_terms_share_the_camera() -> None:
    """Two outlines on one rigid body: noise adds, what the camera bends cancels but for the distance of the two."""
    n = 40
    x = np.clip((np.arange(n) - 16) / 18, 0, 1)
    known = film_of(bar_scene("speckle"), poses(n, 0.3 * x * x * (3 - 2 * x)))
    whole = known.bodies[0].polygon_px
    left, right = whole.copy(), whole.copy()
    middle = whole[:, 0].mean()
    left[:, 0], right[:, 0] = np.minimum(left[:, 0], middle), np.maximum(right[:, 0], middle)
    bodies = [Body("left", left), Body("right", right, parent="left")]
    result = track(known.film, bodies, n_still=16, camera=AssumedCamera(np.radians(3.0), 0.0))
    absolute, relative = result.budget.absolute, result.budget.relative
    assert np.all(np.isnan(relative["tilt"][:, 0]))
    np.testing.assert_allclose(relative["noise"][:, 1], np.hypot(*absolute["noise"].T))
    late = slice(35, None)
    assert np.mean(relative["tilt"][late, 1]) < 0.6 * np.mean(np.hypot(*absolute["tilt"][late].T))
    table = result.to_frame()
    np.testing.assert_allclose(table["right_relative_u_total_rad"] ** 2, result.budget.total(True)[:, 1] ** 2)


def test_expected_budget_is_what_comes_out() -> None:
    n = 60
    x = np.clip((np.arange(n) - 16) / 30, 0, 1)
    known = film_of(bar_scene("wood"), poses(n, np.radians(15.0) * x * x * (3 - 2 * x)))
    seen = []
    camera = AssumedCamera(np.radians(2.0), 0.003)
    result = track(known.film, known.bodies, camera=camera, u_time_s=1e-5, expected=seen.append)
    before = seen[0].typical()["bar"]
    after = {name: values[-1, 0] for name, values in result.budget.absolute.items()}
    assert before["noise"] == pytest.approx(after["noise"], rel=0.12)
    assert before["reference"] == pytest.approx(after["reference"], rel=0.12)
    assert before["tilt"] == pytest.approx(after["tilt"], rel=0.5)
    assert before["synchronisation"] == pytest.approx(1e-5 * ExpectedMotion().speed_rad_per_s)
    ready = prepare(known.film, known.bodies, 14)
    faster = expected_budget(ready, camera, 1e-5, ExpectedMotion(speed_rad_per_s=40.0)).typical()["bar"]
    assert faster["synchronisation"] == pytest.approx(4e-4)


@pytest.mark.parametrize("quality", [95, 75])
def test_codec_term_covers_jpeg(tmp_path: Path, quality: int) -> None:
    """Random poses of a wooden bar as MJPEG: error over total uncertainty spreads by about one."""
    n, still = 170, 40
    rng = np.random.default_rng(5)
    pose = poses(n, np.zeros(n))
    walk = np.cumsum(rng.normal(0, [0.004, 0.25, 0.25], (n - still, 3)), axis=0)
    pose[still:, 0] += walk
    known = film_of(bar_scene("wood"), pose)
    path = tmp_path / "film.avi"
    write_avi(path, [known.film.read(i) for i in range(n)], 2000.0, quality=quality)
    with warnings.catch_warnings(action="ignore", category=VisionWarning), open_film(path) as film:
        assert film.compression is not None and film.compression.steps is not None
        assert film.compression.steps[0, 0] == (2 if quality == 95 else 8)  # T.81 table K.1 scaled by libjpeg
        assert film.compression.steps[0, 1] == (1 if quality == 95 else 6)
        assert film.compression.steps[1, 0] == (1 if quality == 95 else 6)
        result = track(film, known.bodies, n_still=still, camera=SQUARE)
    error = result.angle_rad[still:, 0] - (pose[still:, 0, 0] - pose[:still, 0, 0].mean())
    z = np.sqrt(np.nanmean((error / result.u_total_rad[still:, 0]) ** 2))
    assert 0.7 < z < 1.25
    codec = np.nanmean(result.budget.absolute["codec"])
    noise = np.nanmean(result.budget.absolute["noise"])
    assert codec < 0.5 * noise if quality == 95 else codec > 0.6 * noise


def test_rolling_shutter_term_is_the_error_it_makes() -> None:
    """A film whose rows are drawn at their own times, of a bar at constant speed (rad/s, px/s), against its angle when
    the first row is read; and against the closed form of a body with the same texture everywhere."""
    n, rate, rows_per_s, still, turning, sliding = 34, 2000.0, 2e5, 14, -25.0, 900.0
    scene, sensor = bar_scene("speckle"), Sensor(0.3, 8, 2)
    height = scene.background.shape[0]

    def at(t: float) -> np.ndarray:
        s = max(t - still / rate, 0.0)
        return np.array([turning * s, PIVOT[0] + sliding * s, PIVOT[1]])

    frames = []
    for i in range(n):
        light = np.empty(scene.background.shape, dtype=np.float32)
        for row in range(0, height, 3):
            light[row : row + 3] = scene.light(at(i / rate + (row + 1) / rows_per_s)[None, None])[row : row + 3]
        frames.append(sensor.expose(light))
    film = ArrayFilm(np.stack(frames), rate)
    body = Body("bar", scene.bodies[0].outline(*at(0.0)))
    result = track(film, [body], n_still=still - 2, camera=SQUARE, rows_per_s=rows_per_s)
    late = slice(still + 4, n - 1)
    true = np.array([at(i / rate)[0] for i in range(n)])
    error, term = (result.angle_rad[:, 0] - true)[late], result.budget.absolute["rows"][late, 0]
    u = result.predicted_u_rad[0]
    assert np.abs(error).min() > 15.0 * u
    np.testing.assert_allclose(term, np.abs(error), rtol=0.12, atol=3.0 * u)
    # closed form, in the picture's sense: the delay of the middle, and what a slide makes of the rows' delays
    pose_phi, rows = -turning, result.y_px[late, 0]
    template = prepare(film, [body], still - 2).templates[0]
    turn = true[late][:, None]
    dx, dy = template.offset_px.astype(float)
    across = -np.sin(turn) * dx + np.cos(turn) * dy  # rows from the middle; the picture's sense is clockwise
    speed_x = np.gradient(result.x_px[:, 0], 1.0 / rate)[late]
    skew = -speed_x * np.mean(across**2, axis=1) / np.mean(dx**2 + dy**2)
    closed = np.abs((pose_phi * rows + skew) / rows_per_s)
    np.testing.assert_allclose(term, closed, rtol=0.25)
