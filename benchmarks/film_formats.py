"""Reading speed of every film format: opening, a frame in order, the last pages of a TIFF against its first.

Films of 640 x 480 grey with noise, in the page cache, one thread of Python; processor time of the process (decoders'
threads included), least of three. ``--against CHECKOUT`` reads with another checkout too. The import of PyAV and
tifffile in a fresh interpreter is timed as well.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from benchmarks.runner import Run, Table
from tests.vision.film.cine_file import write_cine
from tests.vision.turning_bar import write_video
from vision.errors import VisionWarning
from vision.film.avi_writer import write_avi
from vision.film.mraw import write_mraw
from vision.film.open import open_film

HEIGHT, WIDTH = 480, 640
LAST_OVER_FIRST = 3.0
"""Most that a page at the end may cost against one at the start: noise of a busy machine; it was 7 and more."""


def films(folder: Path, n: int) -> dict[str, Path]:
    """A film of each format."""
    rng = np.random.default_rng(1)
    smooth = 60.0 + 100.0 * np.arange(WIDTH) / WIDTH + 30.0 * np.sin(np.arange(HEIGHT)[:, None] / 9.0)
    frames = np.stack([np.rint(smooth + rng.normal(0.0, 2.0, smooth.shape)) for _ in range(n)]).astype(np.uint8)
    write_mraw(folder / "f8.mraw", frames, 2000.0)
    write_mraw(folder / "f12.mraw", frames.astype(np.uint16) << 4, 2000.0, bit_depth=12)
    write_cine(folder / "f.cine", frames)
    write_avi(folder / "raw.avi", frames, 25.0, quality=None)
    write_avi(folder / "mjpeg.avi", frames, 25.0, quality=95)
    write_video(folder / "ffv1.mkv", frames)
    write_video(folder / "h264.mp4", frames, "libx264", pixels="yuv420p", options={"crf": "18", "preset": "fast"})
    cv2.imwritemulti(str(folder / "plain.tif"), list(frames), [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    cv2.imwritemulti(str(folder / "lzw.tif"), list(frames))
    return {
        "MRAW 8 bit": folder / "f8.mraw",
        "MRAW 12 bit": folder / "f12.mraw",
        "CINE": folder / "f.cine",
        "AVI uncompressed": folder / "raw.avi",
        "AVI MJPEG": folder / "mjpeg.avi",
        "MKV FFV1": folder / "ffv1.mkv",
        "MP4 H.264": folder / "h264.mp4",
        "TIFF uncompressed": folder / "plain.tif",
        "TIFF LZW": folder / "lzw.tif",
    }


def least(work: Callable[[], None], times: int = 3) -> float:
    """Least processor time, s."""
    found = []
    for _ in range(times):
        start = time.process_time()
        work()
        found.append(time.process_time() - start)
    return min(found)


def open_anew(path: Path) -> None:
    """Open a film as one that was never seen: what a video's index was made of has another date."""
    os.utime(path)
    open_film(path).close()


def read_all(path: Path) -> None:
    """Every frame in order."""
    with open_film(path) as film:
        for index in range(film.n_frames):
            film.read(index)


def read_region(path: Path) -> None:
    """A region of 220 x 220 of every frame."""
    with open_film(path) as film:
        for index in range(film.n_frames):
            film.read_region(index, 100, 320, 200, 420)


def main(run: Run) -> bool:
    """Measure and print; whether the last pages cost what the first do."""
    table = Table("format:18s", "open ms:.1f", "frame us:.0f", "220 x 220 us:.0f")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore", category=VisionWarning):
        for name, path in films(Path(folder), run.frames).items():
            opened = least(lambda path=path: open_anew(path))
            whole, region = (least(lambda path=path, read=read: read(path)) for read in (read_all, read_region))
            table.row(name, 1e3 * opened, *(1e6 * each / run.frames for each in (whole, region)))
        stack = Path(folder) / "stack.tif"
        page = np.random.default_rng(2).integers(0, 255, (48, 64), dtype=np.uint8)
        cv2.imwritemulti(str(stack), [page] * run.pages)
        with open_film(stack) as film:
            first, last = (
                least(lambda pages=pages: [film.read(k) for k in pages] and None)
                for pages in (range(0, 20), range(run.pages - 20, run.pages))
            )
    print(f"TIFF of {run.pages} pages: a page takes {50e3 * first:.0f} us at the start, {50e3 * last:.0f} at the end")
    for package in ("av", "tifffile", "cv2"):
        code = f"import numpy, time; t = time.perf_counter(); import {package}; print(time.perf_counter() - t)"
        took = min(float(subprocess.check_output([sys.executable, "-c", code])) for _ in range(3))
        print(f"import {package}: {1e3 * took:.0f} ms")
    return last < LAST_OVER_FIRST * first + 1e-3
