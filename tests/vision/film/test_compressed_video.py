"""AVI and MP4: frames in order and the right way up, damage refused, lossy prediction warned about."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.vision.film.avi_file import write_avi
from vision import FilmError, VisionWarning
from vision.film.open import open_film

HEIGHT, WIDTH, N = 60, 84, 7


def frames_with_numbers() -> list[NDArray[np.uint8]]:
    """Each frame has its own grey level and a bright corner at the top right only."""
    frames = []
    for i in range(N):
        frame = np.full((HEIGHT, WIDTH), 30 + 20 * i, dtype=np.uint8)
        frame[:16, -16:] = 250
        frames.append(frame)
    return frames


@pytest.mark.parametrize(("quality", "error"), [(None, 0), (95, 3)])
def test_order_size_and_orientation(tmp_path: Path, quality: int | None, error: int) -> None:
    path = tmp_path / "film.avi"
    frames = frames_with_numbers()
    assert write_avi(path, frames, 25.0, quality=quality) == N
    with open_film(path) as film:
        assert (film.n_frames, film.height, film.width, film.bit_depth) == (N, HEIGHT, WIDTH, 8)
        assert film.frame_rate_hz == pytest.approx(25.0)
        for i in (0, 1, 5, 2, 2, 6):
            found = film.read(i).astype(int)
            assert found.shape == (HEIGHT, WIDTH)
            assert np.abs(found - frames[i]).max() <= error
        corner = film.read_region(3, 0, 16, WIDTH - 16, WIDTH)
        assert np.abs(corner.astype(int) - 250).max() <= error


@pytest.mark.parametrize("quality", [None, 90])
def test_damage_in_the_middle_is_found(tmp_path: Path, quality: int | None) -> None:
    """The first half of a frame is there, its chunk says so: not filled up, refused."""
    path = tmp_path / "film.avi"
    rng = np.random.default_rng(0)
    write_avi(path, rng.integers(0, 255, (3, HEIGHT, WIDTH), dtype=np.uint8), 25.0, quality=quality)
    data = bytearray(path.read_bytes())
    place = data.index(b"00dc")
    size = int.from_bytes(data[place + 4 : place + 8], "little")
    half = size // 4 * 2
    data[place + 4 : place + 8] = half.to_bytes(4, "little")
    rest = (size + size % 2 - half - 8).to_bytes(4, "little")
    data[place + 8 + half : place + 16 + half] = b"JUNK" + rest
    path.write_bytes(bytes(data))
    with pytest.raises(FilmError, match="frame 0"), open_film(path) as film:
        film.read(0)


def test_bottom_up_film_with_a_palette(tmp_path: Path) -> None:
    """8-bit uncompressed, inverted grey palette, padded rows, bottom row first, as frame grabbers write it."""
    frames = frames_with_numbers()[:2]
    path = tmp_path / "film.avi"
    write_avi(path, [np.ascontiguousarray(f[:, :81]) for f in frames], 25.0, quality=None)
    data = bytearray(path.read_bytes())
    header = data.index(b"strf") + 8
    data[header + 16 : header + 20] = b"\0\0\0\0"
    palette = b"".join(bytes([255 - i] * 3 + [0]) for i in range(256))
    # the palette belongs behind the header: three sizes grow, the frames are laid out again
    grown = data[: header + 40] + palette
    for name in (b"strf", b"strl", b"hdrl"):
        at = grown.index(name) + (4 if name == b"strf" else -4)
        grown[at : at + 4] = (int.from_bytes(grown[at : at + 4], "little") + 1024).to_bytes(4, "little")
    movi = b"movi"
    for frame in frames:
        rows = np.zeros((HEIGHT, 84), dtype=np.uint8)
        rows[:, :81] = 255 - frame[::-1, :81]
        movi += b"00db" + rows.size.to_bytes(4, "little") + rows.tobytes()
    grown += b"LIST" + len(movi).to_bytes(4, "little") + movi
    grown[4:8] = (len(grown) - 8).to_bytes(4, "little")
    path.write_bytes(bytes(grown))
    with open_film(path) as film:
        np.testing.assert_array_equal(film.read(1), frames[1][:, :81])
        np.testing.assert_array_equal(film.read_region(0, 3, 20, 60, 81), frames[0][3:20, 60:81])


def test_not_a_film_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    path.write_text("no film")
    with pytest.raises(FilmError, match="decoded"):
        open_film(path)
    with pytest.raises(FilmError, match="no such film"):
        open_film(tmp_path / "absent.avi")
    other = tmp_path / "film.xyz"
    other.write_text("")
    with pytest.raises(FilmError, match=r"\.xyz"):
        open_film(other)


def test_coarse_jpeg_is_warned_about(tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    write_avi(path, frames_with_numbers(), 25.0, quality=75)
    with pytest.warns(VisionWarning, match="JPEG"):
        open_film(path).close()
    write_avi(path, frames_with_numbers(), 25.0, quality=92)
    open_film(path).close()


@pytest.mark.filterwarnings("ignore:.*strong JPEG")
def test_jpeg_in_another_container_states_the_same_steps(tmp_path: Path) -> None:
    """What a film lost does not depend on the file it lies in."""
    found = []
    for name in ("film.avi", "film.mov", "film.mkv"):
        writer = cv2.VideoWriter(str(tmp_path / name), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (WIDTH, HEIGHT), False)
        if not writer.isOpened():
            pytest.skip(f"this OpenCV cannot write MJPEG into {name}")
        for frame in frames_with_numbers():
            writer.write(frame)
        writer.release()
        with open_film(tmp_path / name) as film:
            found.append(film.compression.steps)
    assert found[0].shape == (8, 8) and found[0].mean() > 1.0
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])
