"""Outlines by their file, a film at its true rate, a part of it; the result as table, plot and file."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import vision
from tests.vision.known_films import PIVOT, bar_motion, bar_scene, film_of

N = 40


@pytest.fixture(scope="module")
def known():
    return film_of(bar_scene("speckle"), bar_motion(N, PIVOT, 0.1))


@pytest.fixture(scope="module")
def tracked(known):
    return vision.track(known.film, known.bodies, threads=1)


def test_outlines_may_be_a_file(known, tracked, tmp_path):
    file = tmp_path / "bodies.toml"
    vision.save_bodies(file, known.bodies)
    for bodies in (file, str(file)):
        found = vision.track(known.film, bodies=bodies, threads=1)
        np.testing.assert_array_equal(found.angle_rad, tracked.angle_rad)
    assert len(vision.preview(known.film, file, 2).frame) == 2
    with pytest.raises(vision.BodyError, match=r"nowhere\.toml: cannot be read"):
        vision.track(known.film, tmp_path / "nowhere.toml")


def test_a_stated_rate_gives_the_times(known, tracked):
    found = vision.track(known.film, known.bodies, frame_rate_hz=123.0, threads=1)
    np.testing.assert_allclose(np.diff(found.time_s), 1 / 123.0)
    np.testing.assert_array_equal(found.angle_rad, tracked.angle_rad)
    with pytest.raises(vision.InputError, match="`frame_rate_hz` and `frame_time_s` are given; leave one out"):
        vision.track(known.film, known.bodies, tracked.time_s, frame_rate_hz=123.0)
    with pytest.raises(vision.InputError, match="frame rate -1 Hz; needs a positive number"):
        vision.track(known.film, known.bodies, frame_rate_hz=-1.0)


def test_a_part_of_a_film_keeps_its_times(known, tracked):
    found = vision.track(known.film, known.bodies, first_frame=2, last_frame=29, threads=1)
    np.testing.assert_array_equal(found.frame, np.arange(28))
    np.testing.assert_allclose(found.time_s, tracked.time_s[2:30])
    np.testing.assert_allclose(found.angle_rad, tracked.angle_rad[2:30], atol=5e-4)


def test_a_tracked_film_is_a_table_a_plot_and_a_file(known, tracked, tmp_path):
    (body,) = tracked.bodies
    np.testing.assert_array_equal(tracked[body], tracked.angle_rad[:, 0])
    axes = Figure().subplots()
    assert tracked.plot(ax=axes) is axes
    np.testing.assert_allclose(axes.lines[0].get_ydata(), np.degrees(tracked[body] - tracked[body][0]))
    frame = tracked.to_frame()
    assert frame.attrs["units"][f"{body}_u_x_px"] == "px" and frame.attrs["units"][f"{body}_u_rad"] == "rad"
    read = pd.read_csv(tracked.save(tmp_path / "angles.csv"))
    np.testing.assert_allclose(read[f"{body}_rad"], tracked.angle_rad[:, 0], rtol=1e-15)
    assert repr(tracked).count("\n") < 12 and f"{N} frames" in repr(tracked)
