"""Film as a sequence of frames: what every reader offers, and films in memory.

Tracker, pictures and calibration see films only through `FrameSource`. Frames are grey, (height, width), row 0 on
top; `read_region` returns only the wanted rectangle and, where the format allows, touches only its bytes.

A frame may repeat the one before, byte for byte: a camera's software fills a dropped frame with its neighbour. Two
exposures differ by their noise in some of thousands of pixels, so equal bytes mean that no light was taken in between,
and the frame says nothing about its own time.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import as_numbers
from vision.errors import FilmError, VisionInputError, VisionWarning
from vision.film.mmap_window import FileWindow

ZIGZAG = sorted(
    ((row, column) for row in range(8) for column in range(8)),
    key=lambda at: (sum(at), at[0] if sum(at) % 2 else at[1]),
)
"""Rows and columns of the 64 coefficients in the order in which a file stores them (T.81, figure A.6)."""


@dataclass(frozen=True)
class Compression:
    # (8, 8), steps of the luminance table, grey, lowest frequency first; None when frames are
    # predicted from others, or stored with a loss that the file does not tell
    steps: NDArray[np.float64] | None


def jpeg_segments(data: bytes | NDArray[np.uint8]) -> Iterator[tuple[int, int]]:
    """Yield, for each segment before the picture of a JPEG, its kind (the marker's second byte) and the index of its
    first byte of content; a smaller JPEG inside a segment is passed over with it."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        kind = int(data[at + 1])
        yield kind, at + 4
        at += 1 if kind == 0xFF else 2 + int(data[at + 2]) * 256 + int(data[at + 3])  # big-endian length of a segment


def jpeg_quantisation_table(data: bytes) -> NDArray[np.float64] | None:
    """Steps of the luminance quantisation table of a JPEG, grey, (8, 8), lowest frequency first; None where it has
    none."""
    at = next((at for kind, at in jpeg_segments(data) if kind == 0xDB), len(data))
    number = np.dtype(">u2") if data[at : at + 1] > b"\x0f" else np.dtype(np.uint8)
    if len(data) < at + 1 + len(ZIGZAG) * number.itemsize:
        return None
    values = np.frombuffer(data, dtype=number, count=len(ZIGZAG), offset=at + 1)
    steps = np.empty((8, 8))
    steps[tuple(np.transpose(ZIGZAG))] = values
    return steps


def jpeg_ends(data: bytes) -> bool:
    """Whether a JPEG picture ends with its mark; decoders fill up what breaks off."""
    return data.startswith(b"\xff\xd8") and data[-64:].rstrip(b"\0").endswith(b"\xff\xd9")


COARSE_JPEG = 12.0  # mean quantisation step: 6 at quality 95, 11.5 at 90, 29 at 75 (tables of ITU-T T.81 annex K)


def jpeg_compression(path: Path, data: bytes, stacklevel: int) -> Compression | None:
    """Compression of a film whose frames are JPEG pictures like ``data`` (the bytes of one), with a warning where it is
    strong; None where it has no table. ``stacklevel``: the warning's, as the caller would give it to `warnings.warn`.
    """
    steps = jpeg_quantisation_table(data)
    if steps is None:
        return None
    if steps.mean() > COARSE_JPEG:
        warnings.warn(
            f"{path}: strong JPEG compression adds to the uncertainty of the angles; export with quality 95 or "
            "uncompressed",
            VisionWarning,
            stacklevel=stacklevel + 1,
        )
    return Compression(steps)


CHANNELS = ("blue", "green", "red")
"""In the order of OpenCV, AVI and Windows bitmaps."""


def to_grey(picture: NDArray[Any], channel: str | None) -> NDArray[Any]:
    """Grey values (height, width) of a picture that is grey or (height, width, 3 or 4) blue, green, red: weighted as
    the eye does, or those of one ``channel``, "blue", "green" or "red".

    A lamp or a paint of one colour shows best in its own channel, and a sensor with a colour filter samples green most
    densely.
    """
    if picture.ndim == 2:
        return picture
    if channel is not None:
        return np.ascontiguousarray(picture[..., CHANNELS.index(channel)])
    # start-up: OpenCV costs 0.12 s, MRAW films do without
    import cv2

    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGRA2GRAY if picture.shape[2] == 4 else cv2.COLOR_BGR2GRAY))


def decode_picture(data: NDArray[np.uint8], flags: int) -> NDArray[Any] | None:
    """Decode the bytes (n,) of a picture file with OpenCV, silently, as its `imread` ``flags`` say, colours as blue,
    green, red; None where that fails."""
    # start-up: as above
    import cv2

    if not data.size:
        return None
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        return cv2.imdecode(data, flags)
    finally:
        logging.setLogLevel(level)


def saturated_grey(film: FrameSource) -> int:
    """Smallest grey value that says no more than "too bright"."""
    white = getattr(film, "white_grey", None)
    return int(2**film.bit_depth - 1) if white is None else int(white)


SATURATED_SHARE = 0.1
"""Saturated areas of less than this share of a body move with it and bias it less than leaving them out costs."""


def saturated_areas(picture: NDArray[Any], top: int) -> NDArray[np.bool_] | None:
    """Mask (height, width) of the pixels of a picture that reach ``top`` and whose four neighbours reach it too; None
    where there are none.

    A single pixel that the noise lifts over the edge is hardly off; inside an area nothing is known of the light.
    """
    if picture.max() < top:
        return None
    # start-up: as above
    import cv2

    inside = cv2.erode((picture >= top).astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))) > 0
    return inside if inside.any() else None


FIRST_FRAMES = 9  # that are looked at to judge how a film begins: choice


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
    white_grey : int or None
        Grey value of white where that is less than the largest (235 of 255 in video of limited range).
    pixel_aspect : float or None
        Width of a pixel over its height, as the file states it; None when it does not.
    is_interlaced : bool
        True when the file says of any frame that its even and odd rows were exposed at different times.
    first_field : {"even", "odd"} or None
        Rows of interlaced frames that were exposed first, counted from 0 at the top; None when the file does not say.
    has_camera_times : bool
        True when ``frame_time_s`` was written by the camera; the times of a video may be those of play-back.
    """

    path: Path
    n_frames: int
    height: int
    width: int
    bit_depth: int
    frame_rate_hz: float | None
    exposure_s: float | None
    compression: Compression | None
    white_grey: int | None
    pixel_aspect: float | None
    is_interlaced: bool
    first_field: str | None
    has_camera_times: bool

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
        """Close the file; frames already read stay valid."""
        ...


class NewestFrame(threading.local):
    """The frame that a thread read last, for readers that can only decode whole ones."""

    index = -1
    picture: NDArray[Any] | None = None

    def get(self, index: int, decode: Callable[[int], NDArray[Any]]) -> NDArray[Any]:
        if self.index != index or self.picture is None:
            self.picture = None  # released first: one decoded picture at a time
            self.index, self.picture = index, decode(index)
        return self.picture


class Film:
    """Shared part of the readers: bounds checks, the context manager, frame times from the frame rate.

    A reader gives `read` or `read_region`, of which each is made from the other, and closes its ``_file`` if it has.
    ``in_order`` is True where frames are decoded one after the other; of all other films several threads may read.
    """

    path: Path
    n_frames: int
    height: int
    width: int
    bit_depth: int = 8
    frame_rate_hz: float | None = None
    exposure_s: float | None = None
    compression: Compression | None = None
    white_grey: int | None = None
    pixel_aspect: float | None = None
    is_interlaced: bool = False
    first_field: str | None = None
    has_camera_times: bool = False
    camera_time_s: NDArray[np.float64] | None = None
    first_frame: int = 0
    header: Any = None
    in_order = False
    _file: FileWindow

    def __repr__(self) -> str:
        rate = "" if self.frame_rate_hz is None else f", {self.frame_rate_hz:g} frames/s"
        return f"<{type(self).__name__} {self.path}: {self.n_frames} frames of {self.width} x {self.height} px{rate}>"

    def __len__(self) -> int:
        return self.n_frames

    def __bool__(self) -> bool:
        return True

    def __getitem__(self, index: int) -> NDArray[Any]:
        return self.read(range(self.n_frames)[index])

    def __iter__(self) -> Iterator[NDArray[Any]]:
        return (self.read(index) for index in range(self.n_frames))

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """Middle of each exposure, s; None when the file states no frame rate."""
        if self.camera_time_s is not None:
            return self.camera_time_s
        if self.frame_rate_hz is None:
            return None
        return np.arange(self.n_frames) / self.frame_rate_hz + 0.5 * (self.exposure_s or 0.0)

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width), uint8 or uint16."""
        return self.read_region(index, 0, self.height, 0, self.width)

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rectangle of a frame; here cut from the whole frame."""
        self._check_region(y0, y1, x0, x1)
        return self.read(index)[y0:y1, x0:x1]

    def close(self) -> None:
        """Close the file; frames already read stay valid."""
        if hasattr(self, "_file"):
            self._file.close()

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check_index(self, index: int) -> None:
        if not 0 <= index < self.n_frames:
            raise FilmError(f"{self.path}: frame {index} requested, the film has 0..{self.n_frames - 1}")

    def _check_region(self, y0: int, y1: int, x0: int, x1: int) -> None:
        if not (0 <= y0 < y1 <= self.height and 0 <= x0 < x1 <= self.width):
            raise FilmError(
                f"{self.path}: region rows {y0}..{y1}, columns {x0}..{x1} requested, the picture has "
                f"{self.height} rows and {self.width} columns"
            )


class Corrected(Film):
    """A film whose frames have something taken off; in all else it is as ``film``."""

    def __init__(self, film: FrameSource) -> None:
        self.film = film
        for name in ("path", "n_frames", "height", "width", "bit_depth", "frame_rate_hz", "exposure_s", "compression"):
            setattr(self, name, getattr(film, name))
        for name in ("white_grey", "pixel_aspect", "is_interlaced", "first_field", "has_camera_times", "first_frame"):
            # a source of the user's own may be of before these were asked for
            setattr(self, name, getattr(film, name, getattr(Film, name)))
        self.in_order = getattr(film, "in_order", True)

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        return self.film.frame_time_s


class ChosenFrames(Corrected):
    """Frames ``first_frame`` to ``last_frame`` of a film, numbered from 0; the film itself is ``film``."""

    def __init__(self, film: FrameSource, first_frame: int, last_frame: int | None = None) -> None:
        super().__init__(film)
        last = film.n_frames - 1 if last_frame is None else last_frame
        if not 0 <= first_frame <= last < film.n_frames:
            raise FilmError(
                f"{film.path}: frames {first_frame} to {last} are chosen, the film has 0 to {film.n_frames - 1}"
            )
        self.first_frame, self.n_frames = first_frame, last + 1 - first_frame

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        times = self.film.frame_time_s
        return None if times is None else times[self.first_frame : self.first_frame + self.n_frames]

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, counted from the first chosen one."""
        self._check_index(index)
        return self.film.read(self.first_frame + index)

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        self._check_index(index)
        return self.film.read_region(self.first_frame + index, y0, y1, x0, x1)

    def close(self) -> None:
        self.film.close()


class ArrayFilm(Film):
    """Frames already in memory, for notebooks and tests.

    Parameters
    ----------
    frames : array_like, shape (n_frames, height, width)
        Of uint8 or uint16, which are not copied; other whole numbers with their ``bit_depth``.
    frame_rate_hz, exposure_s : float or None
    bit_depth : int or None
        All bits of the type unless given.
    """

    def __init__(
        self,
        frames: ArrayLike,
        frame_rate_hz: float | None = None,
        exposure_s: float | None = None,
        bit_depth: int | None = None,
    ) -> None:
        self.path = Path("<array>")
        where = "frames in memory"
        stored = np.asarray(frames) if hasattr(frames, "dtype") else as_numbers(frames, where, dtype=np.int64)
        if bit_depth is not None and stored.dtype not in (np.uint8, np.uint16):
            stored = as_numbers(stored, where, dtype=np.uint8 if bit_depth <= 8 else np.uint16)
        if stored.dtype == ">u2":
            stored = stored.astype(np.uint16)
        if stored.ndim != 3 or stored.dtype not in (np.uint8, np.uint16) or 0 in stored.shape:
            raise FilmError(
                f"frames in memory have shape {stored.shape}, type {stored.dtype}; needs (n_frames, height, width) of "
                "uint8 or uint16, or whole numbers and their bit_depth"
            )
        self._frames = stored
        self.n_frames, self.height, self.width = stored.shape
        self.bit_depth = bit_depth or 8 * stored.dtype.itemsize
        self.frame_rate_hz, self.exposure_s = frame_rate_hz, exposure_s

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width)."""
        self._check_index(index)
        return self._frames[index]

    def frames(self, start: int, end: int) -> NDArray[Any] | None:
        """Frames ``start..end-1`` as they lie in memory, read-only; None where they do not lie one after the other."""
        frames = self._frames[start:end]
        if not frames.flags.c_contiguous:
            return None
        frames.flags.writeable = False
        return frames


def check_frame(
    path: Path, frame: ArrayLike, shape: tuple[int, ...] | None, bit_depth: int, number: int
) -> NDArray[Any]:
    """Frame number ``number`` as whole numbers; `FilmError` unless it has the ``shape`` of the first frame (None: it is
    the first, and must be (height, width)) and values from 0 to ``2**bit_depth - 1``. ``path``: for the message."""
    if not (isinstance(frame, np.ndarray) and frame.dtype.kind in "iu"):
        try:
            frame = as_numbers(frame, f"{path}: frame {number}", dtype=np.int64)
        except VisionInputError as error:
            raise FilmError(str(error)) from None
    if shape is not None and frame.shape != shape:
        raise FilmError(f"{path}: frame {number} has shape {frame.shape}, the first has {shape}")
    if shape is None and (frame.ndim != 2 or 0 in frame.shape):
        raise FilmError(f"{path}: frame {number} has shape {frame.shape}, needs (height, width)")
    top = (1 << bit_depth) - 1
    if 8 * frame.dtype.itemsize > bit_depth or frame.dtype.kind == "i":
        low, high = int(frame.min()), int(frame.max())
        if low < 0 or high > top:
            raise FilmError(f"{path}: frame {number} holds {low}..{high}, {bit_depth} bit hold 0..{top}")
    return frame


Box = tuple[int, int, int, int]


class Repeats:
    """Compares frames with the one before, inside a rectangle (y0, y1, x0, x1)."""

    def __init__(self, film: FrameSource, box: Box) -> None:
        self._film, self._box = film, box
        y0, y1 = box[:2]
        # one row tells nearly all frames apart; the whole frame before is read again only where that is cheap
        self._kept = (y0, y1) if getattr(film, "in_order", True) else ((y0 + y1) // 2, (y0 + y1) // 2 + 1)
        self._newest: tuple[int, NDArray[Any]] | None = None
        # a codec that predicts frames from others repeats what stands still
        self.meaningful = film.compression is None or film.compression.steps is not None

    @property
    def line(self) -> tuple[int, int, int]:
        """Row y and columns x0..x1-1 that differ between nearly all frames that are not repeated."""
        return self._kept[0], self._box[2], self._box[3]

    def is_repeat(self, index: int) -> bool:
        """Whether frame ``index`` is equal, inside the rectangle, to the one before; False for the first frame, for
        rectangles of one grey value, and where the codec predicts frames from others. Reads both frames."""
        if not self.meaningful or index < 1:
            return False
        if self._newest is None or self._newest[0] != index - 1:
            self._newest = (index - 1, self._read(index - 1, self._kept))
        before, here = self._newest[1], self._read(index, self._kept)
        self._newest = (index, here)
        if not np.array_equal(here, before):
            return False
        rows = self._box[:2]
        if self._kept != rows:
            before, here = self._read(index - 1, rows), self._read(index, rows)
        # without contrast (a dark or a saturated frame) equal bytes mean nothing
        return bool(np.array_equal(here, before) and here.min() != here.max())

    def _read(self, index: int, rows: tuple[int, int]) -> NDArray[Any]:
        # a copy: some readers give a view of a window that moves
        return np.array(self._film.read_region(index, *rows, *self._box[2:]))
