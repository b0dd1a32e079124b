"""Index of a container video: which frames it shows, at which stamps, and how they are stored.

Packets are read without being decoded. Those that the container discards (cut off by an edit list) are no frames. A
codec that predicts frames from others is then decoded once: how many frames come out, with which stamps, and whether
they are interlaced, is known only then. Frames that stand alone or are stored without loss, a packet each, are checked
when they are read.

A film that announces more frames than it holds is refused: it was cut short.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError
from vision.film.source import jpeg_ends, jpeg_segments
from vision.film.time_scale import Spacing, classify_spacing

if TYPE_CHECKING:
    import av

FIELD_ORDERS = {2: "even", 3: "odd"}
"""FFmpeg's codes of field orders that all containers mean alike."""
LIMITED_RANGE = 1  # FFmpeg's code of luma between 16 and 235
STANDALONE = frozenset(["ffv1", "png"])
"""Not listed by FFmpeg as coding every frame alone, but they do when all packets are key frames."""
COARSE_TICK = 0.02  # of a frame's time: at 1,000/s a tick of 20 us, a standard uncertainty of 6 us
HELD = 8  # indices kept, so that opening a film again within a command decodes nothing twice


NO_JPEG = "frame {} is not a whole JPEG picture of {} x {}; export the film again, or copy it again"


def jpeg_is_whole(data: bytes, width: int, height: int) -> bool:
    """Whether a JPEG ends with its mark and states a film's size, or half its rows (a field): a decoder would fill up
    what breaks off, and allocate for any size."""
    if not jpeg_ends(data):
        return False
    for kind, at in jpeg_segments(data):
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC) and at + 5 <= len(data):
            rows, columns = (int.from_bytes(data[at + k : at + k + 2], "big") for k in (1, 3))
            return columns == width and rows in (height, (height + 1) // 2)
    return False


@dataclass(frozen=True)
class VideoIndex:
    """What is known of a video before its frames are asked for."""

    codec: str
    tag: str
    is_lossless: bool
    width: int
    height: int
    n_frames: int
    # (n_frames,), of films whose frames stand alone: the packet of each frame, counted as they
    # lie in the file
    packet_of: NDArray[np.int64]
    # packet by its place in the file, stamp and size; None where two are the same
    packet_number: dict[tuple[Any, ...], int | None]
    seek_ticks: NDArray[np.int64]  # (n_packets,)
    is_standalone: bool  # every packet is one frame, decoded without any other
    stamp_s: NDArray[np.float64] | None  # (n_frames,)
    spacing: Spacing | None
    tick_s: float
    rate_hz: float | None
    is_interlaced: bool
    first_field: str | None
    is_limited: bool
    pixel_format: str
    pixel_aspect: float | None
    # a, b, c, d of the matrix that turns the stored picture into the shown one
    display_matrix: tuple[int, int, int, int] | None
    first_packet: bytes
    remarks: tuple[str, ...]
    damage: str


@dataclass
class _Packets:
    """Packets in the order of the file; ``empty`` counts chunks without a frame."""

    pts: list[int | None]
    dts: list[int | None]
    key: list[tuple[Any, ...]]
    shown: list[bool]
    is_key: list[bool]
    first: bytes = b""
    empty: int = 0
    n_discarded: int = 0
    is_damaged: bool = False


def packet_key(packet: av.Packet) -> tuple[Any, ...]:
    return packet.pos, packet.pts, packet.dts, packet.size


def open_container(path: Path) -> av.container.InputContainer:
    """PyAV container, for the caller to close, of a file with a video that FFmpeg decodes; `FilmError` for all else."""
    # start-up: PyAV costs 0.1 s, films of cameras do without
    import av

    if not path.is_file():
        raise FilmError(f"{path}: cannot be opened; give an existing film")
    try:
        container = av.open(str(path), metadata_errors="ignore")
    except (av.error.FFmpegError, ValueError, OSError) as error:
        raise FilmError(f"{path}: cannot be decoded; the file is damaged or no video ({_error_text(error)})") from None
    if not container.streams.video:
        container.close()
        raise FilmError(f"{path}: cannot be decoded; it holds no video")
    if choose_video(container).codec_context is None:
        container.close()
        raise FilmError(f"{path}: cannot be decoded; its codec is not known to FFmpeg")
    return container


def choose_video(container: av.container.InputContainer) -> Any:
    """The video of a container that is the film: the largest, the first of these; a title picture only alone."""
    return max(container.streams.video, key=_size_as_film)


def _size_as_film(stream: Any) -> int:
    """Pixels of a video stream; 0 where it is none, or a cover picture."""
    # start-up: as above
    import av

    context = stream.codec_context
    if context is None or stream.disposition & av.stream.Disposition.attached_pic:
        return 0
    return int(context.width) * int(context.height)


def _error_text(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)


def index_video(path: Path, allow_truncated: bool) -> VideoIndex:
    """Index of a video, read once while the file does not change; `FilmError` for one that is damaged, unless
    ``allow_truncated``."""
    if not path.is_file():
        raise FilmError(f"{path}: cannot be opened; give an existing film")
    state = path.stat()
    index = _build_index(path.resolve(), path, state.st_mtime_ns, state.st_size)
    if index.damage and not allow_truncated:
        raise FilmError(f"{path}: {index.damage}")
    return index


@lru_cache(maxsize=HELD)
def _build_index(_resolved: Path, path: Path, _changed_ns: int, _size: int) -> VideoIndex:
    """Read the index of the video at ``path``; it is kept in memory while resolved path, time of change, ns, and size,
    bytes, are the same, which serve as its key only."""
    with open_container(path) as container:
        stream = choose_video(container)
        packets = _demux(path, container, stream)
        context = stream.codec_context
        n_shown = sum(packets.shown)
        damage = _describe_missing(container, stream, packets)
        codec = context.codec
        remarks = []
        videos = [one for one in container.streams.video if _size_as_film(one)]
        if len(videos) > 1:
            sizes = ", ".join(f"{one.codec_context.width} x {one.codec_context.height}" for one in videos)
            remarks.append(
                f"holds {len(videos)} videos ({sizes}), of which number {videos.index(stream) + 1}, the largest, is "
                "read"
            )
        cut_off = packets.n_discarded
        if cut_off:
            kept = len(packets.shown) - cut_off
            remarks.append(f"shows {kept} of {kept + cut_off} stored frames (an edit list cuts off the others)")
        # the palette of a film lies in its first packet only
        is_standalone = (
            all(packets.is_key)
            and (codec.intra_only or codec.name in STANDALONE)
            and getattr(context, "pix_fmt", None) != "pal8"
        )
        facts: dict[str, Any] = {
            "codec": codec.name,
            "tag": _tag(context),
            "is_lossless": bool(codec.lossless and not codec.lossy),
            "first_packet": packets.first,
            "tick_s": float(stream.time_base),
            "pixel_aspect": float(stream.sample_aspect_ratio) if stream.sample_aspect_ratio else None,
        }
        is_avi = container.format.name == "avi"
        average = stream.average_rate
        rate = 0.0 if average is None else float(average)
        states_rate = is_avi or "matroska" in container.format.name
    is_counted = is_standalone or facts["is_lossless"]
    (first, first_field), pts, is_interlaced, undecoded = _decode_stamps(path, is_counted, packets.first)
    damage = damage or undecoded
    if is_counted:
        order = _shown_order(packets, is_avi)
        stamps = [(packets.dts if is_avi else packets.pts)[k] for k in order]
    else:
        order = list(range(len(pts)))
        if len(pts) != n_shown:
            remarks.append(f"{n_shown} stored frames decode to {len(pts)}")
        # an AVI has no stamps but the places of its chunks, which decoders mix up with the order of prediction
        shown_dts = [dts for dts, shown in zip(packets.dts, packets.shown, strict=True) if shown]
        if is_avi and None not in shown_dts and (len(pts) == n_shown or (damage and len(pts) < n_shown)):
            stamps = sorted(shown_dts)[: len(pts)]  # type: ignore[type-var]  # no None
        else:
            stamps = pts
    try:
        stamp_s, spacing = _convert_stamps(stamps, facts["tick_s"], 1.0 / rate if states_rate and rate > 0.0 else None)
    except FilmError as error:
        # damage is the cause, not the stamps
        raise FilmError(f"{path}: {damage or f'{error}; export the film again'}") from None
    if spacing is not None and spacing.kind == "variable" and facts["tick_s"] > COARSE_TICK * spacing.interval_s:
        remarks.append(
            f"its time stamps are rounded to {1e3 * facts['tick_s']:g} ms, and so are the times of its frames"
        )
    if spacing is not None and spacing.interval_s < 0.99 * facts["tick_s"]:
        remarks.append(
            f"its time stamps are rounded to {1e3 * facts['tick_s']:g} ms, and a frame lasts "
            f"{1e3 * spacing.interval_s:.3g} ms: frames left out would not show in them"
        )
    return VideoIndex(
        **facts,
        **_read_picture_facts(first),
        n_frames=len(order),
        packet_of=np.array(order, dtype=np.int64),
        packet_number=_numbers(packets),
        seek_ticks=_seek_ticks(packets, is_avi),
        is_standalone=is_standalone,
        stamp_s=stamp_s,
        spacing=spacing,
        rate_hz=1.0 / spacing.interval_s if spacing is not None else (rate if 0.0 < rate < 1e9 else None),
        is_interlaced=is_interlaced or context_is_interlaced(context),
        first_field=first_field or FIELD_ORDERS.get(int(getattr(context, "field_order", 0) or 0)),
        remarks=tuple(remarks),
        damage=damage,
    )


def find_first_field(frame: Any) -> str | None:
    """Rows, ``even`` or ``odd``, of an interlaced PyAV frame that were exposed first: those that FFmpeg's filter
    ``separatefields`` gives first; None where both fields show the same or the filter fails."""
    # start-up: as above
    import av

    graph = av.filter.Graph()
    try:
        source = graph.add_buffer(
            width=frame.width,
            height=frame.height,
            format=frame.format.name,
            time_base=frame.time_base or Fraction(1, 1000),
        )
        fields, sink = graph.add("separatefields"), graph.add("buffersink")
        source.link_to(fields)
        fields.link_to(sink)
        graph.configure()
        graph.push(frame)
        field = graph.pull()
    except (av.error.FFmpegError, ValueError):
        return None
    first, whole = (_bytes_of_rows(one) for one in (field, frame))
    is_first = [np.array_equal(first[: len(whole[k::2])], whole[k::2]) for k in (0, 1)]
    return None if is_first[0] == is_first[1] else "even" if is_first[0] else "odd"


def _bytes_of_rows(frame: Any) -> NDArray[np.uint8]:
    """Bytes of the first plane, as many of each row as every format has."""
    plane = frame.planes[0]
    return np.frombuffer(plane, np.uint8).reshape(-1, abs(plane.line_size))[: frame.height, : frame.width]


def context_is_interlaced(context: Any) -> bool:
    """Whether the container or the codec's header says that rows alternate (FFmpeg's field orders from 2 on)."""
    return int(getattr(context, "field_order", 0) or 0) >= 2


def _tag(context: Any) -> str:
    text = str(context.codec_tag).strip("\0 ")
    return text if text.isprintable() and text else context.codec.name


def _demux(path: Path, container: Any, stream: Any) -> _Packets:
    """Packets of a stream, read without decoding: times, keys, which are shown; `FilmError` where none is or reading
    fails."""
    # start-up: as above
    import av

    found = _Packets([], [], [], [], [])
    try:
        for packet in container.demux(stream):
            if packet.size == 0:
                found.empty += packet.dts is not None
                continue
            if not found.first:
                found.first = bytes(packet)
            found.pts.append(packet.pts)
            found.dts.append(packet.dts)
            found.key.append(packet_key(packet))
            found.shown.append(not (packet.is_discard or packet.is_corrupt))
            found.n_discarded += packet.is_discard
            found.is_key.append(packet.is_keyframe)
            found.is_damaged |= packet.is_corrupt
    except (av.error.FFmpegError, OSError) as error:
        raise FilmError(f"{path}: cannot be read to its end ({_error_text(error)}); copy it again") from None
    if not any(found.shown):
        raise FilmError(f"{path}: holds no frame; the film is cut short or no video")
    return found


def _describe_missing(container: Any, stream: Any, packets: _Packets) -> str:
    """What a film lacks of what it announces, in words; empty when it is whole."""
    # an AVI marks a frame that was left out by an empty chunk, which its decoder skips but counts
    dts = [at for at in packets.dts if at is not None]
    counted = len(packets.shown) + packets.empty
    if container.format.name == "avi" and dts:
        counted = max(counted, max(dts) + 1)
    if stream.frames and counted < stream.frames:
        return f"announces {stream.frames} frames but ends after {counted}; the film is cut short, copy it again"
    if packets.is_damaged:
        return "a frame ends before its container says; the film is cut short, copy it again"
    pts = [at for at in packets.pts if at is not None]
    if not stream.frames and container.duration and len(pts) > 2:
        tick_s = float(stream.time_base)
        spare_s = container.duration * 1e-6 - (max(pts) - min(pts)) * tick_s
        # the last frame lasts as long as the longest before it, and stamps are rounded
        longest_s = float(np.diff(np.sort(pts)).max()) * tick_s
        others = len(container.streams) > 1
        if spare_s > 2.0 * longest_s + 4.0 * tick_s and not others and min(pts) * tick_s < longest_s + tick_s:
            return (
                f"lasts {container.duration * 1e-6:.6g} s by its header, but its frames end {spare_s:.3g} s earlier; "
                "the film is cut short, copy it again"
            )
    return ""


def _decode_stamps(
    path: Path, is_counted: bool, first_packet: bytes
) -> tuple[tuple[Any, str | None], list[int | None], bool, str]:
    """Decode a video's first frame (``is_counted``), else all: (first PyAV frame, first field of the first interlaced
    one), stamps in ticks, whether any is interlaced, damage in words ('': none). ``first_packet``: bytes, checked where
    a JPEG."""
    # start-up: as above
    import av

    pts: list[int | None] = []
    first, first_field, is_interlaced, damage = None, None, False, ""
    with open_container(path) as container:
        stream = choose_video(container)
        context = stream.codec_context
        if not is_counted:
            # with several threads FFmpeg reports the damage of a frame in some runs only
            context.thread_count = 1
        elif context.name == "mjpeg" and not jpeg_is_whole(first_packet, context.width, context.height):
            raise FilmError(f"{path}: {NO_JPEG.format(0, context.width, context.height)}")
        try:
            for frame in container.decode(stream):
                if frame.is_corrupt and not is_counted:
                    raise av.error.InvalidDataError(0, "a frame is damaged")
                first = frame if first is None else first
                if frame.interlaced_frame and not is_interlaced:
                    is_interlaced, first_field = True, find_first_field(frame)
                pts.append(frame.pts)
                if is_counted:
                    break
        except (av.error.FFmpegError, OSError, ValueError) as error:
            damage = f"frame {len(pts)} cannot be decoded ({_error_text(error)}); the film is damaged, copy it again"
    if first is None:
        raise FilmError(f"{path}: {damage or 'frame 0 cannot be decoded; the film is damaged'}")
    return (first, first_field), pts, is_interlaced, damage


def _shown_order(packets: _Packets, is_avi: bool) -> list[int]:
    shown = [k for k, is_shown in enumerate(packets.shown) if is_shown]
    if is_avi or any(packets.pts[k] is None for k in shown):
        return shown
    return sorted(shown, key=lambda k: (packets.pts[k], k))


def _numbers(packets: _Packets) -> dict[tuple[Any, ...], int | None]:
    numbers: dict[tuple[Any, ...], int | None] = {}
    for number, key in enumerate(packets.key):
        numbers[key] = None if key in numbers else number
    return numbers


def _seek_ticks(packets: _Packets, is_avi: bool) -> NDArray[np.int64]:
    ticks = packets.dts if is_avi else packets.pts
    return np.array([0 if at is None else at for at in ticks], dtype=np.int64)


def _convert_stamps(
    stamps: list[int | None], tick_s: float, nominal_s: float | None
) -> tuple[NDArray[np.float64] | None, Spacing | None]:
    """Times (n,) from the first stamp on, s, on an even grid where the stamps, in ticks of ``tick_s``, lie near one,
    and their spacing; both None where stamps lack or are all the same. ``nominal_s``: interval that the file states, or
    None."""
    if len(stamps) < 2 or any(at is None for at in stamps) or len(set(stamps)) == 1:
        return None, None
    ticks = np.array(stamps, dtype=np.int64)
    stamp_s = (ticks - ticks[0]) * tick_s
    spacing = classify_spacing(stamp_s, tick_s, nominal_s)
    if spacing.kind == "even":
        stamp_s = np.arange(ticks.size) * spacing.interval_s
    elif spacing.kind == "gaps":
        whole_s = np.concatenate([[0.0], np.cumsum(1.0 + spacing.missing)]) * spacing.interval_s
        # what is off them is the rounding of the stamps, or else that of the camera's clock
        stamp_s = whole_s if np.ptp(stamp_s - whole_s) <= 2.0 * tick_s else stamp_s
    return stamp_s, spacing


def _read_picture_facts(frame: Any) -> dict[str, Any]:
    """Fields of `VideoIndex` that the first PyAV frame tells: size, pixel format, range of grey, display matrix."""
    # start-up: as above
    from av.sidedata.sidedata import Type

    matrix = None
    side = frame.side_data.get(Type.DISPLAYMATRIX)
    if side is not None:
        values = np.frombuffer(bytes(side), dtype=np.int32, count=9)
        matrix = (int(values[0]), int(values[1]), int(values[3]), int(values[4]))
    return {
        "width": frame.width,
        "height": frame.height,
        "pixel_format": frame.format.name,
        "is_limited": is_limited(frame),
        "display_matrix": matrix,
    }


def is_limited(frame: Any) -> bool:
    """Whether luma of a PyAV frame has the limited range 16 to 235: as the frame says, else yes unless grey or
    ``yuvj``; never for red, green, blue or a palette."""
    name = frame.format.name
    if frame.format.is_rgb or name == "pal8":
        return False
    if int(frame.color_range) == 0:
        return not name.startswith(("gray", "yuvj", "mono"))
    return int(frame.color_range) == LIMITED_RANGE
