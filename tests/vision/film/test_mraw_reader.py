"""MRAW films: every bit comes back, every region is the requested one, a film of the wrong size is refused."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import vision.film.mmap_window
from vision import FilmError
from vision.film.mraw import FilmHeader, MrawFilm, cihx_bytes, pack12, write_mraw
from vision.film.open import open_film

REAL_FILM = Path(__file__).resolve().parents[4] / "shared" / "data" / "ball_12bit.mraw"


def unpack12_by_bits(data: bytes) -> NDArray[np.int64]:
    """Independent reading: the bytes as one string of bits, cut every twelve."""
    bits = np.unpackbits(np.frombuffer(data, dtype=np.uint8))
    bits = bits[: bits.size // 12 * 12].reshape(-1, 12)
    return bits @ (1 << np.arange(11, -1, -1))


@settings(max_examples=60, deadline=None)
@given(
    bit_depth=st.sampled_from([8, 12, 16]),
    shape=st.tuples(st.integers(1, 4), st.integers(1, 9), st.integers(1, 11)),
    seed=st.integers(0, 2**32 - 1),
    data=st.data(),
)
def test_round_trip_and_regions(
    tmp_path_factory: pytest.TempPathFactory,
    bit_depth: int,
    shape: tuple[int, int, int],
    seed: int,
    data: st.DataObject,
) -> None:
    path = tmp_path_factory.mktemp("mraw") / "film.mraw"
    kind = np.uint8 if bit_depth == 8 else np.uint16
    frames = np.random.default_rng(seed).integers(0, 2**bit_depth, shape, dtype=kind)
    assert write_mraw(path, iter(frames), 2000.0, bit_depth=bit_depth, start_frame=-3) == shape[0]
    assert path.stat().st_size == (frames.size * bit_depth + 7) // 8
    with open_film(path) as film:
        assert (film.n_frames, film.height, film.width) == shape
        assert len(film) == len(list(film)) == shape[0]
        np.testing.assert_array_equal(film[-1], frames[-1])
        with pytest.raises(IndexError):
            film[shape[0]]
        for i in range(shape[0]):
            np.testing.assert_array_equal(film.read(i), frames[i])
        y0 = data.draw(st.integers(0, shape[1] - 1))
        y1 = data.draw(st.integers(y0 + 1, shape[1]))
        x0 = data.draw(st.integers(0, shape[2] - 1))
        x1 = data.draw(st.integers(x0 + 1, shape[2]))
        i = data.draw(st.integers(0, shape[0] - 1))
        np.testing.assert_array_equal(film.read_region(i, y0, y1, x0, x1), frames[i, y0:y1, x0:x1])
        np.testing.assert_allclose(film.frame_time_s, (np.arange(shape[0]) - 3) / 2000.0)


@given(st.lists(st.integers(0, 4095), min_size=2, max_size=40).filter(lambda v: len(v) % 2 == 0))
def test_pack12_against_bits(values: list[int]) -> None:
    packed = pack12(np.array(values, dtype=np.uint16))
    np.testing.assert_array_equal(unpack12_by_bits(packed), values)


def test_times_of_a_saved_part(tmp_path: Path) -> None:
    """Every third frame saved, from frame 600 after the trigger: times in units of the recording rate."""
    path = tmp_path / "part.mraw"
    header = FilmHeader(6, 4, 3, 8, 8, frame_rate_hz=3000.0, exposure_s=1e-4, start_frame=600, frame_step=3)
    path.write_bytes(bytes(range(72)))
    path.with_suffix(".cihx").write_bytes(cihx_bytes(header))
    with open_film(path) as film:
        np.testing.assert_allclose(film.frame_time_s, [0.20005, 0.20105, 0.20205])
        assert film.read(2)[3, 5] == 71


def test_bit_side_higher_is_shifted(tmp_path: Path) -> None:
    path = tmp_path / "high.mraw"
    values = np.array([[1, 2, 4095], [7, 0, 256]], dtype="<u2")
    path.write_bytes((values << 4).tobytes())
    path.with_suffix(".cihx").write_bytes(cihx_bytes(FilmHeader(3, 2, 1, 16, 12, "higher")))
    with open_film(path) as film:
        assert film.bit_depth == 12
        np.testing.assert_array_equal(film.read(0), values)


@pytest.mark.parametrize("bit_depth", [8, 12, 16])
def test_cut_short_is_refused_with_both_sizes(tmp_path: Path, bit_depth: int) -> None:
    path = tmp_path / "film.mraw"
    frames = np.arange(5 * 6 * 8, dtype=np.uint8).reshape(5, 6, 8).astype(np.uint16)
    write_mraw(path, frames, 2000.0, bit_depth=bit_depth)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    with pytest.raises(FilmError) as caught:
        open_film(path)
    assert str(len(whole)) in str(caught.value) and str(len(whole) - 1) in str(caught.value)
    assert "cut short" in str(caught.value) and "\n" not in str(caught.value)
    with open_film(path, allow_truncated=True) as film:
        assert film.n_frames == 4
        np.testing.assert_array_equal(film.read(3), frames[3])
    path.write_bytes(whole + b"\0")
    with pytest.raises(FilmError, match="does not belong"):
        open_film(path, allow_truncated=True)


def test_missing_parts_are_named(tmp_path: Path) -> None:
    path = tmp_path / "film.mraw"
    path.write_bytes(b"\0" * 48)
    with pytest.raises(FilmError, match=r"film\.cihx"):
        open_film(path)
    (tmp_path / "other.cihx").write_bytes(cihx_bytes(FilmHeader(8, 6, 1, 8, 8)))
    with pytest.raises(FilmError, match=r"other\.mraw"):
        open_film(tmp_path / "other.cihx")
    path.write_bytes(b"")
    path.with_suffix(".cihx").write_bytes(cihx_bytes(FilmHeader(8, 6, 1, 8, 8)))
    with pytest.raises(FilmError, match="0 bytes"):
        open_film(path)


def test_out_of_bounds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "film.mraw"
    write_mraw(path, np.zeros((2, 6, 8), dtype=np.uint8), 2000.0)
    with open_film(path) as film:
        with pytest.raises(FilmError, match="frame 2"):
            film.read(2)
        with pytest.raises(FilmError, match="region"):
            film.read_region(0, 0, 7, 0, 8)
        with pytest.raises(FilmError, match="frame -1"):
            film.read(-1)


def resident_bytes() -> int:
    """Memory of this process that is in use now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads Linux's account of memory in use")
def test_memory_does_not_grow_with_the_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sparse film of 20 GB: regions of 120 frames touch 50 MB of it, of which only the window stays."""
    monkeypatch.setattr(vision.film.mmap_window, "WINDOW_BYTES", 4_000_000)
    path = tmp_path / "long.mraw"
    n = 20_000_000_000 // (1280 * 1024 * 3 // 2)
    with path.open("wb") as file:
        try:
            file.truncate(n * 1280 * 1024 * 3 // 2)
        except OSError as error:
            pytest.skip(f"this disk makes no sparse file of 20 GB ({error})")
        file.seek(-3, os.SEEK_END)
        file.write(pack12(np.array([0x123, 0xABC], dtype=np.uint16)))
    path.with_suffix(".cihx").write_bytes(cihx_bytes(FilmHeader(1280, 1024, n, 12, 12, frame_rate_hz=2000.0)))
    before = most = resident_bytes()
    with open_film(path) as film:
        for index in [*range(60), *range(60, n, n // 60)]:
            assert not film.read_region(index, 300, 520, 400, 620).any()
            most = max(most, resident_bytes())
        region = film.read_region(n - 1, 1000, 1024, 1200, 1280)
        assert region[-1, -2:].tolist() == [0x123, 0xABC]
    assert most - before < 20_000_000


@pytest.mark.skipif(not REAL_FILM.exists(), reason="the real Photron film is not shipped (see ../shared/data)")
def test_real_photron_film() -> None:
    """A film of a FASTCAM Nova S16: geometry and times from its header, pixels against an independent unpacking."""
    with open_film(REAL_FILM) as film:
        assert isinstance(film, MrawFilm)
        assert (film.n_frames, film.height, film.width, film.bit_depth) == (15, 384, 384, 12)
        assert film.frame_rate_hz == 30000.0 and film.exposure_s == pytest.approx(20e-6)
        assert film.frame_time_s is not None
        assert film.frame_time_s[0] == pytest.approx(52 / 30000 + 10e-6)
        bits = unpack12_by_bits(REAL_FILM.read_bytes()).reshape(15, 384, 384)
        for i in (0, 7, 14):
            np.testing.assert_array_equal(film.read(i), bits[i])
        np.testing.assert_array_equal(film.read_region(9, 31, 200, 33, 151), bits[9, 31:200, 33:151])
        # neighbouring pixels of a real picture are alike; a wrong nibble order would scatter them
        frame = film.read(0).astype(float)
        assert np.median(np.abs(np.diff(frame, axis=1))) < 0.05 * np.ptp(frame)
