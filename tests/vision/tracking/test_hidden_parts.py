"""What hides a part of a body is left out altogether, and the row confirmed or widened."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from types import ModuleType

import numpy as np

from vision import ArrayFilm, Body, FrameFlag, VisionWarning
from vision.results.pose_table import PoseTable
from vision.tracking.film_tracker import FilmTracker
from vision.tracking.moving_parts import confirm_hidden
from vision.tracking.passes import track_forward
from vision.tracking.prepare import prepare

COVERED = np.uint16(int(FrameFlag.COVERED))


def test_a_slat_that_slides_over_needs_no_flag(stress: ModuleType, tracked: Callable[..., tuple]) -> None:
    result, _, z = tracked("neighbour", "speckle", 501)
    assert result.info["rows_uncovered"] > 10
    assert np.mean(result.flag[stress.STILL :] != 0) < 0.1
    assert np.abs(z).max() < 5.0 and np.mean(np.abs(z) < 1.96) > 0.85


def test_a_doubted_body_keeps_its_flag_and_a_wrong_pose_widens(stress: ModuleType) -> None:
    film = stress.stress_film("neighbour", "speckle", 501)
    with warnings.catch_warnings(action="ignore", category=VisionWarning):
        ready = prepare(ArrayFilm(film.frames, 2000.0), [Body("bar", film.outline_px)], n_still=stress.STILL)
    table = PoseTable.empty(np.arange(len(film.frames)), 1)
    track_forward(FilmTracker(ready), table, n_still=stress.STILL)
    before = (table.flag & COVERED) != 0
    assert confirm_hidden(ready, table, np.array([True])) == 0
    np.testing.assert_array_equal((table.flag & COVERED) != 0, before)
    row = int(np.flatnonzero(before[:, 0])[3])
    table.pose[row, 0, 0] += 20.0 * np.sqrt(table.covariance[row, 0, 0, 0])
    off = table.pose[row, 0, 0]
    cleared = confirm_hidden(ready, table, np.array([False]))
    assert cleared == before.sum() - 1
    assert table.flag[row, 0] & COVERED and table.pose[row, 0, 0] == off
    assert np.sqrt(table.covariance[row, 0, 0, 0]) > abs(off + film.angle_rad[row] - film.angle_rad[0]) / 2.0
