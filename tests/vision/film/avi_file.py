"""AVI films for the tests of the readers: MJPEG of a stated quality, lossless grey or colour.

Format: AVI 1.0 (RIFF): header list, ``movi`` list with one ``00dc`` chunk per frame, ``idx1`` index. Lossless grey
films are ``Y800`` (top row first), colour ones uncompressed BGR (bottom row first, rows padded to four bytes).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

HEADER_BYTES = 12 + 8 + 4 + (8 + 56) + (8 + 4 + (8 + 56) + (8 + 40)) + 12


def write_avi(path: Path, frames: Iterable[ArrayLike], frame_rate_hz: float, *, quality: int | None = 95) -> int:
    """Write frames of uint8, grey (h, w) or BGR (h, w, 3); return their number. A ``quality`` of None is lossless."""
    sizes: list[int] = []
    with path.open("wb") as file:
        file.write(b"\0" * HEADER_BYTES)
        for given in frames:
            frame = np.asarray(given, dtype=np.uint8)
            data = _encode(frame, quality)
            file.write(b"00dc" + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2))
            sizes.append(len(data))
        _finish(file, frame.shape, sizes, frame_rate_hz, quality)
    return len(sizes)


def _encode(frame: NDArray[Any], quality: int | None) -> bytes:
    if quality is not None:
        _, data = cv2.imencode(".jpg", np.ascontiguousarray(frame), [cv2.IMWRITE_JPEG_QUALITY, quality])
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
