"""Frames fitted in one compiled call: the same bits as fitted body by body in Python, whatever happens in the film."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

import vision.tracking.track_film
from tests.vision.known_films import film_of, smooth_step
from vision import ArrayFilm, Body, FrameFlag, track
from vision.frame_fit.frame_fit import FrameFit, build_repeat_watch
from vision.results.pose_table import PoseTable
from vision.synthetic import Scene, SyntheticBody, background, box, speckle
from vision.tracking.film_tracker import FilmTracker, build_repeat_detector

pytestmark = pytest.mark.processor

N, STILL = 44, 12


@pytest.fixture(scope="module")
def lever_scene() -> Scene:
    """A beam, a finger that turns on it, and a plate in front of the beam's end."""
    beam = SyntheticBody("beam", box(-30.0, -16.0, 80.0, 16.0), speckle((-36.0, -22.0, 86.0, 22.0), 3))
    finger = SyntheticBody("finger", box(-14.0, -14.0, 14.0, 40.0), speckle((-20.0, -20.0, 20.0, 46.0), 4))
    plate = SyntheticBody("plate", box(-16.0, -20.0, 16.0, 20.0), speckle((-22.0, -26.0, 22.0, 26.0), 5))
    return Scene([beam, finger, plate], background(150, 210, 9))


def lever_motion() -> NDArray[np.float64]:
    """Poses (N, 3, 3): the finger rides on the beam, the plate slides over its end."""
    s = smooth_step((np.arange(N) - STILL) / (N - STILL - 4))
    beam = np.column_stack([0.25 * s, 60.0 + 7.0 * s, 88.0 - 4.0 * s])
    arm = np.array([20.0, -2.0])
    c, si = np.cos(beam[:, 0]), np.sin(beam[:, 0])
    # angles are counter-clockwise, the picture's y is down
    x, y = beam[:, 1] + c * arm[0] + si * arm[1], beam[:, 2] - si * arm[0] + c * arm[1]
    finger = np.column_stack([beam[:, 0] - 0.3 * s, x, y - 24.0])
    plate = np.column_stack([0.1 * s, 160.0 - 24.0 * s, 84.0 + 10.0 * s])
    return np.stack([beam, finger, plate], axis=1)


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[PoseTable]]:
    """The tables of all films that are tracked, as they are before the result."""
    seen: list[PoseTable] = []
    plain = vision.tracking.track_film.assemble_result

    def spy(ready: object, zero: object, table: PoseTable, *more: object) -> object:
        seen.append(table)
        return plain(ready, zero, table, *more)  # type: ignore[arg-type]

    monkeypatch.setattr(vision.tracking.track_film, "assemble_result", spy)
    yield seen


def nothing(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return frames


def trouble(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A dark frame, a repeated one, a lamp that fades across the picture, a bright spot, a bar over the beam."""
    frames = frames.copy()
    frames[18:20] = 3
    frames[22] = frames[21]
    fade = np.linspace(1.0, 0.6, frames.shape[2])
    frames[26:32] = (frames[26:32] * fade).astype(np.uint8)
    frames[33:, 70:100, 60:100] = 255
    frames[38:41, :, 90:104] = 20
    return frames


@pytest.mark.parametrize(("change", "every"), [(nothing, 1), (trouble, 2)])
def test_compiled_frames_have_the_bits_of_fits_in_python(
    lever_scene: Scene,
    monkeypatch: pytest.MonkeyPatch,
    tables: list[PoseTable],
    change: Callable[[NDArray[np.uint8]], NDArray[np.uint8]],
    every: int,
) -> None:
    known = film_of(lever_scene, lever_motion(), parents={"finger": "beam"})
    film = ArrayFilm(change(known.frames), frame_rate_hz=2000.0)
    walked = []
    walk = FrameFit.track_rows
    monkeypatch.setattr(FrameFit, "track_rows", lambda *a: walked.append(walk(*a)) or walked[-1])
    with warnings.catch_warnings(action="ignore"):
        compiled = track(film, known.bodies, every=every, n_still=STILL)
        monkeypatch.setattr(FilmTracker, "track_rows", lambda *a: 0)
        by_frame = track(film, known.bodies, every=every, n_still=STILL)
        fit_from = FrameFit.fit_from
        monkeypatch.setattr(FrameFit, "fit_from", lambda self, *a: self.states.apart.fill(1) or fit_from(self, *a))
        in_python = track(film, known.bodies, every=every, n_still=STILL)
    if change is nothing:
        assert sum(walked) >= 10 / every and not compiled.is_lost.any()  # small bodies are looked at twice often
    else:
        assert compiled.is_lost.any() and (compiled.flag & int(FrameFlag.COVERED)).any()
    for other, table in zip((by_frame, in_python), tables[1:], strict=True):
        for name in ("frame", "pose", "covariance", "zncc", "inlier", "noise_grey", "gain", "flag", "ratio", "blocks"):
            np.testing.assert_array_equal(getattr(table, name), getattr(tables[0], name), err_msg=name)
        np.testing.assert_array_equal(other.angle_rad, compiled.angle_rad)
        np.testing.assert_array_equal(other.u_angle_rad, compiled.u_angle_rad)
        assert other.info["wide_searches"] == compiled.info["wide_searches"]


def test_a_body_that_was_never_placed_is_left_to_python(lever_scene: Scene) -> None:
    known = film_of(lever_scene, lever_motion()[:16], parents={"finger": "beam"})
    tracker = FilmTracker(vision.tracking.track_film.prepare(known.film, known.bodies, STILL))
    tracker.clear_histories()
    table, repeats = PoseTable.empty(np.arange(4), 3), build_repeat_detector(known.film, tracker.ready.templates, STILL)
    assert tracker.track_rows(table, range(0, 4), 0, build_repeat_watch(repeats, 0)) == 0
    tracker.place(-1, np.zeros((3, 3)))
    done = tracker.track_rows(table, range(0, 4), 0, build_repeat_watch(repeats, 0))
    assert done and not table.is_lost[:done].any() and tracker.trackers[2].fit.converged
    np.testing.assert_array_equal(tracker.trackers[2].fit.pose, table.pose[done - 1, 2])
    assert isinstance(known.bodies[0], Body)
