"""A body that stops looking like the still frames is followed by later frames, and its u grows with them."""

from __future__ import annotations

import numpy as np

from tests.vision.known_films import PIVOT, bar_motion, bar_scene, blurred, film_of, quietly_tracked, smooth_step, z_of
from vision import FrameFlag
from vision.fitting.template import Template, build_template
from vision.frame_fit.judgement import Standards

RENEWED = np.uint16(int(FrameFlag.RENEWED))


def test_a_body_that_leaves_the_plane_of_focus() -> None:
    n = 52
    pose, width = bar_motion(n, PIVOT, 0.25), 6.0 * smooth_step((np.arange(n) - 16) / 26)
    known = film_of(bar_scene("speckle"), pose, seed=3, cover=blurred(width))
    result = quietly_tracked(known.film, known.bodies, confirm="none")
    renewed = (result.flag[:, 0] & RENEWED) != 0
    assert not result.is_lost.any() and renewed.sum() == result.info["rows_renewed"] > 5
    assert np.abs(z_of(result, pose))[renewed].max() < 5.0
    # the pose a later reference starts from is uncertain too
    assert result.u_angle_rad[renewed, 0].min() > result.u_angle_rad[:10, 0].max()
    assert result.u_angle_rad[-1, 0] > 3.0 * result.u_angle_rad[0, 0]


def test_noise_that_hides_the_texture_is_no_reference() -> None:
    """With noise as large as the grain one frame is no template; nothing breaks and nothing is found."""

    def gone(i: int, light: np.ndarray) -> None:
        if i >= 28:
            light[:] = 90.0

    known = film_of(bar_scene("wood"), bar_motion(40, PIVOT, 0.25), noise_grey=60.0, seed=3, cover=gone)
    result = quietly_tracked(known.film, known.bodies, n_still=14)
    assert not np.any(np.isfinite(result.angle_rad[28:]))
    assert 0.0 < Standards.from_templates([_noise_only()]).contrast[0] < 0.1


def _noise_only() -> Template:
    """A template of nothing but noise."""
    picture = 90.0 + np.random.default_rng(1).normal(0.0, 10.0, (60, 80))
    mask = np.zeros(picture.shape, dtype=bool)
    mask[8:-8, 8:-8] = True
    return build_template("bar", picture, mask, 1, None, 12.0)
