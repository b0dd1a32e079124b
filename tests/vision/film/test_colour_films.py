"""Colour films by a chosen channel, in every format that has colour."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from vision import FilmError
from vision.film.mraw import write_mraw
from vision.film.open import open_film
from vision.film.source import CHANNELS

COLOUR = np.random.default_rng(3).integers(0, 256, (4, 32, 48, 3), dtype=np.uint8)  # blue, green, red


def uncompressed_avi(path: Path, frames: np.ndarray) -> None:
    """24-bit AVI as Windows programs write it: rows from the bottom up."""
    n, height, width = frames.shape[:3]
    chunk = lambda name, data: name + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2)  # noqa: E731
    listed = lambda name, data: chunk(b"LIST", name + data)  # noqa: E731
    strh = b"vids" + b"DIB " + struct.pack("<IHHIIIIIIIIhhhh", 0, 0, 0, 0, 1, 500, 0, n, 0, 0, 0, 0, 0, width, height)
    strf = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, 0, 0, 0, 0, 0)
    head = listed(b"hdrl", chunk(b"avih", bytes(56)) + listed(b"strl", chunk(b"strh", strh) + chunk(b"strf", strf)))
    movi = listed(b"movi", b"".join(chunk(b"00db", frame[::-1].tobytes()) for frame in frames))
    path.write_bytes(chunk(b"RIFF", b"AVI " + head + movi))


def colour_film(folder: Path, kind: str) -> Path:
    if kind == "avi":
        uncompressed_avi(folder / "film.avi", COLOUR)
        return folder / "film.avi"
    if kind == "pages":
        assert cv2.imwritemulti(str(folder / "film.tif"), list(COLOUR))
        return folder / "film.tif"
    (folder / "film").mkdir()
    for k, frame in enumerate(COLOUR):
        assert cv2.imwrite(str(folder / "film" / f"film_{k:03d}.png"), frame)
    return folder / "film"


@pytest.mark.parametrize("kind", ["avi", "pages", "folder"])
def test_a_channel_of_a_colour_film(tmp_path: Path, kind: str) -> None:
    path = colour_film(tmp_path, kind)
    for k, channel in enumerate(CHANNELS):
        with open_film(path, channel=channel) as film:
            for i in (0, 3, 1):
                np.testing.assert_array_equal(film.read(i), COLOUR[i, ..., k])
                np.testing.assert_array_equal(film.read_region(i, 3, 20, 5, 40), COLOUR[i, 3:20, 5:40, k])
    with open_film(path) as film:
        grey = COLOUR[2] @ np.array([0.114, 0.587, 0.299])
        np.testing.assert_allclose(film.read(2), grey, atol=0.6)


@pytest.mark.filterwarnings("ignore:.*strong JPEG compression")
def test_a_channel_of_motion_jpeg(tmp_path: Path) -> None:
    """Coloured bands survive JPEG well enough to tell the channels apart."""
    path, bands = tmp_path / "film.avi", np.zeros((48, 64, 3), dtype=np.uint8)
    for k in range(3):
        bands[16 * k : 16 * k + 16, :, k] = 200
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for _ in range(3):
        writer.write(bands)
    writer.release()
    for k, channel in enumerate(CHANNELS):
        with open_film(path, channel=channel) as film:
            means = film.read(1).reshape(3, 16, 64)[:, 4:12].mean(axis=(1, 2))
            assert means[k] > 180 and np.delete(means, k).max() < 30


def test_what_has_no_such_channel_is_refused(tmp_path: Path) -> None:
    write_mraw(tmp_path / "film.mraw", COLOUR[..., 0], 1000.0)
    with pytest.raises(FilmError, match="read in grey; leave the channel"):
        open_film(tmp_path / "film.mraw", channel="red")
    with pytest.raises(FilmError, match="'infrared' is not known; choose blue, green, red"):
        open_film(colour_film(tmp_path, "pages"), channel="infrared")
