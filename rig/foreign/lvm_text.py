"""LabVIEW measurement files (``.lvm``): a header of the file, one of the segment, then rows of numbers.

Separator and decimal sign are those the header states. ``X_Columns`` ``One``, ``Multi`` (all equal) and ``No`` (times
from ``X0`` and ``Delta_X``) are read; the times are channel ``X_Value``. The number of rows must be what ``Samples``
says. Files of several segments are refused: what lies between them is not stated.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import InputError
from rig.foreign.channel_table import ChannelTable, number

END = "***End_of_Header***"
SEPARATORS = {"Tab": "\t", "Comma": ","}
TIME = "X_Value"


def read_lvm(path: Path) -> ChannelTable:
    """Read the channels of a LabVIEW measurement file.

    Raises
    ------
    InputError
        When the file is no such file, is cut off, or holds several segments.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # what LabVIEW writes on a western Windows; numbers are ASCII in both
    return parse_lvm(text, str(path))


def parse_lvm(text: str, where: str) -> ChannelTable:
    """Read LVM text; ``where`` names it in errors."""
    lines = [line.rstrip("\r") for line in text.split("\n")]
    if not lines[0].startswith("LabVIEW Measurement"):
        raise InputError(f"{where}: not a LabVIEW measurement file; its first line must be 'LabVIEW Measurement'")
    ends = [i for i, line in enumerate(lines) if line.startswith(END)]
    if len(ends) != 2:
        raise InputError(f"{where}: {max(len(ends) - 1, 0)} segments, allowed 1; save one segment per file")
    separator, decimal, columns = _file_header(lines[: ends[0]], where)
    segment = _fields(lines[ends[0] + 1 : ends[1]], separator)
    count = _whole(segment, "Channels", where)[0]
    samples = _whole(segment, "Samples", where)[:count]
    if count < 1 or len(samples) != count or len(set(samples)) != 1 or samples[0] < 1:
        raise InputError(f"{where}: Samples {samples} of {count} channels; allowed one equal number from 1 for each")
    return _table(lines[ends[1] + 1 :], segment, separator, decimal, columns, count, samples[0], where)


def _file_header(lines: list[str], where: str) -> tuple[str, str, str]:
    header = _fields(lines, "\t")
    header.update({key: value for key, value in _fields(lines, ",").items() if key not in header})
    stated = {key: value[0].strip() if value else "" for key, value in header.items()}
    separator = stated.get("Separator", "")
    if separator not in SEPARATORS:
        raise InputError(f"{where}: Separator {separator!r}, allowed {' or '.join(SEPARATORS)}")
    if SEPARATORS[separator] == ",":
        stated = {key: value[0].strip() if value else "" for key, value in _fields(lines, ",").items()}
    decimal = stated.get("Decimal_Separator", ".")
    if decimal not in (".", ",") or (decimal == "," and separator == "Comma"):
        raise InputError(f"{where}: Decimal_Separator {decimal!r}, allowed '.', or ',' where Separator is Tab")
    columns = stated.get("X_Columns", "")
    if columns not in ("One", "Multi", "No"):
        raise InputError(f"{where}: X_Columns {columns!r}, allowed One, Multi or No")
    return SEPARATORS[separator], decimal, columns


def _fields(lines: list[str], separator: str) -> dict[str, list[str]]:
    found = {}
    for line in lines:
        key, *values = line.split(separator)
        if key.strip():
            found[key.strip()] = values
    return found


def _whole(segment: dict[str, list[str]], key: str, where: str) -> list[int]:
    cells = [cell.strip() for cell in segment.get(key, []) if cell.strip()]
    if not cells or not all(cell.isascii() and cell.isdigit() and len(cell) < 12 for cell in cells):
        raise InputError(f"{where}: {key} {cells}, allowed whole numbers")
    return [int(cell) for cell in cells]


def _numbers(cells: list[str], decimal: str, what: str, where: str) -> list[float]:
    try:
        return [number(cell, decimal) for cell in cells]
    except ValueError as error:
        raise InputError(f"{where}: {what} found {str(error)[:40]!r}, allowed a number") from None


def _table(
    lines: list[str],
    segment: dict[str, list[str]],
    separator: str,
    decimal: str,
    columns: str,
    count: int,
    samples: int,
    where: str,
) -> ChannelTable:
    rows = [line.split(separator) for line in lines if line.strip()]
    if not rows:
        raise InputError(f"{where}: no row of channel names")
    heads = [cell.strip() for cell in rows[0]]
    width = 2 * count if columns == "Multi" else count + 1
    value_at = list(range(1, 2 * count, 2)) if columns == "Multi" else list(range(1, count + 1))
    time_at = list(range(0, 2 * count, 2)) if columns == "Multi" else [0]
    names = [heads[k] if k < len(heads) else "" for k in value_at]
    if any(k >= len(heads) or heads[k] != TIME for k in time_at) or len(set(names)) != count or not all(names):
        raise InputError(f"{where}: column names {heads[:40]}; allowed {TIME} and {count} unique names")
    if len(rows) - 1 != samples:
        raise InputError(f"{where}: {len(rows) - 1} rows, but Samples says {samples}; the file is cut off or joined")
    values = np.empty((samples, width))
    for i, row in enumerate(rows[1:]):
        cells = row[:width]
        if columns == "No":
            cells = ["0", *cells[1:]]  # the column of times is empty
        if len(cells) < width or any(cell.strip() for cell in row[width + 1 :]):
            raise InputError(f"{where}: row {i + 1}: {len(row)} cells, allowed {width} and a comment")
        values[i] = _numbers(cells, decimal, f"row {i + 1}:", where)
    interval = _interval(segment, decimal, count, where)
    time: NDArray[np.float64] = values[:, 0].copy()
    if columns == "No":
        if interval is None:
            raise InputError(f"{where}: X_Columns is No and Delta_X is missing; the times are not known")
        start = _numbers(segment.get("X0", ["0"])[:1], decimal, "X0", where)
        time = np.asarray(start[0] + interval * np.arange(samples), dtype=np.float64)
    elif any(not np.array_equal(values[:, k], time) for k in time_at):
        raise InputError(f"{where}: the channels have different times; allowed one time axis for all")
    units = dict(zip(names, [cell.strip() for cell in segment.get("Y_Unit_Label", [])], strict=False))
    table = {TIME: time, **{name: values[:, k].copy() for name, k in zip(names, value_at, strict=True)}}
    return ChannelTable(where, table, {k: v for k, v in units.items() if v}, interval)


def _interval(segment: dict[str, list[str]], decimal: str, count: int, where: str) -> float | None:
    cells = [cell for cell in segment.get("Delta_X", []) if cell.strip()][:count]
    steps = set(_numbers(cells, decimal, "Delta_X", where))
    if len(steps) > 1 or any(not step > 0 for step in steps):
        raise InputError(f"{where}: Delta_X {sorted(steps)}, allowed one positive number for all channels")
    return steps.pop() if steps else None
