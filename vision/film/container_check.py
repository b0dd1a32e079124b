"""Is a video file as long as its container says? Walks the top-level chunks of AVI (RIFF) and MP4/MOV (ISO base media).

Needed before decoding because decoders hide a missing end: they fill up half a frame silently. Only sizes are read,
nothing is loaded. Other containers (Matroska) are left to the decoder.

Formats: RIFF chunk = four letters, 32-bit size, data, padded to even; ISO box = 32-bit big-endian size, four letters,
with size 1 for a 64-bit size that follows and 0 for "to the end".
"""

from __future__ import annotations

import struct
from pathlib import Path

from vision.errors import FilmError

MAX_CHUNKS = 100_000


def check_whole(path: Path) -> None:
    """Raise `FilmError`, with both sizes, when the file ends before its container does."""
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(16)
            if head[:4] == b"RIFF":
                big_endian, header = False, 8
            elif head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
                big_endian, header = True, 0
            else:
                return
            place = 0
            for _ in range(MAX_CHUNKS):
                if place + 8 > size:
                    return
                file.seek(place)
                head = file.read(16)
                if big_endian:
                    length = struct.unpack(">I", head[:4])[0]
                    if length == 1 and len(head) == 16:
                        length = struct.unpack(">Q", head[8:16])[0]
                else:
                    length = struct.unpack("<I", head[4:8])[0]
                if length == 0:
                    # written without going back to fill in the size, or "to the end": nothing to compare
                    return
                end = place + header + length
                if end > size:
                    raise FilmError(
                        f"{path}: {size} bytes, but its container needs {end}; the film is cut short, copy it again"
                    )
                place = end + (end % 2 if not big_endian else 0)
    except OSError as error:
        raise FilmError(f"{path}: cannot be read ({error.strerror})") from None
