"""Phantom films: pixels, direction of the rows, times, and refusals; against pims where it is installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.vision.film.cine_file import write_cine
from vision.errors import FilmError
from vision.film.open import open_film

RNG = np.random.default_rng(4)
GREY12 = RNG.integers(0, 4096, (7, 18, 26), dtype=np.uint16)
GREY8 = RNG.integers(0, 256, (7, 18, 25), dtype=np.uint8)


@pytest.mark.parametrize(("frames", "packed", "depth"), [(GREY8, False, 8), (GREY12, False, 12), (GREY12, True, 12)])
def test_pixels_and_regions(tmp_path: Path, frames: np.ndarray, packed: bool, depth: int) -> None:
    path = tmp_path / "film.cine"
    write_cine(path, frames, packed=packed)
    with open_film(path) as film:
        assert (film.n_frames, film.height, film.width, film.bit_depth) == (*frames.shape, depth)
        for i in (0, 6, 3):
            np.testing.assert_array_equal(film.read(i), frames[i])
            np.testing.assert_array_equal(film.read_region(i, 3, 12, 5, 18), frames[i, 3:12, 5:18])
        with pytest.raises(FilmError, match="frame 7"):
            film.read(7)


@pytest.mark.parametrize("stamps", [True, False])
def test_times_count_from_the_trigger(tmp_path: Path, stamps: bool) -> None:
    path = tmp_path / "film.cine"
    write_cine(path, GREY8, stamps=stamps, first=-3, rate=7500, shutter_ns=20_000)
    with open_film(path) as film:
        assert film.frame_rate_hz == 7500.0 and film.exposure_s == pytest.approx(2e-5)
        np.testing.assert_allclose(film.frame_time_s, (np.arange(7) - 3) / 7500.0 + 1e-5, atol=1e-9)


def test_the_same_as_pims(tmp_path: Path) -> None:
    pims = pytest.importorskip("pims")
    path = tmp_path / "film.cine"
    for frames, packed in ((GREY8, False), (GREY12, False), (GREY12, True)):
        write_cine(path, frames, packed=packed)
        other = pims.Cine(str(path))
        with open_film(path) as film:
            assert other.frame_rate == film.frame_rate_hz and len(other) == film.n_frames
            for i in range(7):
                np.testing.assert_array_equal(film.read(i), np.asarray(other._get_frame(i)))
        other.close()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"compression": 2}, "colour or compressed"),
        ({"cfa": 3}, "colour filter 3"),
        ({"packing": 256}, "not linear"),
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
    with pytest.raises(FilmError, match="image 5 of 7 lies beyond .*--allow-truncated"):
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


def test_damage_is_refused_or_harmless(tmp_path: Path) -> None:
    """Bytes of the headers changed at random: an error of ours, or a film that can be read."""
    path = tmp_path / "film.cine"
    write_cine(path, GREY8)
    whole = bytearray(path.read_bytes())
    rng = np.random.default_rng(1)
    for _ in range(300):
        damaged = bytearray(whole)
        for at in rng.integers(0, len(whole) - GREY8.size, 3):
            damaged[at] = int(rng.integers(0, 256))
        path.write_bytes(damaged)
        try:
            with open_film(path) as film:
                film.read(film.n_frames - 1)
                assert film.frame_time_s is None or len(film.frame_time_s) == film.n_frames
        except FilmError:
            pass
