"""Light that differs between even and odd rows is found where it changes, and taken off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vision import ArrayFilm, FrameSource
from vision.reference.camera_faults import (
    FlickerCorrectedFilm,
    correct_row_flicker,
    row_flicker_share,
)

BOX = (10, 90, 15, 140)


def film_of(depth: NDArray[np.float64], row_noise: float = 0.0) -> FrameSource:
    rng = np.random.default_rng(3)
    surface = 110.0 + 60.0 * ndimage.gaussian_filter(rng.normal(size=(100, 160)), 1.2)
    rows = np.where(np.arange(100) % 2, -1.0, 1.0)[:, None]
    frames = [
        surface * (1.0 + one * rows) + rng.normal(0.0, 2.0, surface.shape) + rng.normal(0.0, row_noise, (100, 1))
        for one in depth
    ]
    return ArrayFilm(np.clip(np.rint(frames), 0, 255).astype(np.uint8))


def test_rows_are_brought_to_the_same_light() -> None:
    depth = 0.04 * np.cos(1.3 * np.arange(12) + 1.0)
    film = correct_row_flicker(film_of(depth), BOX)
    assert isinstance(film, FlickerCorrectedFilm)
    found = np.array([film.amplitude(k) for k in range(12)])
    np.testing.assert_allclose(found - found.mean(), depth - depth.mean(), atol=0.001)
    # also outside the rectangle where it was measured, and in a rectangle that begins with an odd row
    left = [row_flicker_share(film.read_region(k, 3, 97, 0, 160), 3, 255)[0] for k in range(12)]
    assert np.std(left) < 0.001
    np.testing.assert_array_equal(film.read(5)[3:97], film.read_region(5, 3, 97, 0, 160))


def test_saturated_pixels_stay_so() -> None:
    frames = np.full((6, 40, 40), 255, dtype=np.uint8)
    frames[:, 10:30] = (100.0 * (1.0 + 0.05 * np.cos(np.arange(6)))[:, None, None]).astype(np.uint8)
    film = FlickerCorrectedFilm(ArrayFilm(frames), (0, 40, 0, 40))
    assert np.all(film.read(2)[:10] == 255)
