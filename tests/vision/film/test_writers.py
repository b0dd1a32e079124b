"""Writers refuse what does not fit and leave nothing that looks like a film."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from vision import FilmError
from vision.film.mraw import write_mraw
from vision.film.open import open_film

GOOD = np.zeros((2, 6, 8), dtype=np.uint8)


def broken() -> Iterator[NDArray[np.uint8]]:
    """A camera that fails after one frame."""
    yield GOOD[0]
    raise RuntimeError("camera unplugged")


def test_an_old_film_survives_a_failure(tmp_path: Path) -> None:
    path = tmp_path / "film.mraw"
    write_mraw(path, GOOD + 7, 2000.0)
    with pytest.raises(RuntimeError):
        write_mraw(path, broken(), 1000.0)
    with open_film(path) as film:
        assert film.frame_rate_hz == 2000.0 and film.read(1).min() == 7
    assert sorted(p.name for p in tmp_path.iterdir()) == ["film.cihx", "film.mraw"]


def test_a_film_in_use_keeps_its_header(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows refuses to replace an open file: the old film must stay readable."""
    path = tmp_path / "film.mraw"
    write_mraw(path, GOOD + 7, 2000.0)
    replace = os.replace

    def refuse(source: Path, target: Path) -> None:
        if target == path:
            raise PermissionError(13, "in use")
        replace(source, target)

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(FilmError, match="in use"):
        write_mraw(path, GOOD, 1000.0)
    with open_film(path) as film:
        assert film.frame_rate_hz == 2000.0 and film.read(0).min() == 7
    assert sorted(p.name for p in tmp_path.iterdir()) == ["film.cihx", "film.mraw"]


@pytest.mark.parametrize(
    ("frames", "bit_depth", "words"),
    [
        (np.zeros((0, 6, 8), dtype=np.uint8), 8, "no frames"),
        (np.full((1, 6, 8), 300, dtype=np.uint16), 8, "300"),
        (np.full((1, 6, 8), 4096, dtype=np.uint16), 12, "4096"),
        (np.full((1, 6, 8), -1, dtype=np.int16), 16, "-1"),
        (np.full((1, 6, 8), 0.5), 8, "whole"),
        (np.zeros((1, 6, 8, 3), dtype=np.uint8), 8, "shape"),
        (GOOD, 10, "bit depth 10"),
    ],
)
def test_frames_that_do_not_fit(tmp_path: Path, frames: NDArray[np.generic], bit_depth: int, words: str) -> None:
    with pytest.raises(FilmError, match=words):
        write_mraw(tmp_path / "film.mraw", frames, 2000.0, bit_depth=bit_depth)
    assert list(tmp_path.iterdir()) == []


def test_paths_and_sizes(tmp_path: Path) -> None:
    with pytest.raises(FilmError, match="cannot be written"):
        write_mraw(tmp_path / "absent" / "film.mraw", GOOD, 2000.0)
    with pytest.raises(FilmError, match=r"\.mraw"):
        write_mraw(tmp_path / "film.raw", GOOD, 2000.0)
    with pytest.raises(FilmError, match="frame 1 has shape"):
        write_mraw(tmp_path / "film.mraw", iter([GOOD[0], GOOD[0].T]), 2000.0)
    with pytest.raises(FilmError, match="frame rate"):
        write_mraw(tmp_path / "film.mraw", GOOD, 0.0)
