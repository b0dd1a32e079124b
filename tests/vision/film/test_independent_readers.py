"""Every reader beside another one: OpenCV, Pillow, tifffile."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from vision import VisionWarning
from vision.film.open import open_film

N, HEIGHT, WIDTH = 9, 48, 80


def frames_of(bits: int) -> np.ndarray:
    """A pattern that shifts by its own step in each frame, brighter to the right, darker downwards."""
    rng = np.random.default_rng(bits)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    base = 0.2 + 0.5 * x / WIDTH - 0.15 * y / HEIGHT + 0.1 * rng.random((HEIGHT, WIDTH))
    return np.stack([np.roll(base, 2 * i, axis=1) * (2**bits - 1) for i in range(N)]).astype(
        f"u{1 if bits == 8 else 2}"
    )


def read_all(path: Path) -> np.ndarray:
    with warnings.catch_warnings(action="ignore", category=VisionWarning), open_film(path) as film:
        return np.stack([film.read(i) for i in range(film.n_frames)])


def encoded(path: Path, codec: str, pixels: str, frames: np.ndarray) -> None:
    """A film written by PyAV."""
    stored = "gray16le" if frames.dtype == np.uint16 else "gray"
    with av.open(str(path), "w") as container:
        try:
            stream = container.add_stream(codec, rate=25)
        except av.error.FFmpegError as error:
            pytest.skip(f"PyAV has no encoder {codec} here ({error})")
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixels
        for frame in frames:
            picture = av.VideoFrame.from_ndarray(frame, format=stored)
            container.mux(stream.encode(picture if pixels == stored else picture.reformat(format=pixels)))
        container.mux(stream.encode())


@pytest.mark.parametrize(
    ("name", "codec", "pixels", "off"),
    [
        ("film.avi", "rawvideo", "gray", 0),
        ("film.avi", "ffv1", "gray", 0),
        ("film.avi", "png", "gray", 0),
        ("film.avi", "mjpeg", "yuvj420p", 1),
        ("film.avi", "mpeg4", "yuv420p", 1),
        ("film.mp4", "libx264", "yuv420p", 1),  # with frames that are stored out of order
        ("film.mkv", "libx265", "yuv420p", 1),
    ],
)
def test_videos_are_what_opencv_decodes(tmp_path: Path, name: str, codec: str, pixels: str, off: int) -> None:
    path = tmp_path / name
    encoded(path, codec, pixels, frames_of(8))
    capture, other = cv2.VideoCapture(str(path)), []
    while (frame := capture.read())[0]:
        other.append(cv2.cvtColor(frame[1], cv2.COLOR_BGR2GRAY))
    capture.release()
    own = read_all(path).astype(float)
    assert own.shape == np.shape(other) == (N, HEIGHT, WIDTH)
    with warnings.catch_warnings(action="ignore", category=VisionWarning), open_film(path) as film:
        white = film.white_grey
    # luma of limited range runs from 16 to 235; OpenCV spreads it
    assert white == (235 if pixels == "yuv420p" else None)
    spread = own if white is None else np.clip((own - 16.0) * 255.0 / 219.0, 0.0, 255.0)
    assert np.abs(spread - other).max() <= off + 0.5


@pytest.mark.parametrize(("pixels", "bits"), [("gray16le", 16), ("gray10le", 10), ("yuv420p10le", 10)])
def test_a_deeper_video_keeps_its_bits(tmp_path: Path, pixels: str, bits: int) -> None:
    path = tmp_path / "film.mkv"
    encoded(path, "ffv1", pixels, frames_of(16))
    with open_film(path) as film:
        assert (film.bit_depth, film.read(4).dtype) == (bits, np.uint16)
        grey = frames_of(16)[4] / 2.0 ** (16 - bits)
        if film.white_grey is not None:
            grey = 64.0 + grey * (940.0 - 64.0) / 1023.0
            assert film.white_grey == 940
        assert np.abs(film.read(4) - grey).max() <= 3.0  # FFmpeg drops the lower bits, with or without a dither


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("options", [{}, {"bigtiff": True}, {"byteorder": ">"}, {"compression": "zlib"}])
def test_pages_that_tifffile_wrote(tmp_path: Path, bits: int, options: dict[str, Any]) -> None:
    path, frames = tmp_path / "film.tif", frames_of(bits)
    byteorder = options.get("byteorder")
    with tifffile.TiffWriter(path, bigtiff=options.get("bigtiff", False), byteorder=byteorder) as writer:
        for frame in frames:
            writer.write(frame, compression=options.get("compression"), photometric="minisblack", contiguous=False)
    np.testing.assert_array_equal(read_all(path), frames)


@pytest.mark.parametrize(("suffix", "bits", "off"), [("png", 8, 0), ("png", 16, 0), ("bmp", 8, 0), ("jpg", 8, 1)])
def test_folders_of_pictures_that_pillow_wrote(tmp_path: Path, suffix: str, bits: int, off: int) -> None:
    folder = tmp_path / "film"
    folder.mkdir()
    for i, frame in enumerate(frames_of(bits)):
        options = {"quality": 95} if suffix == "jpg" else {}
        Image.fromarray(frame).save(folder / f"shot_{i + 95}.{suffix}", **options)
    (folder / "notes.txt").write_text("not a frame")
    other = np.stack([np.asarray(Image.open(folder / f"shot_{i + 95}.{suffix}")) for i in range(N)])
    assert np.abs(read_all(folder).astype(int) - other).max() <= off
