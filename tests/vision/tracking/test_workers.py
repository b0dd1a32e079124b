"""Work for each of several items: in the order of the items, with the first item's error, by threads or in turn."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from tests.vision.known_films import PIVOT, bar_scene, film_of
from vision import ArrayFilm, Body
from vision.reference.camera_faults import WithoutDefects
from vision.tracking.prepare import prepare
from vision.tracking.workers import workers


@pytest.mark.parametrize("threads", [1, 3])
def test_each_keeps_the_order_and_raises_the_first_error(threads: int) -> None:
    seen: set[str] = set()
    first_waits = threading.Event()

    def work(item: int) -> int:
        seen.add(threading.current_thread().name)
        if threads > 1 and item == 0:
            assert first_waits.wait(20.0)  # until a later item is done
        first_waits.set()
        if item in (4, 6):
            raise ValueError(f"item {item}")
        return 10 * item

    with workers(threads) as crew:
        assert crew.each(work, range(4)) == [0, 10, 20, 30]
        with pytest.raises(ValueError, match="item 4"):
            crew.each(work, range(3, 8))
    assert (len(seen) > 1) == (threads > 1)


def test_a_film_with_defect_pixels_is_averaged_without_them() -> None:
    pose = np.tile([0.0, *PIVOT], (16, 1))[:, None, :]
    known = film_of(bar_scene("speckle"), pose)
    frames = np.stack([known.film.read(i) for i in range(16)])
    frames[:, 96, 130], frames[:, 90, 110] = 255, 0
    bodies: list[Body] = known.bodies
    with workers(2) as crew:
        found = [prepare(ArrayFilm(frames, 2000.0), bodies, 12, each=each) for each in (crew.each,)]
    found.append(prepare(ArrayFilm(frames, 2000.0), bodies, 12))
    for ready in found:
        assert isinstance(ready.film, WithoutDefects) and ready.reference.picture[96, 130] < 250.0
    np.testing.assert_array_equal(found[0].reference.picture, found[1].reference.picture)
    np.testing.assert_array_equal(found[0].templates[0].columns, found[1].templates[0].columns)
