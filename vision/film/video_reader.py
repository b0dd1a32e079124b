"""Container video (AVI, MOV, MP4, MKV), decoded by FFmpeg through PyAV: luma as stored, with the stamp of every frame.

Frames whose codec stores each alone are read in any order, by several threads; those predicted from others in order,
on FFmpeg's own threads; of these the newest are kept, and a step back beyond them goes to the start. A seek is
believed only when the packet it lands on is known from the index.

Grey is the luma plane, without a conversion; of RGB and palette pictures OpenCV's or FFmpeg's weights make it. Luma of
limited range stays as it is: ``white_grey`` says where white is. A picture that the file wants turned or mirrored for
display is turned, which is said.

Rows stored from the bottom upwards have a negative step in FFmpeg's memory, which a plane's buffer does not follow.
"""

from __future__ import annotations

import threading
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError, VisionWarning
from vision.film.orientation import Picture, interpret_display_matrix
from vision.film.source import Compression, Film, NewestFrame, jpeg_compression, to_grey
from vision.film.video_index import (
    NO_JPEG,
    VideoIndex,
    choose_video,
    index_video,
    is_limited,
    jpeg_is_whole,
    open_container,
    packet_key,
)

PACKED_LUMA = {"yuyv422": 0, "yvyu422": 0, "uyvy422": 1}
"""First byte of luma in formats that store it between the colours."""
NEAR = 16  # frames that are decoded and thrown away rather than sought
KEPT_BYTES = 64 * 2**20
"""Of the newest frames of a film that is decoded in sequence, at 3 bytes a pixel: a step back begins anew only beyond
them, so that a pass backward takes the time of few forward."""


class VideoFilm(Film):
    """A film in a video container.

    ``frame_rate_hz`` and ``frame_time_s`` are what the container says, which for high-speed film is often the scale of
    play-back: `vision.frame_times_at_rate` gives those of the true rate.

    Attributes
    ----------
    spacing : how the stamps follow one another
    codec : FFmpeg's name
    """

    def __init__(self, path: Path, *, allow_truncated: bool = False, channel: str | None = None) -> None:
        self.path, self._channel = path, channel
        self._index = index = index_video(path, allow_truncated)
        self._local = threading.local()
        self._open: list[_Decoder] = []
        self._newest = NewestFrame()
        self.n_frames, self.codec, self.spacing = index.n_frames, index.codec, index.spacing
        self.in_order = not index.is_standalone
        self.frame_rate_hz, self.is_interlaced = index.rate_hz, index.is_interlaced
        self.first_field = index.first_field if index.is_interlaced else None
        if self.n_frames < 1:
            raise FilmError(f"{path}: holds no frame; the film is cut short or no video")
        self.bit_depth = _bits(path, index.pixel_format)
        if channel is not None and index.pixel_format.startswith(("gray", "mono")):
            raise FilmError(f"{path}: is a grey film; leave the channel ({channel}) out")
        if channel is not None:
            self.bit_depth = 8 if self.bit_depth == 8 else 16
        elif index.is_limited:
            self.white_grey = 235 << (self.bit_depth - 8)  # white of limited range, ITU-R BT.601
        self._orient(index)
        self._set_compression(index)
        for remark in index.remarks:
            warnings.warn(f"{path}: {remark}", VisionWarning, stacklevel=3)

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """Stamps of the frames, s after the first, or the camera's times from a header beside the film."""
        if self.camera_time_s is not None:
            return self.camera_time_s
        if self._index.stamp_s is None:
            return super().frame_time_s
        return self._index.stamp_s[: self.n_frames] + 0.5 * (self.exposure_s or 0.0)

    def read(self, index: int) -> Picture:
        self._check_index(index)
        return self._newest.get(index, self._decode_frame)

    def close(self) -> None:
        while self._open:
            self._open.pop().close()
        self._local = threading.local()

    def _decode_frame(self, index: int) -> Picture:
        """Decode a frame to grey, upright; `FilmError` for one unlike the first."""
        decoder = getattr(self._local, "decoder", None)
        if decoder is None:
            decoder = self._local.decoder = _Decoder(self.path, self._index)
            self._open.append(decoder)
        frame = decoder.frame(index)
        if (frame.width, frame.height, frame.format.name) != (
            self._index.width,
            self._index.height,
            self._index.pixel_format,
        ):
            self._refuse(
                index,
                f"is {frame.width} x {frame.height} {frame.format.name}, the first {self._index.width} x "
                f"{self._index.height} {self._index.pixel_format}",
            )
        if frame.interlaced_frame and not self.is_interlaced:
            self._refuse(index, "is interlaced, those before are not; export progressive frames")
        if is_limited(frame) != self._index.is_limited:
            self._refuse(index, "has another range of grey than the first")
        grey = _grey(frame, self._channel)
        return grey if self._turned is None else self._turned(grey)

    def _refuse(self, index: int, words: str) -> NoReturn:
        raise FilmError(f"{self.path}: frame {index} of {self.n_frames} {words}; the film is damaged or two in one")

    def _orient(self, index: VideoIndex) -> None:
        """Set the displayed size, the pixel aspect and the function that turns a stored picture upright; warns where it
        is turned, `FilmError` for other angles than right ones and for interlaced frames that would mix their fields.
        """
        self.width, self.height, self.pixel_aspect = index.width, index.height, index.pixel_aspect
        self._turned: Callable[[Picture], Picture] | None = None
        if index.display_matrix is None:
            return
        turned = interpret_display_matrix(index.display_matrix)
        if turned is None:
            raise FilmError(
                f"{self.path}: is to be shown turned by an angle that is no multiple of 90 deg; export it as taken"
            )
        words, is_transposed, self._turned = turned
        if self._turned is None:
            return
        if self.is_interlaced and (is_transposed or words == "mirrored top to bottom" or "180" in words):
            raise FilmError(
                f"{self.path}: its frames are interlaced, and its file wants them {words}; export it as taken"
            )
        if is_transposed:
            self.width, self.height = self.height, self.width
            self.pixel_aspect = 1.0 / self.pixel_aspect if self.pixel_aspect else None
        warnings.warn(f"{self.path}: its file wants the picture {words}, which is done", VisionWarning, stacklevel=4)

    def _set_compression(self, index: VideoIndex) -> None:
        """Set ``compression`` by what the codec loses; warn where its loss cannot be stated."""
        if index.codec == "mjpeg":
            self.compression = jpeg_compression(self.path, index.first_packet, stacklevel=4)
        if index.is_lossless or self.compression is not None:
            return
        self.compression = Compression(None)
        warnings.warn(
            f"{self.path}: codec {index.codec} predicts frames from their neighbours, or hides its loss, so angles "
            "will be worse than stated; export raw or MJPEG film",
            VisionWarning,
            stacklevel=4,
        )


class _Decoder:
    """One decoder of a film's frames, at a place in it."""

    def __init__(self, path: Path, index: VideoIndex) -> None:
        self._path, self._index = path, index
        self._open_stream()

    def close(self) -> None:
        self._container.close()

    def frame(self, number: int) -> Any:
        """Decoded PyAV frame ``number``, counted from 0 as shown; `FilmError` where that fails."""
        # start-up: PyAV costs 0.1 s, films of cameras do without
        import av

        try:
            return self._decode_standalone(number) if self._index.is_standalone else self._decode_in_sequence(number)
        except (av.error.FFmpegError, StopIteration, OSError, ValueError) as error:
            said = getattr(error, "strerror", None) or "it is not there"
            raise FilmError(
                f"{self._path}: frame {number} of {self._index.n_frames} cannot be decoded ({said}); the film is "
                "damaged"
            ) from None

    def _open_stream(self) -> None:
        """Open the file anew, to be decoded from its first frame."""
        self._container = open_container(self._path)
        self._stream = choose_video(self._container)
        if self._index.is_standalone:
            # damage of one frame concerns no other
            self._stream.codec_context.options = {"err_detect": "crccheck+bitstream+buffer+explode"}
            self._stream.thread_type = "SLICE"
        else:
            self._stream.thread_type = "AUTO"
        self._next = 0
        self._kept: deque[Any] = deque(maxlen=max(2, KEPT_BYTES // (3 * self._index.width * self._index.height)))
        self._packets = self._packets_of(self._container.demux(self._stream))
        self._frames = self._container.decode(self._stream) if not self._index.is_standalone else iter(())

    @staticmethod
    def _packets_of(packets: Iterator[Any]) -> Iterator[Any]:
        return (packet for packet in packets if packet.size)

    def _decode_in_sequence(self, number: int) -> Any:
        """Decode on to frame ``number``, from the first one where it lies behind what is kept; return it."""
        if number < self._next - len(self._kept):
            self.close()
            self._open_stream()
        while self._next <= number:
            self._kept.append(next(self._frames))
            self._next += 1
        return self._kept[number - self._next]

    def _decode_standalone(self, number: int) -> Any:
        """Decode frame ``number`` from its own packet, read on or sought, and return it as PyAV does."""
        wanted = int(self._index.packet_of[number])
        if not self._next <= wanted <= self._next + NEAR:
            self._seek(wanted)
        while True:
            packet = next(self._packets)
            self._next += 1
            if self._next > wanted:
                break
        size = self._index.width, self._index.height
        if self._index.codec == "mjpeg" and not jpeg_is_whole(bytes(packet), *size):
            raise FilmError(f"{self._path}: {NO_JPEG.format(number, *size)}")
        context = self._stream.codec_context
        frames = packet.decode()
        if not frames:
            # a decoder that holds a frame back gives it when told that none follows
            frames = context.decode(None)
            context.flush_buffers()
        if not frames or frames[0].is_corrupt:
            raise StopIteration
        return frames[0]

    def _seek(self, wanted: int) -> None:
        """Put the reader of packets at packet ``wanted`` (its index) or before it, at the start of the file where it
        lands elsewhere."""
        self._container.seek(int(self._index.seek_ticks[wanted]), stream=self._stream, backward=True)
        first = next(packets := self._packets_of(self._container.demux(self._stream)), None)
        landed = None if first is None else self._index.packet_number.get(packet_key(first))
        if landed is None or landed > wanted:
            self.close()
            self._open_stream()
            return
        self._next, self._packets = landed, chain([first], packets)


def _bits(path: Path, pixel_format: str) -> int:
    """Bits of a grey value, 8 to 16, of a film of a PyAV pixel format; `FilmError` for the raw mosaic of a colour
    sensor."""
    # start-up: as above
    import av

    if pixel_format.startswith("bayer"):
        raise FilmError(f"{path}: holds the raw mosaic of a colour sensor ({pixel_format}); export grey or colour")
    form = av.VideoFormat(pixel_format)
    bits = max([8, *(int(one.bits) for one in form.components[:1])])  # as most formats
    # colours of more bits are widened to 16
    return 16 if form.is_rgb and bits > 8 else bits


def _colours(frame: Any) -> Picture:
    """Blue, green and red of a decoded frame, (height, width, 3), of 16 bit where it has more than 8."""
    if int(frame.format.components[0].bits) > 8:
        return np.ascontiguousarray(frame.to_ndarray(format="rgb48le")[..., ::-1])
    return np.asarray(frame.to_ndarray(format="bgr24"))


def _grey(frame: Any, channel: str | None) -> Picture:
    """Grey values (height, width) of a decoded PyAV frame, those of ``channel`` (red, green, blue) where named; a view
    of the frame where they lie in it as such."""
    form = frame.format
    name, height, width = form.name, frame.height, frame.width
    if channel is not None or (form.is_rgb and name != "pal8"):
        return to_grey(_colours(frame), channel)
    plane = frame.planes[0]
    is_upright = plane.line_size > 0
    if name in PACKED_LUMA and is_upright:
        rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[:height, : 2 * width]
        return rows[:, PACKED_LUMA[name] :: 2]
    bits = int(form.components[0].bits)
    is_plane = (form.is_planar or len(form.components) == 1) and is_upright
    if name == "pal8" or not is_plane or bits < 8 or (bits > 8 and not name.endswith("le")):
        return np.asarray(frame.to_ndarray(format="gray16le" if bits > 8 else "gray"))
    if bits == 8:
        return np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[:height, :width]
    rows = np.frombuffer(plane, "<u2").reshape(-1, plane.line_size // 2)[:height, :width]
    # the formats of hardware decoders have their bits in the upper half
    return rows >> (16 - bits) if name.startswith(("p0", "p2", "p4")) else rows
