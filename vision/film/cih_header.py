"""Header of a Photron film: the text file CIH and the container CIHX.

Formats, as found in files saved by the Photron FASTCAM Viewer 3 and 4: CIH is lines ``name : value``, the
picture's part ends at the first empty line. CIHX is 256 bytes of a fixed text padded with zeros, the magic
``CIHX``, version and number of sections as 32-bit integers, one (kind, offset, size) of 64-bit integers per
section, all little-endian; the section of kind 0 is an XML document with root ``cih``. The reader looks for
that document by its tags, since viewers differ in the rest. ``startFrame`` counts recorded frames from the
trigger; ``skipFrame`` is the step with which frames were saved. A header that lacks a field, or holds a value no film
can have, raises `FilmError`.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from vision.errors import FilmError

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


def read_header(path: Path) -> FilmHeader:
    """Read a ``.cih`` or ``.cihx`` file; raises `FilmError` with the field, the value found and what is allowed."""
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
        raw = _fields_of_cihx(data) if b"<cih>" in data else _fields_of_cih(data)
        return _header(raw)
    except FilmError as error:
        raise FilmError(f"{path}: {error}") from None


def contradiction(header: FilmHeader) -> str | None:
    """What a header says that cannot be true of its frames' times, in words; None when it agrees with itself."""
    recorded, step = header.recorded_frames, header.frame_step
    span = (header.n_frames - 1) * step + 1
    if recorded is not None and span > recorded:
        return f"{header.n_frames} frames, every {step}th of those recorded, need {span}, and {recorded} were recorded"
    if header.exposure_s and header.frame_rate_hz and header.exposure_s * header.frame_rate_hz > 1.001:
        return f"exposure {header.exposure_s:g} s is longer than a frame at {header.frame_rate_hz:g} frames/s"
    return None


def _fields_of_cihx(data: bytes) -> dict[str, str]:
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


def _fields_of_cih(data: bytes) -> dict[str, str]:
    text = data.decode("utf-8", errors="replace").replace("\r\n", "\n")
    lines: dict[str, str] = {}
    for line in text.split("\n\n", 1)[0].split("\n"):
        name, separator, value = line.partition(":")
        if separator:
            lines.setdefault(name.strip(), value.strip())
    return {key: lines.get(name, "") for key, (_, name) in _FIELDS.items()}


def _whole(raw: dict[str, str], key: str, low: int, high: int, default: int | None = None) -> int:
    text = raw[key]
    if not text and default is not None:
        return default
    if not re.fullmatch(r"[+-]?\d{1,18}", text) or not low <= int(text) <= high:
        raise FilmError(f"header field {_FIELDS[key][1]} is {text[:40]!r}, needs a whole number {low}..{high}")
    return int(text)


def _rate(raw: dict[str, str]) -> float | None:
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


def _exposure(raw: dict[str, str]) -> float | None:
    """Shutter time: nanoseconds where stated, else ``1/800000``, which CIHX writes as the bare 800000."""
    if re.fullmatch(r"\d{1,15}", raw["shutter_ns"]) and int(raw["shutter_ns"]) > 0:
        return int(raw["shutter_ns"]) * 1e-9
    found = re.fullmatch(r"(?:1/)?(\d{1,12}(?:\.\d+)?)", raw["shutter"])
    if found is None or float(found[1]) <= 0.0:
        return None
    value = float(found[1])
    return 1.0 / value if raw["shutter"].startswith("1/") or value > 1.0 else value


def _header(raw: dict[str, str]) -> FilmHeader:
    file_format = raw["file_format"] or "MRaw"
    if file_format.lower() != "mraw":
        raise FilmError(f"header says file format {file_format[:20]!r}, only MRaw is read; save the film as MRAW")
    colour_bit = _whole(raw, "colour_bit", 1, 48)
    kind = raw["colour_type"] or "Mono"
    if kind.lower() not in ("mono", "raw") or colour_bit not in (8, 12, 16):
        raise FilmError(
            f"header says colour type {kind[:20]!r} with {colour_bit} bit per pixel, readable are Mono or Raw "
            "with 8, 12 or 16; save the film in monochrome"
        )
    # one byte per sample holds at most eight bits, whatever the sensor had before saving
    effective = min(_whole(raw, "effective_bit", 1, 16, colour_bit), colour_bit)
    side = (raw["bit_side"] or "lower").lower()
    if side not in ("lower", "higher"):
        raise FilmError(f"header field EffectiveBit Side is {side[:20]!r}, needs Lower or Higher")
    limit = 10**12
    return FilmHeader(
        width=_whole(raw, "width", 1, 65535),
        height=_whole(raw, "height", 1, 65535),
        n_frames=_whole(raw, "n_frames", 1, limit),
        colour_bit=colour_bit,
        effective_bit=effective,
        bit_side=side,
        colour_type=kind,
        frame_rate_hz=_rate(raw),
        exposure_s=_exposure(raw),
        start_frame=_whole(raw, "start_frame", -limit, limit, 0),
        frame_step=_whole(raw, "frame_step", 1, limit, 1),
        recorded_frames=_whole(raw, "recorded_frames", 0, limit, 0) or None,
        comment=raw["comment"],
    )


def cihx_bytes(header: FilmHeader) -> bytes:
    """Lay out a CIHX file for a film that starts at ``header.start_frame`` and was saved whole."""
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
