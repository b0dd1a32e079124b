"""Photron films: pictures in MRAW, what they are in CIH or CIHX beside it; header, reader and writer.

Formats of the header, as found in files saved by the Photron FASTCAM Viewer 3 and 4: CIH is lines ``name : value``, the
picture's part ends at the first empty line. CIHX is 256 bytes of a fixed text padded with zeros, the magic
``CIHX``, version and number of sections as 32-bit integers, one (kind, offset, size) of 64-bit integers per
section, all little-endian; the section of kind 0 is an XML document with root ``cih``. The reader looks for
that document by its tags, since viewers differ in the rest. ``startFrame`` counts recorded frames from the
trigger; ``skipFrame`` is the step with which frames were saved. A header that lacks a field, or holds a value no film
can have, raises `FilmError`.

Format of the pictures: frames follow one another without padding, row after row. 8 bit: one byte; 16 bit: little-endian
words; 12 bit: two pixels in three bytes, the first pixel in the upper twelve bits (checked on a film of a
FASTCAM Nova S16). Geometry, depth and times come from the header next to it. A file whose
size is not exactly the one its header implies is refused with both sizes (`FilmError`).
"""

from __future__ import annotations

import os
import re
import struct
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.errors import FilmError, VisionWarning
from vision.files import remove, temporary_name
from vision.film.mmap_window import FileWindow
from vision.film.source import Film, check_frame

MAX_HEADER_BYTES = 4_000_000
_FIELDS = {
    "width": ("imageDataInfo/resolution/width", "Image Width"),
    "height": ("imageDataInfo/resolution/height", "Image Height"),
    "n_frames": ("frameInfo/totalFrame", "Total Frame"),
    "colour_bit": ("imageDataInfo/colorInfo/bit", "Color Bit"),
    "colour_type": ("imageDataInfo/colorInfo/type", "Color Type"),
    "effective_bit": ("imageDataInfo/effectiveBit/depth", "EffectiveBit Depth"),
    "bit_side": ("imageDataInfo/effectiveBit/side", "EffectiveBit Side"),
    "frame_rate_hz": ("recordInfo/recordRate", "Record Rate(fps)"),
    "shutter": ("recordInfo/shutterSpeed", "Shutter Speed(s)"),
    "shutter_ns": ("recordInfo/shutterSpeedNsec", "Shutter Type2(nsec)"),
    "start_frame": ("frameInfo/startFrame", "Start Frame"),
    "frame_step": ("frameInfo/skipFrame", "Save Step"),
    "recorded_frames": ("frameInfo/recordedFrame", "Original Total Frame"),
    "file_format": ("imageFileInfo/fileFormat", "File Format"),
    "comment": ("basicInfo/comment", "Comment Text"),
}


@dataclass(frozen=True)
class FilmHeader:
    """What a Photron header says about its film.

    ``colour_bit`` is the storage per pixel (8, 12 or 16), ``effective_bit`` how many of them carry light,
    ``bit_side`` whether these are the ``lower`` or ``higher`` ones. ``start_frame`` is the number, counted
    from the trigger, of the first frame saved; every ``frame_step``-th recorded frame was saved. ``exposure_s``
    is None when not stated.
    """

    width: int
    height: int
    n_frames: int
    colour_bit: int
    effective_bit: int
    bit_side: str = "lower"
    colour_type: str = "Mono"
    frame_rate_hz: float | None = None
    exposure_s: float | None = None
    start_frame: int = 0
    frame_step: int = 1
    recorded_frames: int | None = None
    comment: str = ""


def read_header(path: Path, *, is_mraw: bool = True) -> FilmHeader:
    """Read a ``.cih`` or ``.cihx`` file of an MRAW film, or (not ``is_mraw``) of one exported to another format;
    `FilmError` for what is damaged or not read."""
    try:
        size = path.stat().st_size
        if size > MAX_HEADER_BYTES:
            raise FilmError(f"{path}: header is larger than {MAX_HEADER_BYTES} bytes; this is not a Photron header")
        with path.open("rb") as file:
            # with the size: an unbounded read would set aside memory for all it allows
            data = file.read(size)
    except OSError as error:
        raise FilmError(f"{path}: header cannot be read ({error.strerror or error})") from None
    try:
        raw = _parse_cihx(data) if b"<cih>" in data else _parse_cih(data)
        return _build_header(raw, is_mraw)
    except FilmError as error:
        raise FilmError(f"{path}: {error}") from None


def find_contradiction(header: FilmHeader) -> str | None:
    """What a header says that cannot be true of its frames' times, in words; None when it agrees with itself."""
    recorded, step = header.recorded_frames, header.frame_step
    span = (header.n_frames - 1) * step + 1
    if recorded is not None and span > recorded:
        return f"{header.n_frames} frames, every {step}th of those recorded, need {span}, and {recorded} were recorded"
    if header.exposure_s and header.frame_rate_hz and header.exposure_s * header.frame_rate_hz > 1.001:
        return f"exposure {header.exposure_s:g} s is longer than a frame at {header.frame_rate_hz:g} frames/s"
    return None


def _parse_cihx(data: bytes) -> dict[str, str]:
    """Texts of a CIHX header, given as bytes, by the keys of `_FIELDS`, empty where missing; `FilmError` where it is
    cut short or no valid XML."""
    start, end = data.find(b"<cih>"), data.rfind(b"</cih>")
    if end < start:
        raise FilmError("header is cut short: <cih> is never closed; copy the .cihx file again")
    document = data[start : end + len(b"</cih>")]
    if b"<!" in document:
        raise FilmError("header holds an XML declaration that no camera writes; it is refused")
    try:
        root = ElementTree.fromstring(document.decode("utf-8", errors="replace"))
    except ElementTree.ParseError as error:
        raise FilmError(f"header is not valid XML ({error}); copy the .cihx file again") from None
    return {key: (root.findtext(xml_path) or "").strip() for key, (xml_path, _) in _FIELDS.items()}


def _parse_cih(data: bytes) -> dict[str, str]:
    """Texts of a CIH header, given as bytes, up to its first empty line, by the keys of `_FIELDS`; '' where missing."""
    text = data.decode("utf-8", errors="replace").replace("\r\n", "\n")
    lines: dict[str, str] = {}
    for line in text.split("\n\n", 1)[0].split("\n"):
        name, separator, value = line.partition(":")
        if separator:
            lines.setdefault(name.strip(), value.strip())
    return {key: lines.get(name, "") for key, (_, name) in _FIELDS.items()}


def _read_integer(raw: dict[str, str], key: str, low: int, high: int, default: int | None = None) -> int:
    text = raw[key]
    if not text and default is not None:
        return default
    if not re.fullmatch(r"[+-]?\d{1,18}", text) or not low <= int(text) <= high:
        raise FilmError(f"header field {_FIELDS[key][1]} is {text[:40]!r}, needs a whole number {low}..{high}")
    return int(text)


def _parse_frame_rate(raw: dict[str, str]) -> float | None:
    """Frames/s from a header's fields; None where it states none, `FilmError` where it is no positive number."""
    text = raw["frame_rate_hz"]
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < 1e9:
        raise FilmError(f"header field Record Rate(fps) is {text[:40]!r}, needs a positive number of frames/s")
    return value


def _parse_exposure(raw: dict[str, str]) -> float | None:
    """Shutter time, s, from a header's fields; None where none is stated. CIHX writes ``1/800000`` as the
    bare 800000."""
    if re.fullmatch(r"\d{1,15}", raw["shutter_ns"]) and int(raw["shutter_ns"]) > 0:
        return int(raw["shutter_ns"]) * 1e-9
    found = re.fullmatch(r"(?:1/)?(\d{1,12}(?:\.\d+)?)", raw["shutter"])
    if found is None or float(found[1]) <= 0.0:
        return None
    value = float(found[1])
    return 1.0 / value if raw["shutter"].startswith("1/") or value > 1.0 else value


def _build_header(raw: dict[str, str], is_mraw: bool) -> FilmHeader:
    """Header of a film from its fields; `FilmError` for values that no film can have and, of an MRAW film, for formats
    that are not read."""
    file_format = raw["file_format"] or "MRaw"
    if is_mraw and file_format.lower() != "mraw":
        raise FilmError(f"header says file format {file_format[:20]!r}, only MRaw is read; save the film as MRAW")
    colour_bit = _read_integer(raw, "colour_bit", 1, 48)
    kind = raw["colour_type"] or "Mono"
    if is_mraw and (kind.lower() not in ("mono", "raw") or colour_bit not in (8, 12, 16)):
        raise FilmError(
            f"header says colour type {kind[:20]!r} with {colour_bit} bit per pixel, readable are Mono or Raw "
            "with 8, 12 or 16; save the film in monochrome"
        )
    # one byte per sample holds at most eight bits, whatever the sensor had before saving
    effective = min(_read_integer(raw, "effective_bit", 1, 16, colour_bit), colour_bit)
    side = (raw["bit_side"] or "lower").lower()
    if side not in ("lower", "higher"):
        raise FilmError(f"header field EffectiveBit Side is {side[:20]!r}, needs Lower or Higher")
    limit = 10**12
    return FilmHeader(
        width=_read_integer(raw, "width", 1, 65535),
        height=_read_integer(raw, "height", 1, 65535),
        n_frames=_read_integer(raw, "n_frames", 1, limit),
        colour_bit=colour_bit,
        effective_bit=effective,
        bit_side=side,
        colour_type=kind,
        frame_rate_hz=_parse_frame_rate(raw),
        exposure_s=_parse_exposure(raw),
        start_frame=_read_integer(raw, "start_frame", -limit, limit, 0),
        frame_step=_read_integer(raw, "frame_step", 1, limit, 1),
        recorded_frames=_read_integer(raw, "recorded_frames", 0, limit, 0) or None,
        comment=raw["comment"],
    )


def cihx_bytes(header: FilmHeader) -> bytes:
    """Content of a CIHX file that describes a film by its header."""
    exposure = header.exposure_s
    # readers of this format expect the field; 0 stands for an exposure that is not known
    per_second, nanoseconds = (0, 0) if exposure is None else (round(1.0 / exposure), round(exposure * 1e9))
    shutter = f"<shutterSpeed>{per_second}</shutterSpeed>\r\n<shutterSpeedNsec>{nanoseconds}</shutterSpeedNsec>\r\n"
    rate = "" if header.frame_rate_hz is None else f"<recordRate>{header.frame_rate_hz:.12g}</recordRate>\r\n"
    size = f"<resolution><width>{header.width}</width><height>{header.height}</height></resolution>\r\n"
    last = header.start_frame + (header.n_frames - 1) * header.frame_step
    xml = (
        '<?xml version="1.0" encoding="utf-8"?>\r\n<cih>\r\n'
        "<fileInfo>\r\n<version>1.0</version>\r\n<date>1970/1/1</date>\r\n<time>00:00:00</time>\r\n</fileInfo>\r\n"
        "<imageFileInfo>\r\n<digitsOfFileNumber>6</digitsOfFileNumber>\r\n<fileFormat>Mraw</fileFormat>\r\n"
        f"{size}</imageFileInfo>\r\n<imageDataInfo>\r\n{size}"
        f"<colorInfo><type>{header.colour_type}</type><bit>{header.colour_bit}</bit></colorInfo>\r\n"
        f"<effectiveBit><depth>{header.effective_bit}</depth><side>{header.bit_side.capitalize()}</side>"
        "</effectiveBit>\r\n</imageDataInfo>\r\n<frameInfo>\r\n"
        f"<recordedFrame>{header.recorded_frames or last - header.start_frame + 1}</recordedFrame>\r\n"
        f"<totalFrame>{header.n_frames}</totalFrame>\r\n<startFrame>{header.start_frame}</startFrame>\r\n"
        f"<skipFrame>{header.frame_step}</skipFrame>\r\n<playbackEndFrameNo>{last}</playbackEndFrameNo>\r\n"
        f"<playbackStartFrameNo>{header.start_frame}</playbackStartFrameNo>\r\n</frameInfo>\r\n"
        f"<recordInfo>\r\n{rate}{shutter}</recordInfo>\r\n"
        "<deviceInfo>\r\n<deviceName>piano-action-rig</deviceName>\r\n</deviceInfo>\r\n"
        f"<basicInfo>\r\n<cameraName>Camera_1</cameraName>\r\n<comment>{escape(header.comment)}</comment>\r\n"
        "</basicInfo>\r\n</cih>\r\n"
    ).encode()
    # one section: kind 0, its offset (after this table) and its size
    offset = 256 + 4 + 8 + 24
    table = b"CIHX" + struct.pack("<IIQQQ", 1, 1, 0, offset, len(xml))
    return b"!!! This file can not be edited. !!!".ljust(256, b"\0") + table + xml


HEADER_SUFFIXES = (".cihx", ".cih", ".CIHX", ".CIH")


def apply_sidecar_header(film: Film) -> None:
    """Set header, rate, exposure and frame times of an exported film (AVI, TIFF, pictures) from the Photron header of
    the same name beside it, or in the folder of pictures, if any; one that does not fit is passed over with a warning.
    """
    path = film.path
    if path.is_dir():
        found = sorted(file for file in path.iterdir() if file.suffix in HEADER_SUFFIXES)
    else:
        found = [file for suffix in HEADER_SUFFIXES if (file := path.with_suffix(suffix)).is_file()]
    if not found:
        return
    try:
        header = read_header(found[0], is_mraw=False)
        wrong = find_contradiction(header)
    except FilmError as error:
        wrong = str(error)
    else:
        described = (header.n_frames, header.width, header.height)
        if described != (film.n_frames, film.width, film.height):
            wrong = "describes {} frames of {} x {}".format(*described)
        elif header.frame_rate_hz is None:
            wrong = "states no rate"
    if wrong is not None:
        warnings.warn(
            f"{found[0]}: {wrong}; {path.name} has {film.n_frames} of {film.width} x {film.height}, and its times are "
            "not taken from there",
            VisionWarning,
            stacklevel=4,
        )
        return
    film.header = header
    film.frame_rate_hz, film.exposure_s = header.frame_rate_hz, header.exposure_s
    film.camera_time_s, film.has_camera_times = saved_frame_times(header, film.n_frames), True


def saved_frame_times(header: FilmHeader, n_frames: int) -> NDArray[np.float64] | None:
    """Middle of each exposure, s after the camera's trigger, for the frames that were saved; None without a rate."""
    if header.frame_rate_hz is None:
        return None
    number = header.start_frame + header.frame_step * np.arange(n_frames, dtype=float)
    return number / header.frame_rate_hz + 0.5 * (header.exposure_s or 0.0)


class MrawFilm(Film):
    """A Photron MRAW film with its CIH or CIHX header.

    Parameters
    ----------
    path : the ``.mraw`` or its header
    allow_truncated : accept a file that is too short and read its whole frames
    """

    has_camera_times = True

    def __init__(self, path: Path, *, allow_truncated: bool = False, channel: str | None = None) -> None:
        if channel is not None:
            raise FilmError(f"{path}: films of this format are read in grey; leave the channel ({channel}) out")
        data_path, header_path = _find_film_and_header(path)
        self.path = data_path
        self.header = header = read_header(header_path)
        self.height, self.width = header.height, header.width
        self.bit_depth = header.effective_bit
        self.frame_rate_hz, self.exposure_s = header.frame_rate_hz, header.exposure_s
        self.n_frames = header.n_frames
        wrong = find_contradiction(header)
        if wrong is not None:
            warnings.warn(
                f"{header_path}: {wrong}; its frame times are not believed: give `frame_rate_hz`",
                VisionWarning,
                stacklevel=3,
            )
        size = data_path.stat().st_size
        expected = (header.n_frames * header.width * header.height * header.colour_bit + 7) // 8
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
        if self.frame_rate_hz is None or find_contradiction(self.header) is not None:
            return None
        return saved_frame_times(self.header, self.n_frames)

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

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rows ``y0..y1-1`` and columns ``x0..x1-1`` of a frame, grey; only the memory pages with its rows
        are touched."""
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


def unpack12_region(data: NDArray[np.uint8], skip: int, width: int, rows: int, x0: int, x1: int) -> NDArray[np.uint16]:
    """Grey values (rows, x1 - x0) of columns ``x0..x1-1`` of packed 12-bit rows of ``width`` pixels; ``data`` begins
    with the pair that holds the first pixel, ``skip`` is 1 where that is its pair's second."""
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


def _find_film_and_header(path: Path) -> tuple[Path, Path]:
    """Paths of an MRAW film and of its header, whichever of the two ``path`` names; `FilmError` where the other is
    missing."""
    if path.suffix.lower() == ".mraw":
        headers = [path.with_suffix(suffix) for suffix in HEADER_SUFFIXES]
        for header in headers:
            if header.exists():
                return path, header
        raise FilmError(f"{path}: header {headers[0].name} or {headers[1].name} is missing; put it next to the film")
    for suffix in (".mraw", ".MRAW"):
        if path.with_suffix(suffix).exists():
            return path.with_suffix(suffix), path
    raise FilmError(f"{path}: film {path.with_suffix('.mraw').name} is missing; put it next to its header")


def write_mraw(
    path: str | os.PathLike[str],
    frames: Iterable[ArrayLike],
    frame_rate_hz: float,
    *,
    bit_depth: int = 8,
    exposure_s: float | None = None,
    start_frame: int = 0,
    comment: str = "",
) -> int:
    """Write frames (height, width) of ``bit_depth`` 8, 12 or 16 as a Photron film ``….mraw`` with its CIHX header
    beside it, in place of those there; returns the number of frames. ``start_frame``: number of the first, counted from
    the trigger.

    Parameters
    ----------
    path : path
        Ends in ``.mraw``; the header is written next to it as ``.cihx``.
    frames : iterable of ndarray, shape (height, width)
        Whole numbers within ``0 .. 2**bit_depth - 1``.
    frame_rate_hz : float
    bit_depth : {8, 12, 16}
        Storage per pixel; 12 packs two pixels in three bytes.
    exposure_s : float or None
    start_frame : int
        Number of the first frame counted from the trigger.
    comment : str

    Returns
    -------
    int
        Number of frames written.

    Raises
    ------
    FilmError
        Frames that do not fit the stated format, or a folder that cannot be written; nothing is left behind.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> vision.write_mraw("grey.mraw", [np.full((48, 64), 900)] * 3, 2000.0, bit_depth=12)
    3
    """
    path = Path(path)
    if path.suffix != ".mraw":
        raise FilmError(f"{path}: an MRAW film must end in .mraw")
    if bit_depth not in (8, 12, 16):
        raise FilmError(f"{path}: bit depth {bit_depth} cannot be stored; choose 8, 12 or 16")
    if not 0.0 < frame_rate_hz < 1e9:
        raise FilmError(f"{path}: frame rate {frame_rate_hz} Hz; needs a positive number")
    header_path = path.with_suffix(".cihx")
    temporary, temporary_header = temporary_name(path), temporary_name(header_path)
    shape: tuple[int, ...] | None = None
    n_frames = 0
    try:
        try:
            with temporary.open("wb") as file:
                pending = np.empty(0, dtype=np.uint16)
                for given in frames:
                    frame = check_frame(path, given, shape, bit_depth, n_frames)
                    shape = frame.shape
                    if bit_depth == 12:
                        flat = np.concatenate([pending, frame.reshape(-1).astype(np.uint16)])
                        even = flat.size - flat.size % 2
                        pending = flat[even:]
                        file.write(pack12(flat[:even]))
                    else:
                        file.write(np.ascontiguousarray(frame, dtype="<u2" if bit_depth == 16 else np.uint8).data)
                    n_frames += 1
                if pending.size:
                    file.write(pack12(np.append(pending, 0).astype(np.uint16))[:2])
            if shape is None:
                raise FilmError(f"{path}: no frames to write")
            header = FilmHeader(
                width=shape[1],
                height=shape[0],
                n_frames=n_frames,
                colour_bit=bit_depth,
                effective_bit=bit_depth,
                colour_type="Mono" if bit_depth != 12 else "Raw",
                frame_rate_hz=frame_rate_hz,
                exposure_s=exposure_s,
                start_frame=start_frame,
                comment=comment,
            )
            temporary_header.write_bytes(cihx_bytes(header))
            _replace_film(path, temporary, header_path, temporary_header)
        except OSError as error:
            raise FilmError(f"{path}: cannot be written ({error.strerror or error}); check folder and disk") from None
    finally:
        remove(temporary)
        remove(temporary_header)
    return n_frames


def pack12(values: NDArray[np.uint16]) -> bytes:
    """Bytes of an even number of 12-bit values (n,), two in three bytes, the first in the upper bits."""
    first, second = values[0::2], values[1::2]
    out = np.empty((first.size, 3), dtype=np.uint8)
    out[:, 0] = first >> 4
    out[:, 1] = ((first & 15) << 4) | (second >> 8)
    out[:, 2] = second & 255
    return out.tobytes()


def _replace_film(path: Path, new_data: Path, header_path: Path, new_header: Path) -> None:
    """Rename new data and header to the names of a film, in place of an old one; an old header never describes new
    data, not even for a moment."""
    old_header = header_path.with_name(f".{header_path.name}.{os.getpid()}.old")
    had_header = header_path.exists()
    if had_header:
        os.replace(header_path, old_header)
    try:
        os.replace(new_data, path)
    except OSError:
        # the old film is in use (Windows): leave it as it was
        if had_header:
            os.replace(old_header, header_path)
        raise
    os.replace(new_header, header_path)
    remove(old_header)
