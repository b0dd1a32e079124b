"""Whether a TIFF file holds all the pages it points to; decoders stop at a broken pointer as if it were the last.

Format: TIFF 6.0 (Adobe, 1992) and BigTIFF: a header with the place of the first directory; each directory ends with the
place of the next, zero after the last. Directories list where the strips or tiles of their picture lie.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import BinaryIO

OFFSETS, COUNTS = (273, 324), (279, 325)
"""Tags of the places and sizes of strips and tiles."""
SIZES = {3: ("H", 2), 4: ("I", 4), 16: ("Q", 8)}
MAX_PAGES = 10_000_000


def chain_is_whole(path: Path) -> bool:
    """False when a directory or a strip lies beyond the end of the file; True for files of another format."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(16)
        if head[:4] not in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return True
        order, big = "<" if head[:2] == b"II" else ">", b"+" in head[:4]
        try:
            at = int(struct.unpack(order + ("Q" if big else "I"), head[8:16] if big else head[4:8])[0])
            seen: set[int] = set()
            while at and at not in seen and len(seen) < MAX_PAGES:
                seen.add(at)
                at, whole = _page(file, at, order, big, size)
                if not whole:
                    return False
        except struct.error:
            return False
    return True


def _page(file: BinaryIO, at: int, order: str, big: bool, size: int) -> tuple[int, bool]:
    """Place of the next directory, and whether this page's own data lie inside the file."""
    entry, count_code, offset_code = (20, "Q", "Q") if big else (12, "H", "I")
    file.seek(at)
    (n,) = struct.unpack(order + count_code, file.read(struct.calcsize(count_code)))
    if n * entry > size:
        return 0, False
    table = file.read(n * entry)
    (following,) = struct.unpack(order + offset_code, file.read(struct.calcsize(offset_code)))
    found: dict[int, tuple[int, ...]] = {}
    for k in range(n):
        raw = table[k * entry : (k + 1) * entry]
        tag, kind, count = struct.unpack(order + ("HHQ" if big else "HHI"), raw[: 12 if big else 8])
        if tag in OFFSETS + COUNTS and kind in SIZES:
            code, width = SIZES[kind]
            room = raw[12:] if big else raw[8:]
            if count * width > len(room):
                file.seek(struct.unpack(order + offset_code, room)[0])
                room = file.read(min(count * width, size))
            found[tag] = struct.unpack(f"{order}{count}{code}", room[: count * width])
    for where, length in zip(OFFSETS, COUNTS, strict=True):
        ends = zip(found.get(where, ()), found.get(length, ()), strict=False)
        if any(start + extent > size for start, extent in ends):
            return int(following), False
    return int(following), True
