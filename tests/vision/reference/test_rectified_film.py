"""A film resampled to square pixels, of pictures whose grey values are formulas."""

from __future__ import annotations

import numpy as np
import pytest

from vision import ArrayFilm, Projection, VisionInputError
from vision.reference.rectified_film import RectifiedFilm

HEIGHT, WIDTH = 72, 100


def _grey(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 120.0 + 60.0 * np.sin(0.21 * x + 0.4) * np.cos(0.17 * y)


def _film() -> ArrayFilm:
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    return ArrayFilm(np.rint(200.0 * _grey(x, y)).astype(np.uint16)[None], 500.0)


@pytest.mark.parametrize("aspect", [9.0 / 8.0, 0.75, 2.0])
@pytest.mark.parametrize("field", [None, 0, 1])
def test_every_pixel_is_the_films_value_at_its_place(aspect: float, field: int | None) -> None:
    film = RectifiedFilm(_film(), aspect, field=field)
    whole = film.read(0)
    assert whole.shape == (film.height, film.width)
    # a pixel of the film that is wider than high covers more than one square one
    assert (film.width, film.height) == (round(WIDTH * max(aspect, 1.0)), round(HEIGHT * max(1.0 / aspect, 1.0)))
    y, x = np.mgrid[0 : film.height, 0 : film.width].astype(float)
    at = film.to_film(np.stack([x, y], axis=-1))
    inside = (slice(12, -12), slice(12, -12))
    expected = 200.0 * _grey(at[..., 0], at[..., 1])
    assert np.abs(whole - expected)[inside].max() < (4.0 if field is None else 150.0)
    np.testing.assert_allclose(film.rectify(at[5, 7]), [7.0, 5.0])
    part = film.read_region(0, 20, 41, 15, 50)
    np.testing.assert_allclose(part[8:-8, 8:-8], whole[28:33, 23:42], rtol=1e-4)


def test_what_lies_outside_the_film_or_is_saturated_stays_so() -> None:
    frames = _film().read(0)[None].copy()
    frames[0, 30:40, 40:60] = 65535
    lean = np.array([[1.1, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.0]])
    film = RectifiedFilm(ArrayFilm(frames, 500.0), projection=Projection(WIDTH, HEIGHT, lean))
    picture = film.read(0)
    assert picture[36, 49] == 65535.0
    assert picture[36, 0] == 65535.0  # stretched along x by 1.1: the film ends before
    assert picture[10, 50] < 65535.0


@pytest.mark.parametrize("aspect", [0.1, 6.0])
def test_an_aspect_out_of_range_is_refused(aspect: float) -> None:
    with pytest.raises(VisionInputError, match="pixel aspect"):
        RectifiedFilm(_film(), aspect)
