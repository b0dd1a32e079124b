"""Phantom films for the tests, packed field by field from the format's description."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

SETTINGS_BYTES = 12_000


def write_cine(
    path: Path,
    frames: np.ndarray,
    *,
    packed: int = 0,
    stamps: bool = True,
    kept: np.ndarray | None = None,
    **changed: int,
) -> None:
    """A film of frames (n, height, width) or, blue first, (n, height, width, 3), uint8 or uint16.

    ``packed`` is the number of bits, 10 or 12, that values are packed to as they are; ``changed`` are fields other than
    usual. ``kept`` are the numbers of the frames by their own times, where some were left out.
    """
    field = {"rate": 10_000, "shutter_ns": 40_000, "bits": 12, "first": -5, "compression": 0, "cfa": 0, "flip_v": 0,
             "packing": {0: 0, 10: 256, 12: 1024}[packed], "missing_mark": 0} | changed  # fmt: skip
    n, height, width = frames.shape[:3]
    bits = 8 * frames.dtype.itemsize * (3 if frames.ndim == 4 else 1)
    settings = bytearray(SETTINGS_BYTES)
    settings[140:144] = (b"XX" if field["missing_mark"] else b"ST") + struct.pack("<H", SETTINGS_BYTES)
    for at, value in ((760, field["flip_v"]), (768, field["rate"]), (772, field["shutter_ns"] // 1000), (800, 800),
                      (808, field["cfa"]), (896, field["bits"]), (1568, field["shutter_ns"])):  # fmt: skip
        settings[at : at + 4] = struct.pack("<I", value)
    trigger = (1_700_000_000 << 32) + 12345
    ticks = [
        trigger + round((field["first"] + i) / field["rate"] * 2**32)
        for i in (range(n) if kept is None else kept.tolist())
    ]
    blocks = struct.pack("<IHH", 16, 1003, 1) + bytes(8)
    if stamps:
        blocks += struct.pack("<IHH", 8 + 8 * n, 1002, 0) + struct.pack(f"<{n}Q", *ticks)
    bitmap = struct.pack("<IiiHHIIiiII", 40, width, height, 1, bits, field["packing"], 0, 0, 0, 0, 0)
    table_at = 44 + 40 + len(settings) + len(blocks)
    images, places = b"", []
    for frame in frames:
        if packed:
            digits = "".join(f"{value:0{packed}b}" for value in frame.ravel())
            data = int(digits, 2).to_bytes(len(digits) // 8, "big")
        else:
            data = frame[::-1].astype(frame.dtype.newbyteorder("<")).tobytes()
        places.append(table_at + 8 * n + len(images))
        images += struct.pack("<I", 16) + bytes(8) + struct.pack("<I", len(data)) + data
    counts = (field["first"], n, field["first"], n)
    header = struct.pack("<2sHHHiIiI", b"CI", 44, field["compression"], 1, *counts)
    header += struct.pack("<IIIQ", 44, 84, table_at, trigger)
    path.write_bytes(header + bitmap + settings + blocks + struct.pack(f"<{n}q", *places) + images)
