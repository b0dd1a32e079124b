"""Defect pixels of a sensor and squares that a codec left out: found where they are, and nowhere else."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy import ndimage

from tests.vision.known_films import smooth_step
from vision import ArrayFilm, Body, VisionWarning, track
from vision.reference.camera_faults import DefectCorrectedFilm, correct_defects, skips_blocks

N, HEIGHT, WIDTH, STILL = 30, 128, 160, 12
RNG = np.random.default_rng(7)
PAINT = 110.0 + 30.0 * ndimage.gaussian_filter(RNG.normal(size=(260, 260)), 1.8) / 0.08 / 2.0


def shifted(seed: int, noise: float = 2.0, paint: np.ndarray = PAINT) -> tuple[np.ndarray, np.ndarray]:
    """Frames of a texture that moves along x, and its way."""
    rng = np.random.default_rng(seed)
    way = 9.0 * smooth_step((np.arange(N) - STILL) / 15)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    spline = ndimage.spline_filter(paint, 3, mode="mirror")
    frames = [
        ndimage.map_coordinates(spline, [y + 50, x + 50 - shift], order=3, mode="mirror", prefilter=False)
        for shift in way
    ]
    return np.clip(np.rint(frames + rng.normal(0.0, noise, (N, HEIGHT, WIDTH))), 0, 255).astype(np.uint8), way


def test_defect_pixels_are_replaced_and_the_angle_is_right() -> None:
    frames, way = shifted(1)
    bright, dark = (RNG.uniform(size=(HEIGHT, WIDTH)) < 0.002 for _ in range(2))
    frames[:, bright], frames[:, dark] = 255, 0
    film = correct_defects(ArrayFilm(frames, 2000.0))
    assert isinstance(film, DefectCorrectedFilm)
    found = np.zeros((HEIGHT, WIDTH), dtype=bool)
    found[film.rows, film.columns] = True
    planted = bright | dark
    assert (found & planted).sum() > 0.9 * planted.sum() and not (found & ~ndimage.binary_dilation(planted)).any()
    part = film.read_region(20, 10, 90, 5, 130)
    np.testing.assert_array_equal(part[~found[10:90, 5:130]], frames[20, 10:90, 5:130][~found[10:90, 5:130]])
    assert np.abs(part.astype(float) - ndimage.median_filter(part, 3)).max() < 100.0
    body = Body("plate", np.array([[40.0, 30.0], [120.0, 30.0], [120.0, 100.0], [40.0, 100.0]]))
    result = track(ArrayFilm(frames, 2000.0), [body], n_still=STILL)
    assert result.info["defect_pixels"] == film.rows.size
    z_x = (result.x_px[:, 0] - result.x_px[0, 0] - way)[STILL:] / result.u_position_px[STILL:, 0, 0]
    z = result.angle_rad[STILL:, 0] / result.u_angle_rad[STILL:, 0]
    assert np.abs(z).max() < 5.0 and np.abs(z_x).max() < 5.0 and not result.is_lost.any()


@pytest.mark.parametrize("kind", ["clean", "glints that move", "salt and pepper"])
def test_other_films_are_left_alone(kind: str) -> None:
    paint = PAINT.copy()
    if kind != "clean":
        paint[RNG.uniform(size=paint.shape) < (0.001 if kind.startswith("glints") else 0.05)] = 255.0
    film = ArrayFilm(shifted(2, paint=paint)[0], 2000.0)
    assert correct_defects(film) is film


def test_texture_of_a_body_that_rests_in_most_frames_is_no_defect() -> None:
    paint = np.where(np.random.default_rng(8).uniform(size=PAINT.shape) < 0.001, 255.0, PAINT)
    frames = shifted(5, paint=paint)[0][[*range(STILL)] * 4 + [*range(22, N)]]
    film = ArrayFilm(frames, 2000.0)
    assert correct_defects(film) is film
    planted = [40, 90], [50, 70]
    frames[:, *planted] = 255
    frames[33, *planted] = frames[33, [39, 89], [50, 70]]  # one of the frames that are compared does not show them
    found = correct_defects(ArrayFilm(frames, 2000.0))
    assert isinstance(found, DefectCorrectedFilm)
    np.testing.assert_array_equal((found.rows, found.columns), planted)


def test_squares_left_out_are_noticed() -> None:
    frames, _ = shifted(3)
    box = (10, 120, 10, 150)
    assert not skips_blocks(ArrayFilm(frames, 2000.0), box, 2.0)
    left_out = frames.copy()
    for k in range(1, N):
        for y, x in RNG.integers(0, (HEIGHT // 16, WIDTH // 16), (10, 2)) * 16:
            left_out[k, y : y + 16, x : x + 16] = left_out[k - 1, y : y + 16, x : x + 16]
    assert skips_blocks(ArrayFilm(left_out, 2000.0), box, 2.0)
    assert skips_blocks(ArrayFilm(left_out, 2000.0), box, 0.1), "most pixels at rest may be left out, too"
    still, _ = shifted(3, noise=0.0)
    assert not skips_blocks(ArrayFilm(still, 2000.0), box, 0.0), "without noise pictures repeat by themselves"
    packed = [cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 60])[1] for frame in frames]
    squeezed = np.stack([cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) for data in packed])
    assert not skips_blocks(ArrayFilm(squeezed, 2000.0), box, 2.0)
    again = frames.copy()
    again[1::2] = again[0::2]
    assert not skips_blocks(ArrayFilm(again, 2000.0), box, 2.0), "whole frames that repeat are another matter"


def test_a_film_with_squares_left_out_is_less_sure() -> None:
    frames, _ = shifted(4)
    body = Body("plate", np.array([[40.0, 30.0], [120.0, 30.0], [120.0, 100.0], [40.0, 100.0]]))
    plain = track(ArrayFilm(frames, 2000.0), [body], n_still=STILL)
    for k in range(1, N):
        frames[k, 48:64, 48:96] = frames[k - 1, 48:64, 48:96] if k % 8 else frames[k, 48:64, 48:96]
    with pytest.warns(VisionWarning, match="repeat byte for byte"):
        result = track(ArrayFilm(frames, 2000.0), [body], n_still=STILL)
    assert result.info["skips_blocks"] and not plain.info["skips_blocks"]
    assert np.median(result.u_angle_rad[:5]) > 5.0 * np.median(plain.u_angle_rad[:5])
