"""TIFF pages and picture folders: order, orientation, depth, and refusals."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from vision import FilmError
from vision.film.open import open_film

FRAMES = np.random.default_rng(3).integers(0, 4096, (12, 18, 26), dtype=np.uint16)


@pytest.mark.parametrize("ending", [".jpg", ".JPEG"])
def test_a_folder_of_jpeg_knows_its_compression(tmp_path: Path, ending: str) -> None:
    smooth = cv2.GaussianBlur((FRAMES >> 4).astype(np.uint8), (0, 0), 2.0)
    for i, frame in enumerate(smooth):
        data = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
        (tmp_path / f"shot_{i:03d}{ending}").write_bytes(data.tobytes())
    with open_film(tmp_path) as film:
        assert (film.n_frames, film.height, film.width, film.bit_depth) == (12, 18, 26, 8)
        np.testing.assert_allclose(film.read(7).astype(float), smooth[7], atol=12.0)
        assert film.compression is not None and film.compression.steps is not None
        assert film.compression.steps[0, 0] == 6.0  # of T.81's table at quality 80
    (tmp_path / f"shot_005{ending}").write_bytes(b"no picture")
    with open_film(tmp_path) as film, pytest.raises(FilmError, match="shot_005"):
        film.read(5)


def test_refusals(tmp_path: Path) -> None:
    with pytest.raises(FilmError, match="holds no picture"):
        open_film(tmp_path)
    cv2.imwrite(str(tmp_path / "a0.png"), FRAMES[0])
    cv2.imwrite(str(tmp_path / "a1.png"), FRAMES[1][:10])
    with open_film(tmp_path) as film, pytest.raises(FilmError, match=r"a1\.png: 26 x 10"):
        film.read(1)
    (tmp_path / "b.tif").write_text("no picture")
    with pytest.raises(FilmError, match=r"b\.tif"):
        open_film(tmp_path / "b.tif")
