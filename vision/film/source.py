"""Film as a sequence of frames: what every reader offers, and `open_film`, which picks the reader.

Place in the data flow: the tracker, the overlay and the calibration see films only through `FrameSource`.
Frames are grey, (height, width), row 0 on top; `read_region` returns only the wanted rectangle and, where the
format allows, touches only its bytes. ``frame_time_s`` is the middle of each exposure by the camera's own
clock, counted from its trigger, or None.

Failure: a film that is missing, unreadable, or shorter than its header says raises `FilmError`; nothing is
guessed.
"""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError
from vision.film.compression import Compression

VIDEO_SUFFIXES = (".avi", ".mp4", ".mov", ".mkv", ".m4v")
PICTURE_SUFFIXES = (".png", ".tif", ".tiff", ".bmp")


class FrameSource(Protocol):
    """A film that gives its frames by number.

    Attributes
    ----------
    path : Path
    n_frames, height, width : int
    bit_depth : int
        Bits of a grey value that carry light; the largest value is ``2**bit_depth - 1``.
    frame_rate_hz, exposure_s : float or None
        None when the file does not say.
    compression : Compression or None
        None when grey values are stored as they were seen.
    """

    path: Path
    n_frames: int
    height: int
    width: int
    bit_depth: int
    frame_rate_hz: float | None
    exposure_s: float | None
    compression: Compression | None

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """Middle of each exposure, shape (n_frames,), s after the camera's trigger; None when not stated."""
        ...

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width), uint8 or uint16."""
        ...

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rows ``y0..y1-1`` and columns ``x0..x1-1`` of a frame."""
        ...

    def close(self) -> None:
        """Let go of the file."""
        ...


class Film:
    """Shared part of the readers: bounds checks, the context manager, time from the frame rate."""

    path: Path
    n_frames: int
    height: int
    width: int
    bit_depth: int = 8
    frame_rate_hz: float | None = None
    exposure_s: float | None = None
    compression: Compression | None = None

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """Middle of each exposure, s; None when the file states no frame rate."""
        if self.frame_rate_hz is None:
            return None
        return np.arange(self.n_frames) / self.frame_rate_hz + 0.5 * (self.exposure_s or 0.0)

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width)."""
        raise NotImplementedError

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rectangle of a frame; here cut from the whole frame."""
        self._check_region(y0, y1, x0, x1)
        return self.read(index)[y0:y1, x0:x1]

    def close(self) -> None:
        """Let go of the file; further reads are undefined."""

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check_index(self, index: int) -> None:
        if not 0 <= index < self.n_frames:
            raise FilmError(f"{self.path}: frame {index} asked for, the film has 0..{self.n_frames - 1}")

    def _check_region(self, y0: int, y1: int, x0: int, x1: int) -> None:
        if not (0 <= y0 < y1 <= self.height and 0 <= x0 < x1 <= self.width):
            raise FilmError(
                f"{self.path}: region rows {y0}..{y1}, columns {x0}..{x1} asked for, the picture has "
                f"{self.height} rows and {self.width} columns"
            )


class ArrayFilm(Film):
    """Frames already in memory, for notebooks and tests.

    Parameters
    ----------
    frames : ndarray, shape (n_frames, height, width), uint8 or uint16
    frame_rate_hz, exposure_s : float or None
    bit_depth : int or None
        All bits of the type unless given.
    """

    def __init__(
        self,
        frames: NDArray[Any],
        frame_rate_hz: float | None = None,
        exposure_s: float | None = None,
        bit_depth: int | None = None,
    ) -> None:
        self.path = Path("<array>")
        if frames.ndim != 3 or frames.dtype not in (np.uint8, np.uint16) or 0 in frames.shape:
            raise FilmError(
                f"frames in memory have shape {frames.shape}, type {frames.dtype}; needs "
                "(n_frames, height, width) of "
                "uint8 or uint16"
            )
        self._frames = frames
        self.n_frames, self.height, self.width = frames.shape
        self.bit_depth = bit_depth or 8 * frames.dtype.itemsize
        self.frame_rate_hz, self.exposure_s = frame_rate_hz, exposure_s

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width)."""
        self._check_index(index)
        return self._frames[index]


def open_film(path: str | os.PathLike[str], *, allow_truncated: bool = False) -> Film:
    """Open a film of any readable format.

    Parameters
    ----------
    path : path
        ``.mraw``, ``.cih`` or ``.cihx`` (the two lie side by side), AVI/MP4/MOV/MKV, a TIFF with one frame
        per page, a folder of PNG/TIFF pictures in the order of their names.
    allow_truncated : bool
        Read a film that was cut short up to its last whole frame instead of refusing it.

    Returns
    -------
    Film
        A `FrameSource`, also a context manager.

    Raises
    ------
    FilmError
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if not path.exists():
        raise FilmError(f"{path}: no such film; give an existing .mraw, .avi, .mp4, .tif file or a folder of pictures")
    if path.is_dir():
        from vision.film.picture_stack import PictureFolder

        return PictureFolder(path)
    if suffix in (".mraw", ".cih", ".cihx"):
        from vision.film.mraw import MrawFilm

        return MrawFilm(path, allow_truncated=allow_truncated)
    if suffix == ".avi":
        from vision.film.avi_reader import AviFilm

        avi = AviFilm(path, allow_truncated=allow_truncated)
        if avi.readable:
            return avi
        avi.close()
    if suffix in VIDEO_SUFFIXES:
        from vision.film.opencv_video import VideoFilm

        return VideoFilm(path, allow_truncated=allow_truncated)
    if suffix in PICTURE_SUFFIXES:
        from vision.film.picture_stack import PagedPicture

        return PagedPicture(path, allow_truncated=allow_truncated)
    known = ", ".join((".mraw", ".cih", ".cihx", *VIDEO_SUFFIXES, ".tif", ".tiff"))
    raise FilmError(f"{path}: film format {suffix or '(no suffix)'} is not known; readable: {known}, picture folders")
