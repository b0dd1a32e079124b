"""Damaged films are refused in one line or read right, in no more memory than their own size.

`python -m benchmarks fuzz_readers` runs this with more inputs.
"""

from __future__ import annotations

import os
import tracemalloc
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.rig.fuzz.damage import damaged
from tests.vision.film.avi_file import write_avi
from tests.vision.film.cine_file import write_cine
from tests.vision.turning_bar import write_video
from vision import FilmError, VisionWarning
from vision.film.mraw import write_mraw
from vision.film.open import open_film

FILMS, SEED = int(os.environ.get("FUZZ_INPUTS", "45")), int(os.environ.get("FUZZ_SEED", "7"))
CIH_LINES = """#Camera Information Header
Record Rate(fps) : 2000
Shutter Speed(s) : 1/8000
Total Frame : {n}
Original Total Frame : {n}
Start Frame : -3
Save Step : 1
Image Width : {width}
Image Height : {height}
Color Type : Mono
Color Bit : 8
File Format : MRaw
EffectiveBit Depth : 8
EffectiveBit Side : Lower
"""
WORDS = (0, 1, 0xFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x10000)
SHAPE = (12, 256, 400)
MOST_FRAMES = 4.5
"""A colour picture from OpenCV's video reader is three frames of grey, its grey one more; the rest is bookkeeping."""


@dataclass
class Tally:
    """Results for the mutated films of one kind."""

    refused: int = 0
    same: int = 0
    other: int = 0
    largest: float = 0.0
    largest_frames: float = 0.0
    wrong: list[str] = field(default_factory=list)


def mutated(data: bytes, rng: np.random.Generator, head: int) -> bytes:
    """Return a damaged copy; most damage falls within the first ``head`` bytes, some of it a number of four bytes."""
    end = min(head, len(data)) if rng.uniform() < 0.9 else len(data)
    if rng.uniform() < 0.7:
        return damaged(data[:end], rng) + data[end:]
    at, word = int(rng.integers(0, end - 4)), WORDS[int(rng.integers(0, len(WORDS)))]
    return data[:at] + word.to_bytes(4, "little") + data[at + 4 :]


def look(path: Path, frames: NDArray[Any], exact: bool, tally: Tally, what: str) -> None:
    """Open a damaged film, read all of it, and record the result."""
    size = max(path.stat().st_size, frames.size)
    tracemalloc.reset_peak()
    before = tracemalloc.get_traced_memory()[0]
    try:
        with warnings.catch_warnings(action="ignore", category=VisionWarning):
            film = open_film(path)
        with film:
            like = film.frame_time_s is None or film.frame_time_s.size == film.n_frames
            unchanged = (film.n_frames, film.height, film.width, film.bit_depth) == (*SHAPE, 8)
            right = True
            for i in range(min(film.n_frames, 50)):
                # not kept: only the reader's own allocations count
                frame = film.read(i)
                like &= frame.shape == (film.height, film.width)
                if exact and unchanged and i < 2:
                    right &= np.array_equal(frame, frames[i])
                del frame
            if not like:
                tally.wrong.append(f"{what}: frames are not of the size the film states")
            elif unchanged:
                tally.same += 1
                if not right:
                    tally.wrong.append(f"{what}: other grey values than were written")
            else:
                tally.other += 1
    except FilmError as problem:
        tally.refused += 1
        if "\n" in str(problem):
            tally.wrong.append(f"{what}: message of several lines")
    except Exception as problem:
        tally.wrong.append(f"{what}: {type(problem).__name__}: {problem}")
    taken = tracemalloc.get_traced_memory()[1] - before
    tally.largest = max(tally.largest, taken / size)
    tally.largest_frames = max(tally.largest_frames, taken / frames[0].size)


def fuzz(folder: Path, count: int, seed: int) -> dict[str, Tally]:
    """Mutate ``count`` films in total; return tallies by kind."""
    rng = np.random.default_rng(seed)
    smooth = np.linspace(40, 200, SHAPE[2])[None, None, :] + 4.0 * np.arange(SHAPE[0])[:, None, None]
    frames = (smooth + rng.normal(0, 3, SHAPE)).clip(0, 255).astype(np.uint8)
    mraw, cih = folder / "a.mraw", folder / "b.mraw"
    write_mraw(mraw, frames, 2000.0, exposure_s=1e-4)
    write_mraw(cih, frames, 2000.0)
    cih.with_suffix(".cihx").unlink()
    raw, jpeg = folder / "raw.avi", folder / "jpeg.avi"
    write_avi(raw, frames, 25.0, quality=None)
    write_avi(jpeg, frames, 25.0, quality=95)
    cine, tiff = folder / "a.cine", folder / "a.tif"
    write_cine(cine, frames)
    cv2.imwritemulti(str(tiff), list(frames))
    mkv = write_video(folder / "a.mkv", frames)
    mp4 = write_video(folder / "a.mp4", frames, "libx264", pixels="yuvj420p", options={"crf": "4"})
    text = CIH_LINES.format(n=SHAPE[0], height=SHAPE[1], width=SHAPE[2]).encode()
    headers = {
        "CIHX": (mraw, mraw.with_suffix(".cihx"), mraw.with_suffix(".cihx").read_bytes(), 10_000, True),
        "CIH": (cih, cih.with_suffix(".cih"), text, 10_000, True),
        "AVI": (raw, raw, raw.read_bytes(), 320, False),
        "AVI MJPEG": (jpeg, jpeg, jpeg.read_bytes(), 1000, False),
        "CINE": (cine, cine, cine.read_bytes(), 12_500, False),
        "TIFF": (tiff, tiff, tiff.read_bytes(), tiff.stat().st_size, False),
        "MKV FFV1": (mkv, mkv, mkv.read_bytes(), 1000, False),
        "MP4 H.264": (mp4, mp4, mp4.read_bytes(), mp4.stat().st_size, False),
    }
    tallies = {name: Tally() for name in (*headers, "MRAW length")}
    for path in (mraw, raw, jpeg, cine, tiff, mkv, mp4):
        # imports on first use do not count against the film
        with warnings.catch_warnings(action="ignore", category=VisionWarning):
            open_film(path).close()
    tracemalloc.start()
    try:
        for number in range(count):
            name = list(tallies)[number % len(tallies)]
            if name == "MRAW length":
                header = mraw.with_suffix(".cihx")
                header.write_bytes(headers["CIHX"][2])
                whole = mraw.read_bytes()
                mraw.write_bytes(
                    mutated(whole, rng, len(whole)) if rng.uniform() < 0.5 else whole[: -rng.integers(1, 9)]
                )
                look(mraw, frames, False, tallies[name], f"{name} {number}")
                mraw.write_bytes(whole)
                continue
            film, file, data, head, exact = headers[name]
            file.write_bytes(mutated(data, rng, head))
            look(film, frames, exact, tallies[name], f"{name} {number}")
            file.write_bytes(data)
    finally:
        tracemalloc.stop()
    return tallies


def test_damaged_films_are_refused_or_read_right(tmp_path: Path) -> None:
    tallies = fuzz(tmp_path, FILMS, SEED)
    assert sum(tally.same for tally in tallies.values()) > 5
    for name, tally in tallies.items():
        assert not tally.wrong, (name, tally.wrong)
        assert tally.refused > 0, name
        assert tally.largest < 1.0 and tally.largest_frames < MOST_FRAMES, name


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
