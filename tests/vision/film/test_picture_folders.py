"""Folders of pictures: negative numbers in order, what is not of the series left out, gaps found all the same."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.command_line import run
from tests.vision.turning_bar import OUTLINES, smooth_turn, turning_bar
from vision import FilmError, VisionWarning
from vision.film.open import open_film


def write(folder: Path, names: list[str]) -> None:
    """Pictures whose grey level is their place in the list."""
    folder.mkdir(exist_ok=True)
    for k, name in enumerate(names):
        assert cv2.imwrite(str(folder / name), np.full((6, 9), k, np.uint8))


def order(folder: Path) -> list[int]:
    with open_film(folder) as film:
        return [int(film.read(k)[0, 0]) for k in range(film.n_frames)]


@pytest.mark.parametrize(
    "names",
    [
        [f"shot_{i:05d}.png" for i in range(-12, 0)],
        [f"shot_{i:05d}.png" for i in range(-5, 7)],
        [f"shot_{i}.png" for i in range(-12, 3)],
        [f"Img{i:06d}.png" for i in range(-12, 0)],
        [f"Img{i:06d}.png" for i in range(-5, 7)],
        [f"a{i}.png" for i in range(-3, 4)],
        [f"{i}.png" for i in range(-9, 0)],
        [f"cam (2026-11-29) {i:04d}.png" for i in range(-4, 5)],
        [f"2026-11-29_{i:03d}.png" for i in range(8)],
        [f"shot_{i:05d}.png" for i in range(-40, 1, 10)],
    ],
)
def test_numbers_below_zero_come_first(tmp_path: Path, names: list[str]) -> None:
    write(tmp_path / "f", names)
    assert order(tmp_path / "f") == list(range(len(names)))


def test_a_hyphen_after_a_word_is_said(tmp_path: Path) -> None:
    write(tmp_path / "f", [f"film-{i:04d}.png" for i in range(1, 9)])
    with pytest.warns(VisionWarning, match="minus of film-0001.png is read as a hyphen"):
        assert order(tmp_path / "f") == list(range(8))


@pytest.mark.parametrize("stray", ["background.png", "cal_7.png", "0_dark.png", "shot_0003 copy.png", "shot_0002.jpg"])
def test_a_picture_not_of_the_series_is_left_out_and_gaps_are_still_found(tmp_path: Path, stray: str) -> None:
    folder = tmp_path / "f"
    write(folder, [f"shot_{i:04d}.png" for i in range(6)])
    cv2.imwrite(str(folder / stray), np.full((6, 9), 99, np.uint8))
    with pytest.warns(VisionWarning, match=f"{stray} is left out"):
        assert order(folder) == list(range(6))
    (folder / "shot_0003.png").unlink()
    with pytest.warns(VisionWarning), pytest.raises(FilmError, match=r"missing between shot_0002\.png and shot_0004"):
        open_film(folder)


@pytest.mark.parametrize("names", [["a0.png", "b1.png"], ["x.png", "y.png", "z_1.png"], ["s_1.png", "s_01.png"]])
def test_what_is_no_series_is_refused(tmp_path: Path, names: list[str]) -> None:
    write(tmp_path / "f", names)
    with pytest.raises(FilmError, match="named differently|same number"):
        open_film(tmp_path / "f")


def test_the_working_folder_is_a_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: object) -> None:
    folder = tmp_path / "film"
    folder.mkdir()
    angles = smooth_turn(np.arange(24), 24)
    for k, frame in enumerate(turning_bar(angles)):
        assert cv2.imwrite(str(folder / f"shot_{k - 24:05d}.png"), frame)
    (tmp_path / "b.toml").write_text(OUTLINES)
    monkeypatch.chdir(folder)
    assert run("track", ".", "--bodies", "../b.toml", "--frame-rate", "2000") == 0
    table = np.genfromtxt(tmp_path / "film.angles.csv", delimiter=",", names=True)
    assert np.abs(table["bar_rad"] - angles).max() < np.radians(0.05)
    assert run("track", "/", "--bodies", "../b.toml") == 2
    assert "/: is no film" in capsys.readouterr().err  # type: ignore[attr-defined]


def test_a_file_of_several_pictures_is_refused(tmp_path: Path) -> None:
    (tmp_path / "f").mkdir()
    for k in range(3):
        assert cv2.imwritemulti(
            str(tmp_path / "f" / f"{k}.tif"), [np.full((6, 9), 10 * k + i, np.uint8) for i in range(4)]
        )
    with pytest.raises(FilmError, match=r"0\.tif: holds 4 pictures"):
        open_film(tmp_path / "f")


def test_a_jpeg_that_breaks_off_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "f"
    write(folder, [f"{k}.jpg" for k in range(4)])
    data = (folder / "2.jpg").read_bytes()
    (folder / "2.jpg").write_bytes(data[:-40])
    with open_film(folder) as film, pytest.raises(FilmError, match=r"2\.jpg: ends before its picture"):
        film.read(2)


def test_a_plus_is_a_sign(tmp_path: Path) -> None:
    write(tmp_path / "f", [f"Img{i:+06d}.png" for i in range(-4, 5)])
    assert order(tmp_path / "f") == list(range(9))
