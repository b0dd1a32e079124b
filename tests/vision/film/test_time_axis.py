"""Films whose frames are not the times they seem: gaps, two series, cut stacks, headers that contradict themselves."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.vision.turning_bar import write_video
from vision import FilmError, VisionWarning
from vision.film.mraw import FilmHeader, cihx_bytes
from vision.film.open import open_film
from vision.film.source import ArrayFilm, Repeats
from vision.film.time_scale import frame_times_at_rate

FRAMES = np.random.default_rng(3).integers(0, 256, (12, 20, 30), dtype=np.uint8)


def write_folder(folder: Path, names: list[str]) -> None:
    for frame, name in zip(FRAMES, names, strict=False):
        assert cv2.imwrite(str(folder / name), frame)


def test_a_gap_in_the_numbers_is_refused(tmp_path: Path) -> None:
    write_folder(tmp_path, [f"shot_{i:04d}.png" for i in (0, 1, 2, 5, 6)])
    with pytest.raises(FilmError, match=r"missing between shot_0002\.png and shot_0005\.png"):
        open_film(tmp_path)
    with open_film(tmp_path, allow_truncated=True) as film:
        assert film.n_frames == 3


def test_a_tiff_stack_cut_short_is_refused_or_read_on_request(tmp_path: Path) -> None:
    path = tmp_path / "film.tif"
    assert cv2.imwritemulti(str(path), list(FRAMES))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.7 * len(whole))])
    with pytest.raises(FilmError, match="allow_truncated"):
        open_film(path)
    with open_film(path, allow_truncated=True) as film:
        assert 4 <= film.n_frames < 12
        np.testing.assert_array_equal(film.read(film.n_frames - 1), FRAMES[film.n_frames - 1])


def write_mraw_with(path: Path, header: FilmHeader, values: np.ndarray) -> None:
    path.write_bytes(values.tobytes())
    path.with_suffix(".cihx").write_bytes(cihx_bytes(header))


def test_a_header_that_contradicts_itself_gives_no_times(tmp_path: Path) -> None:
    """Four frames, every 2500th of 400 recorded ones."""
    path = tmp_path / "beam.mraw"
    header = FilmHeader(6, 4, 4, 8, 8, frame_rate_hz=4000.0, frame_step=2500, recorded_frames=400)
    write_mraw_with(path, header, np.zeros(96, dtype=np.uint8))
    with pytest.warns(VisionWarning, match="400 were recorded"), open_film(path) as film:
        assert film.frame_time_s is None


@pytest.mark.parametrize(("side", "shift"), [("higher", 0), ("lower", 4)])
def test_bits_on_the_wrong_side_are_refused(tmp_path: Path, side: str, shift: int) -> None:
    path = tmp_path / "film.mraw"
    values = np.array([[1, 2, 4095], [7, 0, 256]], dtype="<u2") << shift
    write_mraw_with(path, FilmHeader(3, 2, 1, 16, 12, side), values)
    with pytest.raises(FilmError, match="EffectiveBit Side"):
        open_film(path)


def test_repeated_frames_are_found() -> None:
    frames = FRAMES.copy()
    frames[5] = frames[4]
    frames[8] = frames[9] = 255
    repeats = Repeats(ArrayFilm(frames), (2, 18, 3, 25))
    assert [i for i in range(12) if repeats.is_repeat(i)] == [5]
    assert [i for i in range(0, 12, 5) if repeats.is_repeat(i)] == [5]


@pytest.mark.parametrize("kind", ["film.avi", "film.tif", "folder"])
def test_a_header_beside_an_exported_film_gives_its_times(tmp_path: Path, kind: str) -> None:
    """Photron's viewer writes one beside AVI, TIFF and pictures as well: here every third frame from -30 on."""
    path = tmp_path / kind
    if kind == "film.avi":
        write_video(path, FRAMES, rate=25)
    elif kind == "film.tif":
        assert cv2.imwritemulti(str(path), list(FRAMES))
    else:
        path.mkdir()
        write_folder(path, [f"film{i:06d}.png" for i in range(12)])
    header = FilmHeader(30, 20, 12, 24, 8, frame_rate_hz=2000.0, exposure_s=1e-4, start_frame=-30, frame_step=3)
    beside = path / "film.cihx" if path.is_dir() else path.with_suffix(".cihx")
    beside.write_bytes(cihx_bytes(header).replace(b"Mraw", b"Avi "))
    with open_film(path) as film:
        assert film.has_camera_times and film.exposure_s == 1e-4
        np.testing.assert_allclose(film.frame_time_s, (-30 + 3 * np.arange(12)) / 2000.0 + 5e-5)
        for wrong in (2000.0, 600.0):
            with pytest.raises(FilmError, match=f"{wrong:g} frames/s is stated, the camera's own times say 666.66"):
                frame_times_at_rate(film, wrong)
    beside.write_bytes(cihx_bytes(FilmHeader(30, 20, 13, 24, 8, frame_rate_hz=2000.0)))
    with (
        pytest.warns(VisionWarning, match="describes 13 frames of 30 x 20; .* has 12 of 30 x 20"),
        open_film(path) as film,
    ):
        assert not film.has_camera_times
