"""Write AVI films: MJPEG with a chosen quality, or lossless. Own container, OpenCV encodes the pictures.

OpenCV's video writers are not used: the one on FFmpeg ignores the quality and drops frames above 1000 frames/s, the
built-in one spoils grey pictures (OpenCV 5.0, found by tests). The film appears under its name only when complete.

Format: AVI 1.0 (RIFF): header list, ``movi`` list with one ``00dc`` chunk per frame, ``idx1`` index. Lossless grey
films are ``Y800`` (8 bit per pixel, top row first), colour ones uncompressed BGR (bottom row first, rows padded to
four bytes).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.errors import FilmError
from vision.files import whole_file
from vision.film.source import check_frame

MAX_BYTES = 2**31 - 2**20
HEADER_BYTES = 12 + 8 + 4 + (8 + 56) + (8 + 4 + (8 + 56) + (8 + 40)) + 12


def write_avi(
    path: str | os.PathLike[str],
    frames: Iterable[ArrayLike],
    frame_rate_hz: float,
    *,
    quality: int | None = 95,
    progress: Callable[[int], None] | None = None,
) -> int:
    """Write 8-bit frames, grey (h, w) or BGR (h, w, 3), as AVI.

    Parameters
    ----------
    path : path
        Ends in ``.avi``.
    frames : iterable of ndarray of uint8
    frame_rate_hz : float
        Rate written into the file.
    quality : int or None
        JPEG quality 1..100; None stores losslessly.
    progress : callable, optional
        Called with the number of frames written.

    Returns
    -------
    int
        Number of frames written.

    Raises
    ------
    FilmError
        Frames that do not fit, a film beyond 2 GB, or a folder that cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> vision.write_avi("grey.avi", [np.full((48, 64), level, np.uint8) for level in (50, 100)], 25.0, quality=None)
    2
    """
    path = Path(path)
    if path.suffix.lower() != ".avi":
        raise FilmError(f"{path}: an AVI film must end in .avi")
    if not 0.0 < frame_rate_hz < 1e6:
        raise FilmError(f"{path}: frame rate {frame_rate_hz} Hz; needs a positive number below 1e6")
    if quality is not None and not 1 <= quality <= 100:
        raise FilmError(f"{path}: JPEG quality {quality}; allowed 1..100, or None for no loss")
    shape: tuple[int, ...] | None = None
    sizes: list[int] = []
    with whole_file(path, FilmError, "check folder and disk") as temporary, temporary.open("wb") as file:
        file.write(b"\0" * HEADER_BYTES)
        for given in frames:
            frame = check_frame(path, given, shape, 8, len(sizes), colour=True).astype(np.uint8, copy=False)
            shape = frame.shape
            data = _encode(path, frame, quality)
            if file.tell() + len(data) > MAX_BYTES:
                raise FilmError(f"{path}: larger than 2 GB after {len(sizes)} frames; write MRAW, or fewer frames")
            file.write(b"00dc" + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2))
            sizes.append(len(data))
            if progress is not None:
                progress(len(sizes))
        if shape is None:
            raise FilmError(f"{path}: no frames to write")
        _finish(file, shape, sizes, frame_rate_hz, quality)
    return len(sizes)


def _encode(path: Path, frame: NDArray[Any], quality: int | None) -> bytes:
    if quality is not None:
        ok, data = cv2.imencode(".jpg", np.ascontiguousarray(frame), [cv2.IMWRITE_JPEG_QUALITY, quality])
        if not ok:
            raise FilmError(f"{path}: a frame of shape {frame.shape} cannot be encoded as JPEG")
        return bytes(data.tobytes())
    if frame.ndim == 2:
        return frame.tobytes()
    height, width, _ = frame.shape
    rows = np.zeros((height, (3 * width + 3) // 4 * 4), dtype=np.uint8)
    rows[:, : 3 * width] = frame[::-1].reshape(height, 3 * width)
    return rows.tobytes()


def _finish(
    file: BinaryIO, shape: tuple[int, ...], sizes: list[int], frame_rate_hz: float, quality: int | None
) -> None:
    """Append the index and write the header, whose sizes are known only now."""
    movi_bytes = file.tell() - HEADER_BYTES
    offset = 4
    file.write(b"idx1" + struct.pack("<I", 16 * len(sizes)))
    for size in sizes:
        # 0x10: every frame is a key frame
        file.write(b"00dc" + struct.pack("<III", 0x10, offset, size))
        offset += 8 + size + size % 2
    total = file.tell()
    height, width = shape[:2]
    grey = len(shape) == 2
    code = b"MJPG" if quality is not None else (b"Y800" if grey else b"\0\0\0\0")
    bits = 8 if grey and quality is None else 24
    scale = 1000
    rate = max(1, round(frame_rate_hz * scale))
    largest = max(sizes)
    microseconds = max(1, round(1e6 / frame_rate_hz))
    main = struct.pack("<14I", microseconds, 0, 0, 0x10, len(sizes), 0, 1, largest, width, height, 0, 0, 0, 0)
    stream = struct.pack(
        "<4s4s10I4H", b"vids", code, 0, 0, 0, scale, rate, 0, len(sizes), largest, 0xFFFFFFFF, 0, 0, 0, width, height
    )
    picture = struct.pack("<IiiHH4sIiiII", 40, width, height, 1, bits, code, largest, 0, 0, 0, 0)
    stream_list = b"strl" + _chunk(b"strh", stream) + _chunk(b"strf", picture)
    header = b"hdrl" + _chunk(b"avih", main) + _chunk(b"LIST", stream_list)
    file.seek(0)
    file.write(b"RIFF" + struct.pack("<I", total - 8) + b"AVI " + _chunk(b"LIST", header))
    file.write(b"LIST" + struct.pack("<I", movi_bytes + 4) + b"movi")


def _chunk(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<I", len(data)) + data
