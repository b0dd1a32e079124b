"""TDMS files written byte by byte after National Instruments' description of the format, where npTDMS cannot."""

from __future__ import annotations

import struct

import numpy as np

METADATA, NEW_OBJECTS, RAW, INTERLEAVED, BIG, DAQMX = 1 << 1, 1 << 2, 1 << 3, 1 << 5, 1 << 6, 1 << 7
I16, DOUBLE, U32, TEXT = 2, 10, 7, 0x20


def _text(value: str, order: str) -> bytes:
    data = value.encode()
    return struct.pack(order + "I", len(data)) + data


def _property(name: str, value: object, order: str) -> bytes:
    if isinstance(value, str):
        return _text(name, order) + struct.pack(order + "I", TEXT) + _text(value, order)
    if isinstance(value, int):
        return _text(name, order) + struct.pack(order + "II", U32, value)
    return _text(name, order) + struct.pack(order + "Id", DOUBLE, value)


def _object(path: str, index: bytes, properties: dict[str, object], order: str) -> bytes:
    body = _text(path, order) + index + struct.pack(order + "I", len(properties))
    return body + b"".join(_property(name, value, order) for name, value in properties.items())


def _segment(contents: int, objects: list[bytes], raw: bytes, order: str) -> bytes:
    metadata = struct.pack(order + "I", len(objects)) + b"".join(objects)
    lead = b"TDSm" + struct.pack("<I", contents | METADATA | NEW_OBJECTS | RAW)
    return lead + struct.pack(order + "IQQ", 4713, len(metadata) + len(raw), len(metadata)) + metadata + raw


def doubles(channels: dict[str, np.ndarray], properties: dict[str, object], *, big: bool, interleaved: bool) -> bytes:
    """One segment of double channels in group ``g``."""
    order = ">" if big else "<"
    objects = [
        _object(f"/'g'/'{name}'", struct.pack(order + "IIIQ", 20, DOUBLE, 1, values.size), properties, order)
        for name, values in channels.items()
    ]
    columns = np.column_stack(list(channels.values())).astype(order + "f8")
    raw = columns.tobytes() if interleaved else columns.T.tobytes()
    return _segment((BIG if big else 0) | (INTERLEAVED if interleaved else 0), objects, raw, order)


def daqmx(channels: dict[str, tuple[np.ndarray, float, float]], properties: dict[str, object]) -> bytes:
    """One segment of DAQmx raw int16 data, channels side by side, each with the slope and intercept of its scale."""
    objects = []
    width = 2 * len(channels)
    for place, (name, (values, slope, intercept)) in enumerate(channels.items()):
        # index: format-changing scaler, type DAQmx raw, dimension, samples, one scaler, one buffer of this width
        index = struct.pack("<IIIQI", 0x1269, 0xFFFFFFFF, 1, values.size, 1)
        index += struct.pack("<IIIII", 3, 0, 2 * place, 0, 0) + struct.pack("<II", 1, width)
        scale: dict[str, object] = {
            "NI_Scaling_Status": "unscaled",
            "NI_Number_Of_Scales": 2,
            "NI_Scale[1]_Scale_Type": "Linear",
            "NI_Scale[1]_Linear_Slope": slope,
            "NI_Scale[1]_Linear_Y_Intercept": intercept,
            "NI_Scale[1]_Linear_Input_Source": 0,
        }
        objects.append(_object(f"/'g'/'{name}'", index, {**properties, **scale}, "<"))
    raw = np.column_stack([values for values, _, _ in channels.values()]).astype("<i2").tobytes()
    return _segment(DAQMX, objects, raw, "<")
