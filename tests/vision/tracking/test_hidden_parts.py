"""What hides a part of a body is left out altogether, and the row confirmed or widened."""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np

from tests.vision.known_films import (
    HEIGHT,
    PIVOT,
    WIDTH,
    KnownFilm,
    bar_motion,
    bar_scene,
    film_of,
    quietly_tracked,
    z_of,
)
from vision import FrameFlag, VisionWarning
from vision.results.pose_table import PoseTable
from vision.synthetic import Scene, SyntheticBody, background, box, speckle
from vision.tracking.film_tracker import FilmTracker
from vision.tracking.moving_parts import confirm_hidden
from vision.tracking.passes import track_forward
from vision.tracking.prepare import prepare

COVERED = np.uint16(int(FrameFlag.COVERED))


STILL, N = 14, 60


@cache
def film_with_slat() -> KnownFilm:
    """A turning bar of 110 px over whose end a textured slat of 24 px slides until it hides a fifth."""
    (bar,), picture = bar_scene("speckle").bodies, background(HEIGHT, WIDTH, 6)
    slat = SyntheticBody("slat", box(-12.0, -60.0, 12.0, 60.0), speckle((-16.0, -64.0, 16.0, 64.0), 9))
    x = np.minimum(30.0 + 1.5 * np.maximum(np.arange(N) - STILL - 4, 0), 75.0)
    over = np.column_stack([0.004 * np.arange(N), x, np.full(N, 80.0)])[:, None, :]
    return film_of(Scene([bar, slat], picture), np.concatenate([bar_motion(N, PIVOT, 0.2), over], axis=1))


def test_a_slat_that_slides_over_needs_no_flag() -> None:
    film = film_with_slat()
    result = quietly_tracked(film.film, film.bodies[:1])
    z = z_of(result, film.pose)[STILL:]
    assert result.info["rows_uncovered"] > 10
    assert np.mean(result.flag[STILL:] != 0) < 0.1
    assert np.abs(z).max() < 5.0 and np.mean(np.abs(z) < 1.96) > 0.85


def test_a_doubted_body_keeps_its_flag_and_a_wrong_pose_widens() -> None:
    film = film_with_slat()
    with warnings.catch_warnings(action="ignore", category=VisionWarning):
        ready = prepare(film.film, film.bodies[:1], n_still=STILL)
    table = PoseTable.empty(np.arange(N), 1)
    track_forward(FilmTracker(ready), table, n_still=STILL)
    before = (table.flag & COVERED) != 0
    assert confirm_hidden(ready, table, np.array([True])) == 0
    np.testing.assert_array_equal((table.flag & COVERED) != 0, before)
    row = int(np.flatnonzero(before[:, 0])[3])
    table.pose[row, 0, 0] += 20.0 * np.sqrt(table.covariance[row, 0, 0, 0])
    off = table.pose[row, 0, 0]
    cleared = confirm_hidden(ready, table, np.array([False]))
    assert cleared == before.sum() - 1
    assert table.flag[row, 0] & COVERED and table.pose[row, 0, 0] == off
    assert np.sqrt(table.covariance[row, 0, 0, 0]) > abs(off + film.pose[row, 0, 0] - film.pose[0, 0, 0]) / 2.0
