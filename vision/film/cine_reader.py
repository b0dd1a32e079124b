"""Phantom .cine films, read lazily: grey or interpolated colour of 8 or 16 bit, or grey packed to 10 or 12 bit.

Format: Vision Research, The Cine File Format (2011 and later). Little-endian without padding: a file header (magic
``CI``) with the places of a Windows bitmap header, of the camera's settings (magic ``ST`` at byte 140), and of a table
with one 64-bit place per image; before its pixels each image has a note whose first word is its length and whose last
is the size of the pixels. Rows of uncompressed images run from the bottom to the top, those of packed ones downwards.
Between settings and table lie tagged blocks, among them the time of each image (kind 1002: seconds since 1970 in units
of 2^-32). What this reader does not know (the raw mosaic of a colour sensor, compressed, flipped for display) is
refused, not guessed.

Cameras pack to 10 bit with the curve of ITU-R BT.709 between code 64 (black) and 1014 (white); values are read back
linear, of 12 bit with black at 64 and white at 4064. The format's table of 1,024 values differs from the curve by at
most two counts of 4,095 (`tests/vision/film/test_cine_reader.py` against pycine), a quarter of a code at the top.
"""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError, VisionWarning
from vision.film.mmap_window import FileWindow
from vision.film.mraw import unpack12_region
from vision.film.source import Film, to_grey

FILE_HEADER = struct.Struct("<2sHHHiIiIIIIQ")
BITMAP_HEADER = struct.Struct("<IiiHHI")
MARK_AT, LENGTH_AT = 140, 142
SETTINGS = {"flip_h": (756, "i"), "flip_v": (760, "i"), "rate": (768, "I"), "shutter_us": (772, "I"), "cfa": (808, "I"),
            "bits": (896, "I"), "shutter_ns": (1568, "I")}  # fmt: skip
"""Place and type of what is used of the camera's settings; the last ones only newer files have."""
IMAGE_TIMES = 1002
PLAIN, PACKED_10, PACKED_12 = 0, 256, 1024
BLACK_CODE, WHITE_CODE, FULL_CODE = 64, 1014, 1015
BLACK_GREY, WHITE_GREY, FULL_GREY = 64, 4064, 4095
MOST_FRAMES = 50_000_000


class CineFilm(Film):
    """One .cine file.

    Parameters
    ----------
    allow_truncated : read up to the last whole image instead of refusing a file that was cut short
    channel : {"red", "green", "blue"}, optional; of a colour film, take this channel; weighted as the eye does when
        None
    """

    has_camera_times = True

    def __init__(self, path: Path, *, allow_truncated: bool = False, channel: str | None = None) -> None:
        self.path = path
        self._channel = channel
        self._file = FileWindow(path)
        try:
            self._read_headers(allow_truncated)
        except struct.error:
            self._file.close()
            raise FilmError(f"{path}: ends within its header; copy the film again") from None
        except FilmError:
            self._file.close()
            raise

    def _read_headers(self, allow_truncated: bool) -> None:
        """Read the headers and set size, depth, rate, exposure, offsets and times of the images; `FilmError` for a
        damaged file or a kind that is not read."""
        magic, _, compression, _, _, _, first, n, at_bitmap, at_settings, at_table, trigger = self._unpack(
            FILE_HEADER, 0
        )
        if magic != b"CI":
            raise FilmError(f"{self.path}: begins with {magic!r}, a Phantom film with b'CI'; it is no .cine film")
        _, self.width, height, _, bits, packing = self._unpack(BITMAP_HEADER, at_bitmap)
        self.height = abs(height)
        settings = self._read_settings(at_settings)
        self._refuse_unknown(compression, bits, packing, settings)
        if not (0 < self.width <= 65_536 and 0 < self.height <= 65_536 and 0 < n <= MOST_FRAMES):
            raise FilmError(f"{self.path}: the header says {n} images of {self.width} x {self.height}; it is damaged")
        self._packing = packing
        self._colours = 3 if bits in (24, 48) else 1
        if self._channel is not None and self._colours == 1:
            raise FilmError(f"{self.path}: is a grey film; leave the channel ({self._channel}) out")
        self._value_bytes = 1 if bits in (8, 24) else 2
        stated = settings["bits"]
        plain = 8 if self._value_bytes == 1 else stated if 8 < stated <= 16 else 16
        self.bit_depth = plain if packing == PLAIN else 12
        self.frame_rate_hz = float(settings["rate"]) or None
        self.exposure_s = settings["shutter_ns"] * 1e-9 or settings["shutter_us"] * 1e-6 or None
        pixels = self.width * self.height
        self._row_bytes = self.width * self._colours * self._value_bytes
        self._image_bytes = {
            PLAIN: self._row_bytes * self.height,
            PACKED_10: (pixels + 3) // 4 * 5,
            PACKED_12: (pixels + 1) // 2 * 3,
        }[packing]
        self.start_frame = first
        self._note_offset = self._read_note_offsets(at_table, n, allow_truncated)
        self.n_frames = len(self._note_offset)
        self._shift = self._unused_low_bits()
        self._time_s = self._read_image_times(at_settings + settings["length"], at_table, trigger)

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """Middle of each exposure, (n_frames,), s after the trigger: from the images' own times, else from their
        numbers and the rate; None where the file states neither."""
        half = 0.5 * (self.exposure_s or 0.0)
        if self._time_s is not None:
            return self._time_s + half
        if self.frame_rate_hz is None:
            return None
        return (self.start_frame + np.arange(self.n_frames, dtype=float)) / self.frame_rate_hz + half

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rows ``y0..y1-1`` and columns ``x0..x1-1`` of a frame, grey; only the memory pages with its rows
        are touched."""
        self._check_index(index)
        self._check_region(y0, y1, x0, x1)
        start = self._find_pixels(int(self._note_offset[index]), index)
        if self._packing == PACKED_10:
            first, last = y0 * self.width, y1 * self.width
            data = self._file.view(start + first // 4 * 5, start + (last + 3) // 4 * 5)
            rows = _unpack10(data)[first % 4 : first % 4 + last - first].reshape(y1 - y0, self.width)
            return LINEAR[rows[:, x0:x1]]
        if self._packing == PACKED_12:
            low, high = y0 * self.width, y1 * self.width
            data = self._file.view(start + low // 2 * 3, start + (high + 1) // 2 * 3)
            return unpack12_region(data, low % 2, self.width, y1 - y0, x0, x1)
        # the last row is stored first
        below, above = (self.height - y1) * self._row_bytes, (self.height - y0) * self._row_bytes
        data = self._file.view(start + below, start + above).reshape(y1 - y0, self._row_bytes)
        lines: NDArray[Any] = data.view("<u2" if self._value_bytes == 2 else np.uint8)[::-1]
        if self._shift:
            lines = lines >> self._shift
        if self._colours == 1:
            return lines[:, x0:x1]
        colour = lines.reshape(y1 - y0, self.width, 3)[:, x0:x1]
        return to_grey(np.ascontiguousarray(colour), self._channel)

    def _unused_low_bits(self) -> int:
        """Number of low bits to shift out of 16-bit values; sets ``bit_depth`` to what the values fill, with a warning
        where the header says less.

        Where both halves are used the values fill all 16 bits, whatever the header says.
        """
        spare = 16 - self.bit_depth
        if self._packing != PLAIN or self._value_bytes == 1 or spare == 0:
            return 0
        used = 0
        for index in {0, self.n_frames // 2, self.n_frames - 1}:
            start = self._find_pixels(int(self._note_offset[index]), index)
            used |= int(np.bitwise_or.reduce(self._file.view(start, start + self._image_bytes).view("<u2")))
        if used >> self.bit_depth == 0:
            return 0
        if used & ((1 << spare) - 1) == 0:
            return spare
        warnings.warn(
            f"{self.path}: its header says {self.bit_depth} bit, its values fill 16; they are read as 16 bit",
            VisionWarning,
            stacklevel=6,
        )
        self.bit_depth = 16
        return 0

    def _unpack(self, layout: struct.Struct, at: int) -> tuple[Any, ...]:
        return layout.unpack(self._file.view(at, min(at + layout.size, self._file.size)).tobytes())

    def _read_settings(self, offset: int) -> dict[str, int]:
        """The camera's settings by name, from the block at byte ``offset``; 0 for those that an older block lacks."""
        mark, length = self._unpack(struct.Struct("<2sH"), offset + MARK_AT)
        if mark != b"ST":
            raise FilmError(
                f"{self.path}: the camera's settings lack their mark; the file is damaged or too old to read"
            )
        known = {"length": int(length)}
        for name, (place, kind) in SETTINGS.items():
            known[name] = int(self._unpack(struct.Struct("<" + kind), offset + place)[0]) if place + 4 <= length else 0
        return known

    def _refuse_unknown(self, compression: int, bits: int, packing: int, settings: dict[str, int]) -> None:
        """Raise `FilmError` for a film that is compressed, a sensor's raw mosaic, packed in an unknown way,
        or flipped."""
        words = None
        colour = bits in (24, 48)
        if compression != 0 or bits not in (8, 16, 24, 48):
            words = f"compressed (kind {compression}) or of unknown pixels ({bits} bit)"
        elif settings["cfa"] != 0 and not colour:
            words = f"the raw mosaic of a colour sensor (colour filter {settings['cfa']})"
        elif packing not in (PLAIN, PACKED_10, PACKED_12) or (packing != PLAIN and colour):
            words = f"packed as {packing} with {bits} bit"
        elif settings["flip_h"] or settings["flip_v"]:
            words = "flipped for display, and the file does not tell whether its pixels are"
        if words is not None:
            raise FilmError(f"{self.path}: {words}; save it uncompressed, in grey or interpolated colour")

    def _read_note_offsets(self, table_offset: int, n: int, allow_truncated: bool) -> NDArray[np.int64]:
        """Byte at which the note of each image begins, (n,), from the table of ``n`` images at byte ``table_offset``;
        `FilmError` where an image lies beyond the end of the file, with ``allow_truncated`` those before it, if any."""
        if table_offset + 8 * n > self._file.size:
            raise FilmError(f"{self.path}: ends within the table of its {n} images; copy the film again")
        table = self._file.view(table_offset, table_offset + 8 * n).view("<i8").astype(np.int64)
        # a note has eight bytes at least
        beyond = np.flatnonzero((table <= 0) | (table > self._file.size - 8 - self._image_bytes))
        if beyond.size and not (allow_truncated and beyond[0]):
            raise FilmError(
                f"{self.path}: image {beyond[0]} of {n} lies beyond the end of the file ({self._file.size} bytes); "
                "copy the film again, or read what is whole with `allow_truncated`"
            )
        whole = table[: beyond[0]] if beyond.size else table
        for index in (0, len(whole) - 1):
            self._find_pixels(int(whole[index]), index)
        return whole

    def _find_pixels(self, note_offset: int, index: int) -> int:
        """Byte at which the pixels of image ``index`` begin, whose note begins at ``note_offset``; `FilmError` where
        note and size disagree."""
        note = int(self._unpack(struct.Struct("<I"), note_offset)[0])
        if note < 8 or note_offset + note + self._image_bytes > self._file.size:
            raise FilmError(
                f"{self.path}: image {index} has a note of {note} bytes, which is none; the file is damaged"
            )
        stored = int(self._unpack(struct.Struct("<I"), note_offset + note - 4)[0])
        if stored != self._image_bytes:
            raise FilmError(
                f"{self.path}: image {index} has {stored} bytes, but {self.width} x {self.height} pixels need "
                f"{self._image_bytes}; the file is damaged"
            )
        return note_offset + note

    def _read_image_times(self, offset: int, end: int, trigger: int) -> NDArray[np.float64] | None:
        """Time of each image after the trigger (units of 2^-32 s since 1970), s, from the tagged blocks in bytes
        ``offset..end-1``; None where they do not hold it, `FilmError` where times do not increase."""
        block = struct.Struct("<IHH")
        while offset + block.size <= end:
            size, kind, _ = self._unpack(block, offset)
            if size < block.size or offset + size > end:
                return None
            if kind == IMAGE_TIMES and size - block.size >= 8 * self.n_frames:
                stamps = self._file.view(offset + block.size, offset + block.size + 8 * self.n_frames).view("<u8")
                # whole numbers first: in seconds since 1970 a float resolves a quarter of a microsecond
                after = stamps.astype(np.int64) - np.int64(trigger)
                time_s = after.astype(float) / 2.0**32
                if np.any(np.diff(time_s) <= 0.0):
                    raise FilmError(
                        f"{self.path}: the images' own times do not increase; give frame times of their number"
                    )
                return time_s
            offset += size
        return None


def _unpack10(packed: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Five bytes hold four codes, the highest bits first."""
    five = packed.reshape(-1, 5).astype(np.uint16)
    codes = np.empty((len(five), 4), dtype=np.uint16)
    for i in range(4):
        codes[:, i] = ((five[:, i] << (2 + 2 * i)) | (five[:, i + 1] >> (6 - 2 * i))) & 0x3FF
    return codes.reshape(-1)


def _linear_grey() -> NDArray[np.uint16]:
    """Grey value of each 10-bit code (ITU-R BT.709-6, item 1.2, solved for the light)."""
    signal = (np.arange(1024) - BLACK_CODE) / (WHITE_CODE - BLACK_CODE)
    light = np.where(signal < 0.081, signal / 4.5, ((np.maximum(signal, 0.0) + 0.099) / 1.099) ** (1.0 / 0.45))
    grey = np.rint(BLACK_GREY + (WHITE_GREY - BLACK_GREY) * light)
    grey[FULL_CODE:] = FULL_GREY
    return grey.astype(np.uint16)


LINEAR = _linear_grey()
