"""AVI, MP4 and similar films, decoded by OpenCV.

Frames are decoded in order and counted, since a seek inside a compressed film may land on another frame; going back
reopens the file. Colour is converted to grey with OpenCV's weights, or one channel is taken. An unreadable file, or one
that ends before the number of frames it announces, raises `FilmError`. Codecs that predict a frame from its neighbours
draw a `VisionWarning`: they hide noise on still frames and bias moving ones (errors of 9 to 55 mdeg where raw film
gives 2, measured with H.264).

Whether an MP4 or MOV file is as long as its container says is asked by a walk through its top-level boxes, before
decoding, because decoders hide a missing end: they fill up half a frame silently. Only sizes are read, nothing is
loaded. An AVI was walked by `vision.film.avi_reader` before it comes here; other containers (Matroska) are left to the
decoder.

Format (ISO base media): box = 32-bit big-endian size, four letters, with size 1 for a 64-bit size that follows and 0
for "to the end".
"""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from numpy.typing import NDArray

from vision.errors import FilmError, VisionWarning
from vision.film.source import Compression, Film, NewestFrame, grey_of, jpeg_compression

if TYPE_CHECKING:
    import cv2

MAX_CHUNKS = 100_000
BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
"""With which such a file begins."""


def check_whole(path: Path) -> None:
    """Raise `FilmError`, with both sizes, when the file ends before its container does."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            end = 0
            for _ in range(MAX_CHUNKS):
                file.seek(end)
                head = file.read(16)
                if len(head) < 8 or (end == 0 and head[4:8] not in BOXES):
                    return
                length = struct.unpack(">I", head[:4])[0]
                if length == 1 and len(head) == 16:
                    length = struct.unpack(">Q", head[8:])[0]
                if length == 0:  # "to the end": nothing to compare
                    return
                end += length
                if end > size:
                    raise FilmError(
                        f"{path}: {size} bytes, but its container needs {end}; the film is cut short, copy it again"
                    )
    except OSError as error:
        raise FilmError(f"{path}: cannot be read ({error.strerror})") from None


_LOSSLESS = """LJPG JPGL FFV1 HFYU FFVH MPNG DIB RAW Y800 Y8 GREY I420 IYUV YV12 YUY2 UYVY ULRG ULRA ULY0 MAGY"""
LOSSLESS = frozenset(["", *_LOSSLESS.split()])
"""Codecs that store what was seen; an empty code is uncompressed film."""
JPEG = frozenset(["MJPG", "MJPA", "AVRN"])


class VideoFilm(Film):
    """A film in a video container.

    ``frame_rate_hz`` is what the container says, which for high-speed film is often the play-back rate: give the
    tracker the true frame times.
    """

    in_order = True

    def __init__(self, path: Path, *, allow_truncated: bool = False, channel: str | None = None) -> None:
        # start-up: OpenCV costs 0.12 s, MRAW films do without
        import cv2

        self.path, self._channel = path, channel
        if not allow_truncated:
            check_whole(path)
        self._capture = self._open()
        self.width = int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        self.height = int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        announced = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        if not (0 < self.width <= 65535 and 0 < self.height <= 65535 and 1 <= announced < 1e9):
            raise FilmError(
                f"{path}: says {announced:g} frames of {self.width} x {self.height}; the file is cut short or not a "
                "video"
            )
        self.n_frames = self._countable(int(announced), allow_truncated)
        rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.frame_rate_hz = rate if 0.0 < rate < 1e9 else None
        self.codec = _four_letters(int(self._capture.get(cv2.CAP_PROP_FOURCC)))
        depth = _stored_bits(int(self._capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)))
        self._next = 0
        self._newest = NewestFrame()
        codec = self.codec.strip().upper()
        if codec in JPEG:
            self.compression = jpeg_compression(path, self._first_packet(), stacklevel=3)
        if codec not in LOSSLESS and self.compression is None:
            self.compression = Compression(None)
            warnings.warn(
                f"{path}: codec {self.codec} predicts frames from their neighbours, or hides its loss, so angles will "
                "be worse than stated; export raw or MJPEG film",
                VisionWarning,
                stacklevel=3,
            )
        if depth > 8:
            warnings.warn(
                f"{path}: stores {depth} bits a pixel, of which 8 are read; export it as .tif pages to keep them",
                VisionWarning,
                stacklevel=3,
            )

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width), uint8; fastest in order."""
        self._check_index(index)
        return self._newest.of(index, self._decoded)

    def _decoded(self, index: int) -> NDArray[Any]:
        if index < self._next:
            self._capture.release()
            self._capture = self._open()
            self._next = 0
        while self._next < index:
            if not self._capture.grab():
                self._ended(self._next)
            self._next += 1
        ok, picture = self._capture.read()
        if not ok or picture is None:
            self._ended(index)
        self._next = index + 1
        grey = grey_of(picture, self._channel)
        if grey.shape != (self.height, self.width):
            raise FilmError(
                f"{self.path}: frame {index} is {grey.shape[1]} x {grey.shape[0]}, the header says "
                f"{self.width} x {self.height}; the film is damaged"
            )
        return grey

    def _first_packet(self) -> bytes:
        """The first frame as it is stored; nothing where the decoder does not give it."""
        # start-up: as above
        import cv2

        capture = self._open()
        try:
            found, packet = capture.read() if capture.set(cv2.CAP_PROP_FORMAT, -1) else (False, None)
        finally:
            capture.release()
        return packet.tobytes() if found and packet is not None else b""

    def close(self) -> None:
        """Release the decoder."""
        self._capture.release()

    def _open(self) -> cv2.VideoCapture:
        # start-up: as above
        import cv2

        if not self.path.is_file():
            raise FilmError(f"{self.path}: cannot be opened; give an existing film")
        try:
            capture = cv2.VideoCapture(str(self.path), cv2.CAP_ANY)
        except cv2.error as error:
            raise FilmError(f"{self.path}: cannot be decoded ({error.err})") from None
        if not capture.isOpened():
            raise FilmError(f"{self.path}: cannot be decoded; the file is damaged or its codec is not known to OpenCV")
        return capture

    def _countable(self, announced: int, allow_truncated: bool) -> int:
        """Number of frames, after checking that the last one is there; a film cut short still announces all."""
        present = 0
        while present < announced and self._capture.grab():
            present += 1
        self._capture.release()
        if present < announced and not (allow_truncated and present > 0):
            raise FilmError(
                f"{self.path}: announces {announced} frames but ends after {present}; the film is cut short, copy it "
                "again"
            )
        self._capture = self._open()
        return present

    def _ended(self, index: int) -> NoReturn:
        raise FilmError(f"{self.path}: frame {index} of {self.n_frames} cannot be decoded; the film is damaged")


def _four_letters(code: int) -> str:
    text = code.to_bytes(4, "little", signed=code < 0).decode("latin-1")
    return text if text.isprintable() and text.strip("\0") else ""


def _stored_bits(pixel_format: int) -> int:
    """Bits of a stored value; FFmpeg's codes of deeper formats are ``Y``, a digit, the kind, and the number of bits."""
    letters = (pixel_format & 0xFFFFFFFF).to_bytes(4, "little")
    for code in (letters, letters[::-1]):
        if code[0:1] == b"Y" and code[1:2].isdigit() and 8 < code[3] <= 16:
            return code[3]
    return 8
