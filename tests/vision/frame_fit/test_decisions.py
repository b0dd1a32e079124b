"""The compiled decisions of tracking against the same written to be read."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.vision.frame_fit.reference import PlainBody, PlainStandards, plain_flags
from vision import FrameFlag
from vision.fitting.template import Template, build_template
from vision.frame_fit.judgement import Figures, Standards, judge_fit
from vision.frame_fit.motion import Motion, expect_bodies, expect_pose, place_body

pytestmark = pytest.mark.processor

F64 = NDArray[np.float64]


@cache
def template(x: float, y: float, noise_grey: float = 2.0) -> Template:
    """Of a textured rectangle of 40 x 24 px, its middle at (x, y)."""
    picture = 90.0 + np.random.default_rng(int(x)).normal(0.0, 20.0, (200, 260))
    mask = np.zeros(picture.shape, dtype=bool)
    mask[int(y) - 12 : int(y) + 12, int(x) - 20 : int(x) + 20] = True
    return build_template("one", picture, mask, 9, noise_grey=noise_grey)


@pytest.mark.parametrize("seed", range(6))
def test_bodies_are_expected_as_the_plain_ones(seed: int) -> None:
    """Random walks of a body, a child and a grandchild, with steps in which some are not found."""
    rng = np.random.default_rng(seed)
    templates = [template(60, 50), template(120, 80), template(190, 120)]
    motion, size = Motion.from_templates(templates, [None, 0, 1]), (200, 260)
    plain = [PlainBody(np.array(one.centre_px)) for one in templates]
    plain[1].parent, plain[2].parent = plain[0], plain[1]
    boxes, expected = np.array([one.box_px for one in templates]), np.zeros((3, 3))
    region, union, pose = np.zeros((3, 4), dtype=np.int64), np.zeros(4, dtype=np.int64), np.zeros((3, 3))
    for body in range(3):
        place_body(motion, body, -1, pose[body])
        plain[body].place(-1, pose[body])
    for step in range(30):
        assert expect_bodies(motion, step, boxes, size, expected, region, union)
        np.testing.assert_allclose(expected, [one.expect(step) for one in plain], atol=1e-9)
        assert union.tolist() == [*region.min(axis=0)[[0]], region[:, 1].max(), region[:, 2].min(), region[:, 3].max()]
        pose += rng.normal(0.0, [0.01, 0.4, 0.4], (3, 3)) + [0.004, 0.2, -0.1]
        for body in range(3):
            now = np.empty(3)
            expect_pose(motion, body, step, True, now)
            np.testing.assert_allclose(now, plain[body].expect(step), atol=1e-9)
            if rng.random() < 0.85:
                place_body(motion, body, step, pose[body])
                plain[body].place(step, pose[body])


def test_prediction_is_of_constant_acceleration_and_starts_anew_after_a_gap() -> None:
    one = template(60, 50)
    motion, found = Motion.from_templates([one]), np.empty(3)
    for k in range(3):
        place_body(motion, 0, k, np.array([0.1 * k * k, 2.0 * k, -1.0]))
    for step, is_moving, expected in (
        (3, True, [0.9, 6.0, -1.0]),
        (3, False, [0.4, 4.0, -1.0]),
        (7, True, [0.4, 4.0, -1.0]),
    ):
        expect_pose(motion, 0, step, is_moving, found)
        np.testing.assert_allclose(found, expected, atol=1e-12)
    place_body(motion, 0, 7, np.array([5.0, 5.0, 5.0]))
    expect_pose(motion, 0, 8, True, found)
    np.testing.assert_allclose(found, [5.0, 5.0, 5.0])


def test_a_child_fixed_to_its_parent_turns_with_it() -> None:
    templates = [template(60, 50), template(120, 50)]
    motion, found = Motion.from_templates(templates, [None, 0]), np.empty(3)
    for body in range(2):
        place_body(motion, body, -1, np.zeros(3))
    place_body(motion, 0, 0, np.array([np.pi / 2, 0.0, 0.0]))
    expect_pose(motion, 1, 0, True, found)
    apart = templates[1].centre_px[0] - templates[0].centre_px[0]
    np.testing.assert_allclose(found, [np.pi / 2, -apart, apart], atol=1e-9)


share = st.floats(0.0, 1.0)


@settings(max_examples=300, deadline=None)
@given(
    noise=st.sampled_from([0.0, 2.0, 18.0, 40.0]),
    usual=st.tuples(st.sampled_from([0.0, 0.6, 0.97]), st.floats(0.5, 1.5)),
    shares=st.tuples(share, share, share),
    gain=st.floats(0.05, 6.0),
    off=st.floats(0.7, 1.4),
    residual=st.floats(0.0, 50.0),
    step=st.tuples(st.floats(-0.2, 0.2), st.floats(-15.0, 15.0), st.floats(-15.0, 15.0)),
    u=st.sampled_from([1e-3, 0.0, np.nan, np.inf]),
)
def test_fits_are_judged_as_by_the_plain_rules(
    noise: float,
    usual: tuple[float, float],
    shares: tuple[float, float, float],
    gain: float,
    off: float,
    residual: float,
    step: tuple[float, float, float],
    u: float,
) -> None:
    one = template(60, 50, noise)
    standards = Standards.from_templates([template(120, 80), one])
    standards.usual[1] = usual
    zncc, inlier, more = shares
    figures = Figures(zncc, inlier, residual, gain, min(inlier + 0.3 * more, 1.0), off * gain * one.mean_grey)
    numbers = [float(values[1]) for values in standards[:-1]]
    plain = PlainStandards(*numbers, *map(float, usual))
    expected, covariance = np.array([0.1, 4.0, -3.0]), np.diag([u**2, 1e-4, 1e-4])
    flag = judge_fit(standards, 1, figures, expected + step, expected, covariance)
    assert FrameFlag(flag) == plain_flags(plain, figures._asdict(), np.array(step), covariance)
