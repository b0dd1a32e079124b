"""A film tracked in stretches: the same bits with any number of threads, and stretches that do not join are mended."""

from __future__ import annotations

import numpy as np
import pytest

import vision.tracking.body_tracker
import vision.tracking.passes
import vision.tracking.segments
from tests.vision.known_films import PIVOT, bar_motion, bar_scene, dark, film_of, same_bits, sliding_bar, z_of
from vision import ArrayFilm, InputError, track

N = 120


@pytest.fixture(autouse=True)
def short_stretches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four stretches of the film."""
    monkeypatch.setattr(vision.tracking.segments, "STRETCH_ROWS", 30)


def counted_searches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The frames in which a body is searched for, as they come."""
    frames: list[int] = []
    plain = vision.tracking.body_tracker.search_near_pose
    monkeypatch.setattr(vision.tracking.body_tracker, "search_near_pose", lambda *a: frames.append(a[1]) or plain(*a))
    return frames


def test_any_number_of_threads_gives_the_same_bits() -> None:
    """The seam between the second and the third stretch is dark."""
    pose = bar_motion(N, PIVOT, 0.2)
    known = film_of(bar_scene("speckle"), pose, cover=dark(range(57, 62)))
    one = track(known.film, known.bodies, threads=1)
    for threads in (2, 5):
        same_bits(track(known.film, known.bodies, threads=threads), one)
    np.testing.assert_array_equal(np.flatnonzero(one.is_lost[:, 0]), np.arange(57, 62))
    assert np.nanmax(np.abs(z_of(one, pose))) < 5.0
    with pytest.raises(InputError, match="threads"):
        track(known.film, known.bodies, threads=0)


def test_a_film_in_stretches_is_as_good_as_a_whole_one(monkeypatch: pytest.MonkeyPatch) -> None:
    known = film_of(bar_scene("wood"), bar_motion(N, PIVOT, 0.4))
    parts = track(known.film, known.bodies)
    monkeypatch.setattr(vision.tracking.segments, "STRETCH_ROWS", N)
    whole = track(known.film, known.bodies)
    assert np.abs((parts.angle_rad - whole.angle_rad) / whole.u_angle_rad).max() < 0.3
    np.testing.assert_allclose(parts.u_angle_rad, whole.u_angle_rad, rtol=0.1)
    np.testing.assert_array_equal(parts.flag, whole.flag)


@pytest.mark.parametrize("fault", ["wrong place", "no place"])
def test_a_stretch_that_does_not_join_is_tracked_from_the_one_before(
    monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    known = film_of(bar_scene("speckle"), bar_motion(N, PIVOT, 0.4))
    plain = vision.tracking.segments.find_segment_starts

    def misled(*arguments: object) -> object:
        for k, (before, newest) in enumerate(plain(*arguments)):
            if k == 1 and fault == "no place":
                return
            # far enough to be another place, too far to be found again
            yield (before + [0.9, 70.0, -50.0], newest + [0.9, 70.0, -50.0]) if k == 1 else (before, newest)

    monkeypatch.setattr(vision.tracking.segments, "find_segment_starts", misled)
    searches = counted_searches(monkeypatch)
    results = [track(known.film, known.bodies, threads=threads, confirm="none") for threads in (1, 3)]
    same_bits(*results)
    assert not results[0].is_lost.any()
    assert not searches, "a stretch that cannot join is given up at its seam"
    monkeypatch.setattr(vision.tracking.segments, "STRETCH_ROWS", N)
    whole = track(known.film, known.bodies, confirm="none")
    assert np.abs((results[0].angle_rad - whole.angle_rad) / whole.u_angle_rad).max() < 0.3


def test_a_stretch_begins_where_a_third_of_the_body_is_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    known = film_of(bar_scene("speckle"), bar_motion(N, PIVOT, 0.3), cover=sliding_bar)
    searches, joined = counted_searches(monkeypatch), []
    plain = vision.tracking.segments.Segment.is_continuous
    monkeypatch.setattr(
        vision.tracking.segments.Segment, "is_continuous", lambda *both: joined.append(plain(*both)) or joined[-1]
    )
    result = track(known.film, known.bodies)
    assert not result.is_lost.any() and not searches
    assert joined == [True] * 3


def test_an_error_in_a_thread_ends_the_run() -> None:
    known = film_of(bar_scene("speckle"), bar_motion(N, PIVOT, 0.2))

    class Broken(ArrayFilm):
        def read(self, index: int) -> np.ndarray:
            if index == 100:
                raise InputError("frame 100 cannot be decoded")
            return super().read(index)

    film = Broken(known.frames, 2000.0)
    for threads in (1, 3):
        with pytest.raises(InputError, match="frame 100"):
            track(film, known.bodies, threads=threads)
