"""LabVIEW measurement files (``.lvm``): a header of the file, then segments: a header each and rows of numbers.

Separator and decimal sign are those the header states. Values of a segment header stand in the column of the channel
they belong to. ``X_Columns`` ``One``, ``Multi`` and ``No`` (times from ``X0`` and ``Delta_X``) are read; where all
channels have the same times these are channel ``X_Value``. Every segment becomes a table; with ``Multi_Headings``
``No`` only the first has a header, and the others as many rows as that says. Special blocks are skipped. A number of
rows other than ``Samples`` says is refused. Source: National Instruments, Specification for the LabVIEW Measurement
File, 2.0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.foreign.channel_table import JITTER, SECONDS, ChannelTable, Clock, even_interval, known, number, shown
from rig.foreign.csv_text import decoded
from rig.storage.atomic_write import refused

END = "***End_of_Header***"
SPECIAL, END_SPECIAL = "***Start_Special***", "***End_Special***"
SEPARATORS = {"Tab": "\t", "Comma": ","}
TIME = "X_Value"
DELTA_RESOLUTION = 1e-6
"""LabVIEW writes six decimals: ``Delta_X`` has this resolution."""


@dataclass(frozen=True)
class _File:
    """What the header of the file states."""

    where: str
    separator: str
    decimal: str
    columns: str
    one_heading: bool


@dataclass(frozen=True)
class _Segment:
    """A segment's header fields by tag, in cells, and its lines from the row of names on."""

    fields: dict[str, list[str]]
    lines: list[str]


def read_lvm(path: Path) -> tuple[ChannelTable, ...]:
    """Read the segments of a LabVIEW measurement file.

    Raises RigInputError when it is not such a file or is truncated.
    """
    with refused(path, "read"):
        data = path.read_bytes()
    return parse_lvm(decoded(data, str(path)), str(path))


def parse_lvm(text: str, where: str) -> tuple[ChannelTable, ...]:
    """Read LVM text; ``where`` names it in errors."""
    lines = [line.rstrip("\r") for line in text.split("\n")]
    if not lines[0].startswith("LabVIEW Measurement"):
        raise RigInputError(f"{where}: not a LabVIEW measurement file; its first line must be 'LabVIEW Measurement'")
    lines = list(_without_special(lines, where))
    ends = [i for i, line in enumerate(lines) if line.startswith(END)]
    if len(ends) < 2:
        raise RigInputError(f"{where}: 0 segments, allowed from 1; the file is cut off")
    file = _file_header(lines[: ends[0]], where)
    tables: list[ChannelTable] = []
    for segment in _segments(file, lines[ends[0] + 1 :]):
        name = where if len(ends) == 2 else f"{where} segment {len(tables) + 1}"
        tables += _tables(file, segment, name)
    return tuple(tables)


def _without_special(lines: list[str], where: str) -> Iterator[str]:
    inside = False
    for line in lines:
        if line.startswith(SPECIAL):
            inside = True
        elif line.startswith(END_SPECIAL):
            inside = False
        elif not inside:
            yield line
    if inside:
        raise RigInputError(f"{where}: {SPECIAL} without {END_SPECIAL}; the file is cut off")


def _file_header(lines: list[str], where: str) -> _File:
    separators = {line[len("Separator") + 1 :].strip(" \t,") for line in lines if line.startswith("Separator")}
    separator = separators.pop() if len(separators) == 1 else "" if separators else "Tab"
    if separator not in SEPARATORS:
        raise RigInputError(f"{where}: Separator {separator!r}, allowed {' or '.join(SEPARATORS)}")
    fields = _fields(lines, SEPARATORS[separator])
    stated = {key: value[0].strip() for key, value in fields.items() if value}
    decimal = stated.get("Decimal_Separator", ".")
    # a decimal comma in a file separated by commas leaves an empty cell after the tag: it cannot be read
    if decimal not in (".", ",") or (decimal == "," and separator == "Comma"):
        raise RigInputError(f"{where}: Decimal_Separator {decimal!r}, allowed '.', or ',' where Separator is Tab")
    columns = stated.get("X_Columns", "One")
    if columns not in ("One", "Multi", "No"):
        raise RigInputError(f"{where}: X_Columns {columns!r}, allowed One, Multi or No")
    return _File(where, SEPARATORS[separator], decimal, columns, stated.get("Multi_Headings", "") == "No")


def _fields(lines: list[str], separator: str) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in lines:
        key, *values = line.split(separator)
        if key.strip():
            found[key.strip()] = values
    return found


def _segments(file: _File, lines: list[str]) -> Iterator[_Segment]:
    """Split what follows the file's header: the tags before an end of header belong to its segment."""
    ends = [i for i, line in enumerate(lines) if line.startswith(END)]
    starts = []
    for end in ends:
        start = end
        while start > 0 and _is_tag(lines[start - 1], file):
            start -= 1
        starts.append(start)
    if any(line.strip() for line in lines[: starts[0]]):
        raise RigInputError(
            f"{file.where}: found {shown(lines[0])} before the first segment's header; the file is damaged"
        )
    for start, end, stop in zip(starts, ends, [*starts[1:], len(lines)], strict=True):
        yield _Segment(_fields(lines[start:end], file.separator), lines[end + 1 : stop])


def _is_tag(line: str, file: _File) -> bool:
    """Whether a line can stand in a segment's header: empty, or with a first cell that is no number or name."""
    cell = line.split(file.separator)[0].strip()
    if not cell:
        return not line.strip()
    return cell != TIME and not _is_number(cell, file.decimal)


def _is_number(cell: str, decimal: str) -> bool:
    try:
        number(cell, decimal)
    except ValueError:
        return False
    return True


def _tables(file: _File, segment: _Segment, where: str) -> list[ChannelTable]:
    """The segment's table, and those of segments without a header that follow it."""
    count = _whole(segment.fields.get("Channels", [])[:1], "Channels", where)[0]
    if not 1 <= count <= 10_000:
        raise RigInputError(f"{where}: Channels {count}, allowed 1 to 10000")
    multi = file.columns == "Multi"
    at = list(range(1, 2 * count, 2)) if multi else list(range(1, count + 1))
    cells = [c for c in segment.fields.get("Samples", [])[: at[-1]] if c.strip()]
    samples = _whole(cells, "Samples", where)
    if len(samples) != count or len(set(samples)) != 1 or samples[0] < 1:
        raise RigInputError(f"{where}: Samples {samples} of {count} channels; allowed one equal number from 1 for each")
    rows = [line.split(file.separator) for line in segment.lines if line.strip()]
    if not rows:
        raise RigInputError(f"{where}: no row of channel names")
    heads = [cell.strip() for cell in rows[0]]
    names = [heads[k] if k < len(heads) else "" for k in at]
    time_at = list(range(0, 2 * count, 2)) if multi else [0]
    if any(k >= len(heads) or heads[k] != TIME for k in time_at) or len(set(names)) != count or not all(names):
        raise RigInputError(f"{where}: column names {heads[:40]}; allowed {TIME} and {count} unique names")
    packets, left = divmod(len(rows) - 1, samples[0])
    if left or packets < 1 or (packets > 1 and not file.one_heading):
        raise RigInputError(
            f"{where}: {len(rows) - 1} rows, but Samples says {samples[0]}; the file is cut off or joined"
        )
    values = _values(file, rows[1:], at[-1] + 1, where)
    tables = []
    for k in range(packets):
        name = where if packets == 1 else f"{where} segment {k + 1}"
        tables.append(_table(file, segment, names, at, values[k * samples[0] : (k + 1) * samples[0]], name))
    return tables


def _values(file: _File, rows: list[list[str]], width: int, where: str) -> NDArray[np.float64]:
    values = np.zeros((len(rows), width))
    first = 1 if file.columns == "No" else 0  # the column of times is empty
    for i, row in enumerate(rows):
        if len(row) < width or any(cell.strip() for cell in row[width + 1 :]):
            raise RigInputError(f"{where}: row {i + 1}: {len(row)} cells, allowed {width} and a comment")
        if len(row) > width and _is_number(row[width], file.decimal):
            raise RigInputError(
                f"{where}: row {i + 1}: comment {shown(row[width])} is a number; the row has a cell too many"
            )
        values[i, first:] = _numbers(row[first:width], file.decimal, f"row {i + 1}:", where)
    return values


def _table(
    file: _File, segment: _Segment, names: list[str], at: list[int], values: NDArray[np.float64], where: str
) -> ChannelTable:
    def of_channel(tag: str) -> dict[str, str]:
        cells = segment.fields.get(tag, [])
        return {
            name: cells[k - 1].strip()
            for name, k in zip(names, at, strict=True)
            if k <= len(cells) and cells[k - 1].strip()
        }

    def quantity(tag: str) -> dict[str, float]:
        return {name: _numbers([cell], file.decimal, tag, where)[0] for name, cell in of_channel(tag).items()}

    dimensions = set(of_channel("X_Dimension").values()) or {"Time"}
    labels = {known(label) or "s" for label in of_channel("X_Unit_Label").values()} or {"s"}
    if dimensions != {"Time"} or len(labels) != 1 or not labels <= set(SECONDS):
        raise RigInputError(
            f"{where}: X_Dimension {sorted(dimensions)} in {sorted(labels)}, allowed Time in one of {list(SECONDS)}"
        )
    unit = labels.pop()
    steps, starts = quantity("Delta_X"), quantity("X0")
    if any(not step > 0 for step in steps.values()):
        raise RigInputError(f"{where}: Delta_X {sorted(steps.values())}, allowed above 0")
    columns = {name: values[:, k].copy() for name, k in zip(names, at, strict=True)}
    times: list[NDArray[np.float64]]
    if file.columns == "No":
        if set(steps) != set(names):
            raise RigInputError(f"{where}: X_Columns is No and Delta_X is missing; the times are not known")
        count = np.arange(len(values), dtype=np.float64)
        times = [starts.get(name, 0.0) + steps[name] * count for name in names]
        stated = {name: Clock(steps[name], starts.get(name, 0.0)) for name in names}
    else:
        times = [values[:, k - 1] if file.columns == "Multi" else values[:, 0] for k in at]
        stated = {
            name: _clock(time, steps.get(name), f"{where}: {TIME} of {name}")
            for name, time in zip(names, times, strict=True)
            if len(time) > 1
        }
    dates, hours = of_channel("Date"), of_channel("Time")
    clocks = {
        name: Clock(
            clock.interval_s * SECONDS[unit],
            clock.start_s * SECONDS[unit],
            _stamp(dates.get(name, ""), hours.get(name, ""), where),
            DELTA_RESOLUTION * SECONDS[unit],
        )
        for name, clock in stated.items()
    }
    units = of_channel("Y_Unit_Label")
    if all(np.array_equal(time, times[0]) for time in times):
        columns[TIME], units[TIME] = times[0].copy(), unit
    stamped = [clock.stamp_s for clock in clocks.values() if clock.stamp_s]
    try:
        started = (datetime(1904, 1, 1) + timedelta(seconds=stamped[0])).isoformat() if stamped else ""
    except OverflowError:
        raise RigInputError(f"{where}: Date and Time are {stamped[0]:g} s after 1904, no date of a calendar") from None
    return ChannelTable(where, columns, units, clocks, started=started)


def _clock(time: NDArray[np.float64], stated: float | None, what: str) -> Clock:
    """Clock of a column of times, which must agree with ``Delta_X`` to the digits of both."""
    found = even_interval(time, what)
    if stated is None:
        return Clock(found, float(time[0]))
    if not Clock(stated, resolution_s=DELTA_RESOLUTION).agrees(found):
        raise RigInputError(f"{what} rises by {found:g}, but Delta_X says {stated:g}; one of them is wrong")
    return Clock(stated if abs(stated / found - 1) * len(time) <= JITTER else found, float(time[0]))


def _stamp(date: str, time: str, where: str) -> float:
    """Seconds of ``Date`` (YYYY/MM/DD) and ``Time`` (HH:MM:SS.XXX) after the beginning of 1904; 0 where not stated.

    The fraction may have either decimal sign, independent of the file's numbers.
    """
    try:
        day = (datetime.strptime(date, "%Y/%m/%d") - datetime(1904, 1, 1)).days if date else 0
        parts = [number(part.replace(",", ".")) for part in time.split(":")] if time else [0.0, 0.0, 0.0]
        hour, minute, second = parts
        if not (0 <= hour < 24 and 0 <= minute < 60 and 0 <= second <= 60):  # nor what is not a number
            raise ValueError
    except ValueError:
        raise RigInputError(f"{where}: Date {date!r}, Time {time!r}, allowed YYYY/MM/DD and HH:MM:SS.XXX") from None
    return ((day * 24 + hour) * 60 + minute) * 60 + second if date and time else 0.0


def _whole(cells: list[str], key: str, where: str) -> list[int]:
    cells = [cell.strip() for cell in cells]
    if not cells or not all(cell.isascii() and cell.isdigit() and len(cell) < 12 for cell in cells):
        raise RigInputError(f"{where}: {key} {cells}, allowed whole numbers")
    return [int(cell) for cell in cells]


def _numbers(cells: list[str], decimal: str, what: str, where: str) -> list[float]:
    try:
        return [number(cell, decimal) for cell in cells]
    except ValueError as error:
        raise RigInputError(f"{where}: {what} found {shown(str(error))}, allowed a number") from None
