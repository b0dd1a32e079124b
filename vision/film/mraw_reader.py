"""Lazy reader of Photron MRAW films, 8, 12 or 16 bit per pixel.

A window of the file is memory-mapped and moves along with the reading; a region touches only the pages of its own
rows. So memory does not grow with the film.

Format: frames follow one another without padding, row after row. 8 bit: one byte; 16 bit: little-endian
words; 12 bit: two pixels in three bytes, the first pixel in the upper twelve bits (checked on a film of a
FASTCAM Nova S16). Geometry, depth and times come from the header next to it (`vision.film.cih_header`). A file whose
size is not exactly the one its header implies is refused with both sizes (`FilmError`).
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError, VisionWarning
from vision.film.cih_header import FilmHeader, contradiction, read_header
from vision.film.mmap_window import FileWindow
from vision.film.source import Film


class MrawFilm(Film):
    """A Photron MRAW film with its CIH or CIHX header.

    Parameters
    ----------
    path : Path
        The ``.mraw`` or its header.
    allow_truncated : bool
        Accept a file that is too short and read its whole frames.

    Attributes
    ----------
    header : FilmHeader
    """

    def __init__(self, path: Path, *, allow_truncated: bool = False) -> None:
        data_path, header_path = _pair(path)
        self.path = data_path
        self.header = header = read_header(header_path)
        self.height, self.width = header.height, header.width
        self.bit_depth = header.effective_bit
        self.frame_rate_hz, self.exposure_s = header.frame_rate_hz, header.exposure_s
        self.n_frames = header.n_frames
        wrong = contradiction(header)
        if wrong is not None:
            warnings.warn(
                f"{header_path}: {wrong}; its frame times are not believed: give --frame-rate",
                VisionWarning,
                stacklevel=3,
            )
        size = data_path.stat().st_size
        expected = film_bytes(header)
        if size != expected:
            whole = 8 * size // (header.width * header.height * header.colour_bit)
            words = (
                f"{data_path}: {size} bytes, but the header {header_path.name} describes {header.n_frames} frames of "
                f"{header.width} x {header.height} at {header.colour_bit} bit = {expected} bytes"
            )
            if size > expected:
                raise FilmError(f"{words}; the header does not belong to this film")
            if not allow_truncated or whole < 1:
                raise FilmError(f"{words}; the film is cut short ({whole} whole frames): copy it again")
            self.n_frames = whole
        self._file = FileWindow(data_path)
        self._check_bit_side()

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """Middle of each exposure, s after the camera's trigger, for the frames that were saved."""
        if self.frame_rate_hz is None or contradiction(self.header) is not None:
            return None
        number = self.header.start_frame + self.header.frame_step * np.arange(self.n_frames, dtype=float)
        return number / self.frame_rate_hz + 0.5 * (self.exposure_s or 0.0)

    def _check_bit_side(self) -> None:
        """Refuse a header whose side of the effective bits the first frame contradicts."""
        depth = self.bit_depth
        if self.header.colour_bit != 16 or depth >= 16:
            return
        frame = self._file.view(0, 2 * self.width * self.height).view("<u2")
        used = int(np.bitwise_or.reduce(frame))
        spare = 16 - depth
        higher = self.header.bit_side == "higher"
        if (used & ((1 << spare) - 1)) if higher else (used >> depth):
            side, other = ("Higher", "lower") if higher else ("Lower", "higher")
            self._file.close()
            raise FilmError(
                f"{self.path}: the header says EffectiveBit Side {side} with {depth} of 16 bit, but {other} bits of "
                "the first frame are set too; correct side or depth in the header"
            )

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width), uint8 or uint16."""
        return self.read_region(index, 0, self.height, 0, self.width)

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rectangle of a frame; only the pages with its rows are touched."""
        self._check_index(index)
        self._check_region(y0, y1, x0, x1)
        first = index * self.width * self.height
        bits = self.header.colour_bit
        # whole bytes that hold the wanted rows; 12-bit pixels come in pairs
        low = first + y0 * self.width
        high = first + y1 * self.width
        if bits == 12:
            start = low // 2 * 3
            data = self._file.view(start, min((high + 1) // 2 * 3, self._file.size))
            return unpack12_region(data, low % 2, self.width, y1 - y0, x0, x1)
        pixel_bytes = bits // 8
        data = self._file.view(low * pixel_bytes, high * pixel_bytes)
        region = data.view("<u2" if bits == 16 else np.uint8).reshape(y1 - y0, self.width)[:, x0:x1]
        if bits == 16 and self.header.bit_side == "higher" and self.bit_depth < 16:
            region = region >> (16 - self.bit_depth)
        return region

    def frames(self, start: int, end: int) -> NDArray[Any] | None:
        """Frames ``start..end-1`` as they lie in the file, read-only; None where grey values are packed or shifted."""
        bits, size = self.header.colour_bit, self.width * self.height * self.header.colour_bit // 8
        if bits not in (8, 16) or (bits == 16 and self.header.bit_side == "higher" and self.bit_depth < 16):
            return None
        data = self._file.view(start * size, end * size).view(np.uint16 if bits == 16 else np.uint8)
        return data.reshape(end - start, self.height, self.width)

    def close(self) -> None:
        """Close the file; frames already read stay valid."""
        self._file.close()


def film_bytes(header: FilmHeader) -> int:
    """Size of the MRAW file that a header describes, bytes."""
    return (header.n_frames * header.width * header.height * header.colour_bit + 7) // 8


def unpack12_region(data: NDArray[np.uint8], skip: int, width: int, rows: int, x0: int, x1: int) -> NDArray[np.uint16]:
    """Unpack columns ``x0..x1-1`` of ``rows`` rows of 12-bit pixels.

    ``data`` starts with the pair of pixels that holds the first one; ``skip`` is 1 when that is the second of
    its pair.
    """
    if width % 2 == 0 and skip == 0:
        # every row starts on a whole byte: unpack only the wanted columns
        left, right = x0 - x0 % 2, x1 + x1 % 2
        lines = data[: rows * 3 * width // 2].reshape(rows, 3 * width // 2)
        packed = lines[:, left // 2 * 3 : right // 2 * 3].reshape(rows, -1, 3)
        return _unpack12(packed).reshape(rows, right - left)[:, x0 - left : x1 - left]
    if data.size % 3:
        # the last pixel of an odd number of them ends in the middle of a byte
        data = np.concatenate([data, np.zeros(3 - data.size % 3, dtype=np.uint8)])
    flat = _unpack12(data.reshape(-1, 3)).reshape(-1)[skip : skip + rows * width]
    return flat.reshape(rows, width)[:, x0:x1]


def _unpack12(packed: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """(..., n, 3) bytes to (..., n, 2) values."""
    middle = packed[..., 1].astype(np.uint16)
    out = np.empty((*packed.shape[:-1], 2), dtype=np.uint16)
    out[..., 0] = (packed[..., 0].astype(np.uint16) << 4) | (middle >> 4)
    out[..., 1] = ((middle & 15) << 8) | packed[..., 2]
    return out


def _pair(path: Path) -> tuple[Path, Path]:
    """The film and its header, whichever of the two was named."""
    if path.suffix.lower() == ".mraw":
        headers = [path.with_suffix(suffix) for suffix in (".cihx", ".cih", ".CIHX", ".CIH")]
        for header in headers:
            if header.exists():
                return path, header
        raise FilmError(f"{path}: header {headers[0].name} or {headers[1].name} is missing; put it next to the film")
    for suffix in (".mraw", ".MRAW"):
        if path.with_suffix(suffix).exists():
            return path.with_suffix(suffix), path
    raise FilmError(f"{path}: film {path.with_suffix('.mraw').name} is missing; put it next to its header")
