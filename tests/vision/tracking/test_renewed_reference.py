"""A body that stops looking like the still frames is followed by later frames, and its u grows with them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy import ndimage

from tests.vision.known_films import PIVOT, bar_motion, bar_scene, error_of, smooth_step
from vision.bodies.outlines import Body
from vision.errors import VisionWarning
from vision.film.source import ArrayFilm
from vision.fitting.icgn import IcgnFitter
from vision.fitting.template import Template, build_template
from vision.results.flags import FrameFlag
from vision.synthetic import Sensor
from vision.tracking.body_tracker import BodyTracker
from vision.tracking.passes import _seen_from
from vision.tracking.track_film import track_film

RENEWED = np.uint16(int(FrameFlag.RENEWED))


def test_a_body_that_leaves_the_plane_of_focus() -> None:
    n = 52
    scene, pose = bar_scene("speckle"), bar_motion(n, PIVOT, 0.25)
    width, sensor = 6.0 * smooth_step((np.arange(n) - 16) / 26), Sensor(2.0, 8, 3)
    frames = [
        sensor.expose(ndimage.gaussian_filter(scene.light(pose[i][None]), width[i]).astype(np.float32))
        for i in range(n)
    ]
    body = Body("bar", scene.bodies[0].outline(*pose[0, 0]))
    with warnings.catch_warnings(action="ignore", category=VisionWarning):
        result = track_film(ArrayFilm(np.stack(frames), 2000.0), [body], confirm="none")
    renewed = (result.flag[:, 0] & RENEWED) != 0
    assert not result.failed.any() and renewed.sum() == result.info["rows_renewed"] > 5
    error = error_of(result, pose)
    assert np.abs(error / result.u_angle_rad[:, 0])[renewed].max() < 5.0
    # the pose a later reference starts from is uncertain too
    assert result.u_angle_rad[renewed, 0].min() > result.u_angle_rad[:10, 0].max()
    assert result.u_angle_rad[-1, 0] > 3.0 * result.u_angle_rad[0, 0]


def test_noise_that_hides_the_texture_is_no_reference() -> None:
    """With noise as large as the grain one frame is no template; nothing breaks and nothing is found."""
    n = 40
    scene, pose = bar_scene("wood"), bar_motion(n, PIVOT, 0.25)
    sensor = Sensor(60.0, 8, 3)
    frames = [sensor.expose(scene.light(pose[i][None])) for i in range(n)]
    frames[28:] = [sensor.expose(np.full_like(scene.light(pose[0][None]), 90.0)) for _ in range(n - 28)]
    body = Body("bar", scene.bodies[0].outline(*pose[0, 0]))
    with warnings.catch_warnings(action="ignore", category=VisionWarning):
        result = track_film(ArrayFilm(np.stack(frames), 2000.0), [body], n_still=14)
    assert not np.any(np.isfinite(result.angle_rad[28:]))
    template = BodyTracker(IcgnFitter(_noise_only()))
    assert 0.0 < template.common_contrast < 0.1


def _noise_only() -> Template:
    """A template of nothing but noise."""
    picture = 90.0 + np.random.default_rng(1).normal(0.0, 10.0, (60, 80))
    mask = np.zeros(picture.shape, dtype=bool)
    mask[8:-8, 8:-8] = True
    return build_template("bar", picture, mask, 1, None, 12.0)


def test_poses_of_two_templates_of_one_body() -> None:
    """From the still frames' template to a later one's and back."""

    class Centred:
        def __init__(self, x: float, y: float) -> None:
            self.centre_px = (x, y)

    own, later = Centred(80.0, 60.0), Centred(97.0, 41.0)
    at, pose = np.array([0.3, 12.0, -17.0]), np.array([0.52, 20.0, -9.0])
    there = _seen_from(own, later, at, pose)  # type: ignore[arg-type]
    assert there[0] == pytest.approx(0.22)
    np.testing.assert_allclose(_seen_from(own, later, at, at), 0.0, atol=1e-12)  # type: ignore[arg-type]
    np.testing.assert_allclose(_seen_from(later, own, None, there, at), pose, atol=1e-12)  # type: ignore[arg-type]
