"""TIFF films of other programs: the axes say what is a frame, a channel is asked for, every page costs the same."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from tests.command_line import run
from vision import FilmError, VisionWarning
from vision.film.open import open_film
from vision.film.source import saturated_grey

FRAMES = np.random.default_rng(8).integers(0, 4096, (7, 18, 26), dtype=np.uint16)
OTHER = FRAMES[::-1].copy()
"""What a second channel holds."""


def both(axis: int) -> np.ndarray:
    return np.stack([FRAMES, OTHER], axis)


@pytest.mark.parametrize(
    ("name", "options", "axis"),
    [
        ("f.tif", {"imagej": True, "metadata": {"axes": "TCYX"}}, 1),
        ("f.ome.tif", {"metadata": {"axes": "TCYX"}}, 1),
        ("f.ome.tif", {"metadata": {"axes": "CTYX"}}, 0),
        ("f.ome.tif", {"metadata": {"axes": "CTYX"}, "compression": "zlib", "byteorder": ">"}, 0),
        ("f.ome.tif", {"metadata": {"axes": "ZCYX"}}, 1),
    ],
)
def test_a_channel_is_asked_for_and_never_taken_for_time(
    tmp_path: Path, name: str, options: dict[str, Any], axis: int
) -> None:
    path = tmp_path / name
    tifffile.imwrite(path, both(axis), **options)
    for asked in (None, "3", "0", "green"):
        with pytest.raises(FilmError, match=r"holds 2 channels.*`channel` 1 to 2"):
            open_film(path, channel=asked)
    for channel, frames in (("1", FRAMES), ("2", OTHER)):
        with open_film(path, channel=channel) as film:
            assert film.n_frames == 7
            for k in (6, 0, 3):
                np.testing.assert_array_equal(film.read(k), frames[k])
            np.testing.assert_array_equal(film.read_region(5, 2, 9, 3, 20), frames[5, 2:9, 3:20])
            assert film.read(2).dtype.isnative


def test_time_and_depth_are_not_mixed(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "f.ome.tif", both(1), metadata={"axes": "TZYX"})
    with pytest.raises(FilmError, match="two axes .7 along T and 2 along Z."):
        open_film(tmp_path / "f.ome.tif")


def stack_of_one_page(path: Path, frames: np.ndarray) -> None:
    """As ImageJ writes stacks over 4 GB: one directory, all frames behind it."""
    said = f"ImageJ=1.54f\nimages={len(frames)}\nslices={len(frames)}\nloop=false\n"
    tifffile.imwrite(path, frames[0], description=said, metadata=None, byteorder=">")
    with tifffile.TiffFile(path) as file:
        at = file.pages[0].dataoffsets[0]
        assert len(file.pages) == 1
    path.write_bytes(path.read_bytes()[:at] + frames.astype(">u2").tobytes())


def test_an_imagej_stack_with_one_directory_has_all_its_frames(tmp_path: Path) -> None:
    path = tmp_path / "f.tif"
    stack_of_one_page(path, FRAMES)
    with open_film(path) as film:
        assert film.n_frames == 7
        for k in (6, 0):
            np.testing.assert_array_equal(film.read(k), FRAMES[k])
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(FilmError, match="says 7 images and holds 6; the file is cut short"):
        open_film(path)
    with open_film(path, allow_truncated=True) as film:
        assert film.n_frames == 6
        np.testing.assert_array_equal(film.read(5), FRAMES[5])


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize("is_one_series", [True, False])
def test_colour_pages(tmp_path: Path, compression: str | None, planar: str, is_one_series: bool) -> None:
    colour = np.random.default_rng(2).integers(0, 256, (5, 18, 26, 3), dtype=np.uint8)
    stored = colour if planar == "contig" else np.moveaxis(colour, -1, 1)
    with tifffile.TiffWriter(tmp_path / "f.tif") as file:
        for page in [stored] if is_one_series else stored:
            file.write(page, photometric="rgb", planarconfig=planar, compression=compression, metadata=None)
    for k, channel in enumerate(("red", "green", "blue")):
        with open_film(tmp_path / "f.tif", channel=channel) as film:
            for i in (4, 1):
                np.testing.assert_array_equal(film.read(i), colour[i, ..., k])
    with open_film(tmp_path / "f.tif") as film:
        np.testing.assert_allclose(film.read(3), colour[3] @ [0.299, 0.587, 0.114], atol=0.6)


@pytest.mark.parametrize("compression", [1, 5, 32946, 32773])
def test_pages_in_any_compression_are_read_each_from_its_own_place(tmp_path: Path, compression: int) -> None:
    """OpenCV writes none, LZW, deflate, PackBits; a directory is walked once, not for every page."""
    path = tmp_path / "f.tif"
    assert cv2.imwritemulti(str(path), list(FRAMES), [cv2.IMWRITE_TIFF_COMPRESSION, compression])
    with open_film(path) as film:
        for k in (6, 0, 3):
            np.testing.assert_array_equal(film.read(k), FRAMES[k])


def test_white_may_be_zero(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "f.tif", FRAMES, photometric="miniswhite")
    with open_film(tmp_path / "f.tif") as film:
        np.testing.assert_array_equal(film.read(1), 65535 - FRAMES[1])


def test_pages_of_two_sizes_are_refused(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "f.tif") as file:
        file.write(FRAMES[0], metadata=None)
        file.write(FRAMES[1][:9], metadata=None)
    with pytest.raises(FilmError, match="holds 2 series of pictures"):
        open_film(tmp_path / "f.tif")


def test_the_command_asks_for_a_channel(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, outlines = tmp_path / "f.tif", tmp_path / "bodies.toml"
    tifffile.imwrite(path, both(1), imagej=True, metadata={"axes": "TCYX"})
    outlines.write_text('[[body]]\nname = "all"\npolygon_px = [[4, 4], [22, 4], [22, 14], [4, 14]]\n')
    assert run("track", str(path), "--bodies", str(outlines), "--frame-rate", "100") == 2
    assert "choose one by its number (--channel 1 to 2)" in capsys.readouterr().err


@pytest.mark.parametrize("orientation", range(2, 9))
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_a_picture_is_turned_as_its_tag_wants(tmp_path: Path, orientation: int, compression: str | None) -> None:
    """TIFF 6.0, page 36: the sides of the scene on which the first row and the first column lie."""
    path = tmp_path / "f.tif"
    tifffile.imwrite(
        path, FRAMES, photometric="minisblack", compression=compression, extratags=[(274, 3, 1, orientation, True)]
    )
    upright = {
        2: FRAMES[:, :, ::-1],
        3: FRAMES[:, ::-1, ::-1],
        4: FRAMES[:, ::-1],
        5: FRAMES.swapaxes(1, 2),
        6: np.rot90(FRAMES, -1, (1, 2)),
        7: FRAMES[:, ::-1, ::-1].swapaxes(1, 2),
        8: np.rot90(FRAMES, 1, (1, 2)),
    }[orientation]
    with pytest.warns(VisionWarning, match="wants the picture .*which is done"):
        film = open_film(path)
    with film:
        assert (film.n_frames, film.height, film.width) == upright.shape
        np.testing.assert_array_equal(film.read(3), upright[3])
        np.testing.assert_array_equal(film.read_region(5, 2, 9, 3, 11), upright[5, 2:9, 3:11])


@pytest.mark.parametrize("compression", [None, "lzma"])
def test_a_palette_gives_its_colours(tmp_path: Path, compression: str | None) -> None:
    level = np.arange(256, dtype=np.uint16)[::-1] * 257
    grey = (FRAMES >> 4).astype(np.uint8)
    tifffile.imwrite(tmp_path / "f.tif", grey, photometric="palette", colormap=np.stack([level] * 3))
    with open_film(tmp_path / "f.tif") as film:
        np.testing.assert_array_equal(film.read(2), 255 - grey[2])
    tifffile.imwrite(tmp_path / "g.tif", grey, photometric="minisblack", compression=compression)
    with open_film(tmp_path / "g.tif") as film:
        np.testing.assert_array_equal(film.read(2), grey[2])


def write_12_bit(path: Path, frames: np.ndarray) -> None:
    """Pages whose values follow one another without a gap, two in three bytes."""
    n, height, width = frames.shape
    data, directories = bytearray(b"II*\0" + bytes(4)), 4
    for frame in frames:
        pairs = frame.reshape(-1, 2)
        packed = np.stack([pairs[:, 0] >> 4, (pairs[:, 0] & 15) << 4 | pairs[:, 1] >> 8, pairs[:, 1] & 255], -1)
        tags = {256: width, 257: height, 258: 12, 259: 1, 262: 1, 273: len(data), 277: 1, 278: height, 279: packed.size}
        data += packed.astype(np.uint8).tobytes()
        data[directories : directories + 4] = struct.pack("<I", len(data))
        data += struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", tag, 4, 1, tags[tag]) for tag in tags)
        directories = len(data)
        data += bytes(4)
    path.write_bytes(data)


def test_packed_12_bit_has_its_white(tmp_path: Path) -> None:
    write_12_bit(tmp_path / "f.tif", FRAMES)
    with open_film(tmp_path / "f.tif") as film:
        assert film.bit_depth == 12
        np.testing.assert_array_equal(film.read(4), FRAMES[4])


@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("is_high", [False, True])
def test_white_of_fewer_bits_in_either_end_of_16_is_known(tmp_path: Path, bits: int, is_high: bool) -> None:
    frames = np.minimum(FRAMES.astype(np.int64) * 5 * 2**bits // 16384, 2**bits - 1)
    frames <<= (16 - bits) * is_high
    tifffile.imwrite(tmp_path / "f.tif", frames.astype(np.uint16), photometric="minisblack")
    with open_film(tmp_path / "f.tif") as film:
        assert saturated_grey(film) == frames.max()
        np.testing.assert_array_equal(film.read(4), frames[4])
