"""Fuzz the readers of films and of other programs' recordings: a typed error or correct data.

Mutates CIH, CIHX, MRAW (length), AVI (uncompressed and MJPEG), CINE, TIFF, MKV and MP4 films of about 1 MB as the tests
of the rig's files do (`tests.rig.fuzz`): bits flipped, digits and numbers changed, stretches lost, doubled or moved. A
film that opens must give frames of the size it states, and the original grey values if its header is unchanged. No step
may allocate more than the film's own size (the file or its grey values, whichever is larger), nor more than
`MOST_FRAMES` frames of it. Allocations by Python, NumPy and OpenCV's images count; FFmpeg's internal
memory does not. Prints per kind: counts, and the largest allocation relative to the film's size and to one frame's. The
exit code is 1 if any film behaves otherwise.

Recordings (CSV, LVM, TDMS, HDF5) are damaged as the tests of the rig's files do, and what is read is compared with a
second reading (`tests.rig.fuzz.recording_cases`, `stored_cases`).
"""

from __future__ import annotations

import os
import tempfile
import tracemalloc
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.runner import Run, Table
from tests.rig.fuzz import recording_cases, stored_cases
from tests.rig.fuzz.damage import damaged, survive
from tests.vision.film.cine_file import write_cine
from tests.vision.turning_bar import write_video

# decoders report damage on standard error themselves; here every film is damaged
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")

from vision.errors import FilmError, VisionWarning
from vision.film.avi_writer import write_avi
from vision.film.mraw import write_mraw
from vision.film.open import open_film

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


RECORDINGS = {
    "CSV": recording_cases.csv_case,
    "CSV, European": recording_cases.european_csv_case,
    "CSV of a logger": recording_cases.logger_csv_case,
    "CSV of savetxt": recording_cases.savetxt_case,
    "LVM": recording_cases.lvm_case,
    "LVM, segments": recording_cases.segments_case,
    "LVM, unequal": recording_cases.unequal_lvm_case,
    "TDMS": stored_cases.tdms_case,
    "TDMS, big-endian": stored_cases.big_endian_tdms_case,
    "TDMS, appended": stored_cases.two_recordings_tdms_case,
    "HDF5": stored_cases.hdf5_case,
}


def fuzz_recordings(folder: Path, count: int) -> bool:
    """Damage ``count`` recordings in total and print a row a kind; whether all are refused or read right."""
    table = Table("kind:17s", "recordings:d", "refused:d", "read:d", "wrong:60s")
    each, sound = max(count // len(RECORDINGS), 1), True
    for name, case in RECORDINGS.items():
        refused, wrong = 0, ""
        try:
            refused = survive(*case(folder), each)
        except Exception as problem:  # the first that is wrong ends its kind
            wrong = " ".join(f"{type(problem).__name__}: {problem}".split())[:60]
        table.row(name, each, refused, each - refused, wrong or "none")
        sound &= not wrong
    return sound


def main(run: Run) -> bool:
    """Fuzz and print; whether all films and recordings are refused or read right."""
    with tempfile.TemporaryDirectory() as folder:
        tallies = fuzz(Path(folder), run.count, run.seed)
        recordings_sound = fuzz_recordings(Path(folder), run.count)
    table = Table(
        "kind:14s", "films:d", "refused:d", "read:d", "other size:d", "allocation / film:.2f", "/ frame:.2f", "wrong:d"
    )
    for name, t in tallies.items():
        counts = t.refused + t.same + t.other, t.refused, t.same, t.other
        table.row(name, *counts, t.largest, t.largest_frames, len(t.wrong))
        for words in t.wrong[:5]:
            print(f"  {words}")
    bad = any(t.wrong or t.largest > 1.0 for t in tallies.values())
    bad |= any(t.largest_frames > MOST_FRAMES for t in tallies.values())
    bad |= not recordings_sound
    print("FAILED" if bad else "all refused or read right")
    return not bad
