"""A short run of ``benchmarks/fuzz_readers.py``: damaged films are refused in one line or read right."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fuzz_readers import fuzz
from vision.errors import FilmError
from vision.film.avi_writer import write_avi
from vision.film.open import open_film


def test_damaged_films_are_refused_or_read_right(tmp_path: Path) -> None:
    tallies = fuzz(tmp_path, 60, 7)
    assert sum(tally.same for tally in tallies.values()) > 5
    for name, tally in tallies.items():
        assert not tally.wrong, (name, tally.wrong)
        assert tally.refused > 0, name
        assert tally.largest < 1.0, name


def test_jpeg_that_claims_to_be_huge_is_not_decoded(tmp_path: Path) -> None:
    """A picture of 65500 x 65500 would take 4 GB; its header is checked first."""
    path = tmp_path / "film.avi"
    frame = np.random.default_rng(1).integers(0, 255, (48, 64), dtype=np.uint8)
    write_avi(path, [frame, frame], 25.0)
    data = bytearray(path.read_bytes())
    at = data.index(b"\xff\xc0")
    data[at + 5 : at + 9] = b"\xff\xdc\xff\xdc"
    path.write_bytes(bytes(data))
    with pytest.raises(FilmError, match="64 x 48"):
        open_film(path)


def test_memory_is_a_fixed_number_of_frames(tmp_path: Path) -> None:
    """Of luma only stored packets are held by Python, a colour channel with its picture; decoded frames by FFmpeg."""
    path = tmp_path / "film.avi"
    rng = np.random.default_rng(4)
    write_avi(path, [rng.integers(0, 255, (240, 320, 3), dtype=np.uint8) for _ in range(9)], 25.0)
    for channel, most in ((None, 1.5), ("green", 5.2)):
        with open_film(path, channel=channel) as film:
            # what is loaded at first use is not the film's doing
            film.read(8)
        tracemalloc.start()
        try:
            with open_film(path, channel=channel) as film:
                for index in (0, 1, 2, 7, 3):
                    assert film.read(index).shape == (240, 320)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < most * 240 * 320


@pytest.mark.parametrize("quality", [None, 95])
def test_avi_cut_short_is_read_to_its_last_whole_frame_on_request(tmp_path: Path, quality: int | None) -> None:
    path = tmp_path / "film.avi"
    frames = np.random.default_rng(2).integers(90, 160, (7, 40, 56), dtype=np.uint8)
    write_avi(path, frames, 25.0, quality=quality)
    whole = path.read_bytes()
    chunks = [i for i in range(len(whole)) if whole[i : i + 4] == b"00dc"]
    path.write_bytes(whole[: chunks[4] + 100])
    with pytest.raises(FilmError, match="cut short"):
        open_film(path)
    for share in (0.02, 0.5, 0.97):
        (other := tmp_path / "other.avi").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(FilmError, match=r"^[^\n]*other\.avi[^\n]*$"):
            open_film(other)
    with open_film(path, allow_truncated=True) as film:
        assert film.n_frames == 4
        np.testing.assert_allclose(film.read(3).astype(int), frames[3].astype(int), atol=0 if quality is None else 30)
    path.write_bytes(whole[: chunks[0] + 3])
    with pytest.raises(FilmError):
        open_film(path, allow_truncated=True)
