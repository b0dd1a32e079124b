"""Phantom films: pixels, direction of the rows, times, and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.vision.film.cine_file import write_cine
from vision import FilmError, VisionWarning
from vision.film.open import open_film
from vision.film.source import CHANNELS

RNG = np.random.default_rng(4)
GREY12 = RNG.integers(0, 4096, (7, 18, 26), dtype=np.uint16)
GREY8 = RNG.integers(0, 256, (7, 18, 25), dtype=np.uint8)


@pytest.mark.parametrize(("frames", "packed", "depth"), [(GREY8, 0, 8), (GREY12, 0, 12), (GREY12, 12, 12)])
def test_pixels_and_regions(tmp_path: Path, frames: np.ndarray, packed: int, depth: int) -> None:
    path = tmp_path / "film.cine"
    write_cine(path, frames, packed=packed)
    with open_film(path) as film:
        assert (film.n_frames, film.height, film.width, film.bit_depth) == (*frames.shape, depth)
        for i in (0, 6, 3):
            np.testing.assert_array_equal(film.read(i), frames[i])
            np.testing.assert_array_equal(film.read_region(i, 3, 12, 5, 18), frames[i, 3:12, 5:18])
        with pytest.raises(FilmError, match="frame 7"):
            film.read(7)


def test_ten_bit_codes_are_read_linear(tmp_path: Path) -> None:
    codes = np.random.default_rng(8).permutation(1024).astype(np.uint16).reshape(1, 32, 32)
    path = tmp_path / "film.cine"
    write_cine(path, codes, packed=10)
    with open_film(path) as film:
        grey = film.read(0)
        assert film.bit_depth == 12 and grey.dtype == np.uint16
        np.testing.assert_array_equal(film.read_region(0, 3, 12, 5, 18), grey[3:12, 5:18])
    by_code = grey.ravel()[np.argsort(codes.ravel())].astype(float)
    assert by_code[64] == 64 and by_code[1014] == 4064 and np.all(by_code[1015:] == 4095)
    assert np.all(np.diff(by_code) >= 0)
    # ITU-R BT.709: the signal of a light, by its printed formula
    light = (by_code[65:1014] - 64.0) / 4000.0
    signal = np.where(light < 0.018, 4.5 * light, 1.099 * light**0.45 - 0.099)
    np.testing.assert_allclose(64.0 + 950.0 * signal, np.arange(65, 1014), atol=0.55)


@pytest.mark.parametrize(("kind", "depth"), [(np.uint8, 8), (np.uint16, 12)])
def test_a_channel_of_interpolated_colour(tmp_path: Path, kind: type, depth: int) -> None:
    colour = np.random.default_rng(9).integers(0, 2**depth, (3, 18, 24, 3)).astype(kind)
    path = tmp_path / "film.cine"
    write_cine(path, colour, bits=depth, cfa=3)
    for k, channel in enumerate(CHANNELS):
        with open_film(path, channel=channel) as film:
            assert (film.height, film.width, film.bit_depth) == (18, 24, depth)
            np.testing.assert_array_equal(film.read(2), colour[2, ..., k])
            np.testing.assert_array_equal(film.read_region(1, 3, 12, 5, 18), colour[1, 3:12, 5:18, k])
    with open_film(path) as film:
        np.testing.assert_allclose(film.read(1), colour[1] @ np.array([0.114, 0.587, 0.299]), atol=0.6)
    write_cine(path, GREY8)
    with pytest.raises(FilmError, match=r"grey film; leave the channel \(red\) out"):
        open_film(path, channel="red")


@pytest.mark.parametrize("stamps", [True, False])
def test_times_count_from_the_trigger(tmp_path: Path, stamps: bool) -> None:
    path = tmp_path / "film.cine"
    write_cine(path, GREY8, stamps=stamps, first=-3, rate=7500, shutter_ns=20_000)
    with open_film(path) as film:
        assert film.frame_rate_hz == 7500.0 and film.exposure_s == pytest.approx(2e-5)
        np.testing.assert_allclose(film.frame_time_s, (np.arange(7) - 3) / 7500.0 + 1e-5, atol=1e-9)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"compression": 2}, "compressed .kind 2."),
        ({"cfa": 3}, "colour filter 3"),
        ({"packing": 512}, "packed as 512 with 8 bit"),
        ({"flip_v": 1}, "flipped for display"),
        ({"missing_mark": 1}, "lack their mark"),
    ],
)
def test_what_is_not_known_is_refused(tmp_path: Path, changed: dict[str, int], words: str) -> None:
    path = tmp_path / "film.cine"
    write_cine(path, GREY8, **changed)
    with pytest.raises(FilmError, match=words):
        open_film(path)


def test_a_film_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "film.cine"
    write_cine(path, GREY8)
    whole = path.read_bytes()
    path.write_bytes(whole[:-700])
    with pytest.raises(FilmError, match="image 5 of 7 lies beyond .*`allow_truncated`"):
        open_film(path)
    with open_film(path, allow_truncated=True) as film:
        assert film.n_frames == 5 and len(film.frame_time_s) == 5
        np.testing.assert_array_equal(film.read(4), GREY8[4])
    for size in (0, 10, 60, 200, 1500, 12_120):
        path.write_bytes(whole[:size])
        with pytest.raises(FilmError):
            open_film(path, allow_truncated=True)
    path.write_bytes(b"no film at all" * 500)
    with pytest.raises(FilmError, match=r"no \.cine film"):
        open_film(path)


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_values_in_either_half_of_16_bit_are_the_same_grey(tmp_path: Path, bits: int) -> None:
    frames = np.random.default_rng(bits).integers(0, 2**bits, (3, 6, 8), dtype=np.uint16)
    frames[0, 0, :2] = 1, 2**bits - 1
    for shift in (0, 16 - bits):
        write_cine(tmp_path / "film.cine", frames << shift, bits=bits)
        with open_film(tmp_path / "film.cine") as film:
            assert film.bit_depth == bits
            for k in (2, 0):
                np.testing.assert_array_equal(film.read(k), frames[k])
            np.testing.assert_array_equal(film.read_region(1, 1, 5, 2, 7), frames[1, 1:5, 2:7])
    frames[1, 2, 3] = 2**15 + 1
    write_cine(tmp_path / "film.cine", frames, bits=bits)
    with (
        pytest.warns(VisionWarning, match=f"says {bits} bit, its values fill 16"),
        open_film(tmp_path / "film.cine") as film,
    ):
        assert film.bit_depth == 16
        np.testing.assert_array_equal(film.read(1), frames[1])
