"""Own reader of AVI films with MJPEG or uncompressed frames, which most high-speed cameras write.

Other codecs go to `vision.film.opencv_video`. Every frame is found by walking the container, so that any frame can be
read directly and exactly, and uncompressed films give a region without reading the rest. OpenCV only decodes single
JPEG pictures: its FFmpeg reader aborts the whole process on uncompressed bottom-up films and fills up missing halves
of frames silently (OpenCV 5.0, found by tests).

Format: RIFF lists ``hdrl`` (``strh``, ``strf`` of the first video stream) and ``movi`` with chunks ``##dc``
or ``##db``, also inside ``rec`` lists and in the ``AVIX`` segments of large files. Uncompressed: 8 bit with
palette, 24 and 32 bit (bottom row first unless the height is negative), Y800, GREY and Y16. Colour becomes grey.
Chunks that reach beyond the file, fewer frames than announced, dropped frames, and JPEG pictures without an end or of
another size raise `FilmError`.
"""

from __future__ import annotations

import struct
from array import array
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError
from vision.film.mmap_window import FileWindow
from vision.film.source import Film, NewestFrame, grey_of, jpeg_compression, jpeg_segments

GREY_CODES = (b"Y800", b"GREY", b"Y8  ")
MAX_DEPTH = 4
LUMA = np.array([0.114, 0.587, 0.299])
"""Weights of blue, green, red (ITU-R BT.601)."""


class AviFilm(Film):
    """An AVI film whose frames are coded independently of each other.

    ``frame_rate_hz`` is what the file says, often the play-back rate. ``readable`` is False when the codec is not one
    of this reader's. ``allow_truncated`` reads a film that was cut short up to its last whole frame.
    """

    _row_bytes: int
    _pixel_bytes: int
    _bottom_up: bool
    _palette: NDArray[np.uint8] | None
    readable: bool

    def __init__(self, path: Path, *, allow_truncated: bool = False, channel: str | None = None) -> None:
        self.path, self._channel = path, channel
        self._allow_truncated = allow_truncated
        self._file = FileWindow(path)
        self._newest = NewestFrame()
        # arrays, not lists: a damaged film may hold a chunk every few bytes
        self._offset = array("q")
        self._size = array("q")
        self._stream: int | None = None
        self._streams = 0
        self._announced = 0
        self._format = b""
        self.frame_rate_hz = None
        self._walk_segments()
        if self._stream is None or len(self._format) < 40:
            self._refuse("holds no video stream")
        width, height, _, bits, code = struct.unpack("<iiHH4s", self._format[4:20])
        self.codec = "" if code == b"\0\0\0\0" else code.decode("latin-1")
        self.width, self.height, self._bits = width, abs(height), bits
        if not (0 < self.width <= 65535 and 0 < self.height <= 65535):
            self._refuse(f"says frames of {width} x {height}")
        grey = code in GREY_CODES
        self._row_bytes, self._pixel_bytes, self._bottom_up = 0, 0, False
        if code == b"\0\0\0\0" and bits in (8, 24, 32):
            self._pixel_bytes, self._bottom_up = bits // 8, height > 0
            self._row_bytes = (width * self._pixel_bytes + 3) // 4 * 4
        elif grey or code == b"Y16 ":
            self._pixel_bytes = 1 if grey else 2
            self._row_bytes = width * self._pixel_bytes
            padded = (self._row_bytes + 3) // 4 * 4
            if self._size and self._size[0] == padded * self.height:
                # some programs pad the rows of these films too
                self._row_bytes = padded
        elif code == b"\0\0\0\0":
            self._refuse(f"uncompressed with {bits} bit per pixel, readable are 8, 24 and 32")
        self.readable = self._pixel_bytes > 0 or code in (b"MJPG", b"mjpg")
        self.bit_depth = 16 if code == b"Y16 " else 8
        self._palette = self._grey_palette() if code == b"\0\0\0\0" and bits == 8 else None
        self.n_frames = len(self._offset)
        if self.readable:
            self._check_frames()
            self._read_compression()

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rectangle of a frame; of uncompressed films only its rows are read."""
        self._check_index(index)
        self._check_region(y0, y1, x0, x1)
        start = self._offset[index]
        if not self._pixel_bytes:
            return self._newest.of(index, self._jpeg)[y0:y1, x0:x1]
        top, bottom = (self.height - y1, self.height - y0) if self._bottom_up else (y0, y1)
        data = self._file.view(start + top * self._row_bytes, start + bottom * self._row_bytes)
        rows = data.reshape(bottom - top, self._row_bytes)[:, x0 * self._pixel_bytes : x1 * self._pixel_bytes]
        if self._bottom_up:
            rows = rows[::-1]
        if self._pixel_bytes == 1:
            return rows if self._palette is None else self._palette[rows]
        if self.bit_depth == 16:
            return np.ascontiguousarray(rows).view("<u2")
        colour = rows.reshape(y1 - y0, x1 - x0, self._pixel_bytes)[..., :3]
        if self._channel is not None:
            return grey_of(colour, self._channel)
        return np.rint(colour @ LUMA).astype(np.uint8)

    def _jpeg(self, index: int) -> NDArray[Any]:
        # start-up: OpenCV costs 0.12 s, MRAW and uncompressed films do without
        import cv2

        data = self._file.view(self._offset[index], self._offset[index] + self._size[index])
        # decoders fill up a picture that breaks off; its end mark shows that it is whole
        tail = data[-64:].tobytes().rstrip(b"\0")
        picture = None
        if data[:2].tobytes() == b"\xff\xd8" and tail.endswith(b"\xff\xd9") and self._fits(data):
            if self._channel is None:
                picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
            elif (coloured := cv2.imdecode(data, cv2.IMREAD_COLOR)) is not None:
                picture = grey_of(coloured, self._channel)
        if picture is None or picture.shape != (self.height, self.width):
            self._refuse(f"frame {index} is not a whole JPEG picture of {self.width} x {self.height}")
        return np.asarray(picture)

    def _fits(self, data: NDArray[np.uint8]) -> bool:
        """Whether a JPEG states the film's size: a decoder would believe any other and allocate for it."""
        for kind, at in jpeg_segments(data):
            if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC) and at + 5 <= data.size:
                height, width = (int(data[i]) * 256 + int(data[i + 1]) for i in (at + 1, at + 3))
                return (height, width) == (self.height, self.width)
        return False

    def _check_frames(self) -> None:
        if self.n_frames == 0 or (self.n_frames < self._announced and not self._allow_truncated):
            self._refuse(f"announces {self._announced} frames but holds {self.n_frames}: it is cut short")
        needed = self._row_bytes * self.height if self._pixel_bytes else 4
        for index, size in enumerate(self._size):
            if size < needed:
                self._refuse(f"frame {index} has {size} bytes, needs {needed}: it was dropped or cut short")
            if self._pixel_bytes and size > needed + max(self._row_bytes, 4096):
                self._refuse(
                    f"frame {index} has {size} bytes, {self.width} x {self.height} need {needed}: the header does not "
                    "describe these frames"
                )

    def _read_compression(self) -> None:
        """Note the steps of the first JPEG."""
        if not self._pixel_bytes:
            first = self._file.view(self._offset[0], self._offset[0] + self._size[0]).tobytes()
            self.compression = jpeg_compression(self.path, first, stacklevel=4)

    def _grey_palette(self) -> NDArray[np.uint8] | None:
        entries = np.frombuffer(self._format[40:], dtype=np.uint8)
        entries = entries[: entries.size // 4 * 4].reshape(-1, 4)[:256, :3]
        palette = np.arange(256, dtype=np.uint8)
        palette[: len(entries)] = (
            np.rint(entries @ LUMA) if self._channel is None else grey_of(entries[None], self._channel)[0]
        )
        return None if np.array_equal(palette, np.arange(256)) else palette

    def _walk_segments(self) -> None:
        place = 0
        while place + 12 <= self._file.size:
            name, size = self._head(place)
            if name != b"RIFF":
                if place == 0:
                    self._refuse("is not an AVI file")
                break
            end = place + 8 + size
            if end > self._file.size and self._allow_truncated:
                end = self._file.size
            if end > self._file.size:
                self._refuse(f"{self._file.size} bytes, but its container needs {end}: it is cut short")
            self._walk(place + 12, end, 0)
            place = end + size % 2

    def _walk(self, place: int, end: int, depth: int) -> None:
        while place + 8 <= end:
            name, size = self._head(place)
            data = place + 8
            if data + size > end and self._allow_truncated and end == self._file.size:
                if name != b"LIST":
                    # the frame in which the film breaks off
                    return
                size = end - data
            if data + size > end:
                self._refuse(f"chunk {name!r} at byte {place} reaches to {data + size}, its list ends at {end}")
            if name == b"LIST" and size >= 4:
                if depth >= MAX_DEPTH:
                    self._refuse("its lists are nested too deep")
                self._walk(data + 4, data + size, depth + 1)
            elif name == b"strh" and size >= 36:
                self._stream_header(self._file.view(data, data + 36).tobytes())
            elif name == b"strf" and self._stream == self._streams - 1 and not self._format:
                self._format = self._file.view(data, data + min(size, 40 + 1024)).tobytes()
            elif self._stream is not None and name in (b"%02ddc" % self._stream, b"%02ddb" % self._stream):
                if size == 0:
                    self._refuse(f"frame {len(self._offset)} is empty: it was dropped")
                self._offset.append(data)
                self._size.append(size)
            place = data + size + size % 2

    def _stream_header(self, header: bytes) -> None:
        self._streams += 1
        if header[:4] != b"vids" or self._stream is not None:
            return
        self._stream = self._streams - 1
        scale, rate, _, self._announced = struct.unpack("<IIII", header[20:36])
        value = rate / scale if scale else 0.0
        self.frame_rate_hz = value if 0.0 < value < 1e9 else None

    def _head(self, place: int) -> tuple[bytes, int]:
        head = self._file.view(place, place + 8).tobytes()
        return head[:4], struct.unpack("<I", head[4:])[0]

    def _refuse(self, words: str) -> NoReturn:
        self.close()
        raise FilmError(f"{self.path}: {words}; export the film again, or copy it again")
