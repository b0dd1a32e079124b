"""LabVIEW measurement files (``.lvm``): a header of the file, then segments: a header each and rows of numbers.

Separator and decimal sign are those the header states. Values of a segment header stand in the column of the channel
they belong to. ``X_Columns`` ``One``, ``Multi`` and ``No`` (times from ``X0`` and ``Delta_X``) are read; where all
channels have the same times these are channel ``X_Value``. Every segment becomes a table; with ``Multi_Headings``
``No`` only the first has a header, and the others as many rows as that says. A channel may have fewer ``Samples`` than
others, or none. Special blocks are skipped. A number of rows other than ``Samples`` says is refused. Source: National
Instruments, Specification for the LabVIEW Measurement File, 2.0.

``Delta_X`` has six decimals. Times that are recorded decide where they are finer; where they are coarser they must
agree with ``Delta_X``, sample by sample.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, known_unit, parse_number, parse_numbers, shorten_cell
from rig.foreign.sample_times import JITTER, SECONDS, Clock, CoarseTimes, even_interval, time_resolution

END = "***End_of_Header***"
SPECIAL, END_SPECIAL = "***Start_Special***", "***End_Special***"
SEPARATORS = {"Tab": "\t", "Comma": ","}
TIME = "X_Value"
DELTA_RESOLUTION = 1e-6  # LabVIEW writes six decimals: ``Delta_X`` has this resolution


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


def parse_lvm(text: str, where: str) -> tuple[ChannelTable, ...]:
    """Read the text of a LabVIEW measurement file as tables, one a segment or packet; RigInputError, which begins with
    ``where``, for a file that is none, is cut off or contradicts itself."""
    lines = [line.rstrip("\r") for line in text.split("\n")]
    if not lines[0].startswith("LabVIEW Measurement"):
        raise RigInputError(f"{where}: not a LabVIEW measurement file; its first line must be 'LabVIEW Measurement'")
    lines = list(_drop_special_blocks(lines, where))
    ends = [i for i, line in enumerate(lines) if line.startswith(END)]
    if len(ends) < 2:
        raise RigInputError(f"{where}: 0 segments, allowed from 1; the file is cut off")
    file = _parse_file_header(lines[: ends[0]], where)
    tables: list[ChannelTable] = []
    for segment in _split_segments(file, lines[ends[0] + 1 :]):
        name = where if len(ends) == 2 else f"{where} segment {len(tables) + 1}"
        tables += _read_tables(file, segment, name)
    return tuple(tables)


def _drop_special_blocks(lines: list[str], where: str) -> Iterator[str]:
    """Lines outside the special blocks (``***Start_Special***`` to ``***End_Special***``); RigInputError, which begins
    with ``where``, for one that does not end."""
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


def _parse_file_header(lines: list[str], where: str) -> _File:
    """Separator, decimal sign and kind of times that the lines of the file's header state; RigInputError, which begins
    with ``where``, for values that LabVIEW does not write."""
    separators = {line[len("Separator") + 1 :].strip(" \t,") for line in lines if line.startswith("Separator")}
    separator = separators.pop() if len(separators) == 1 else "" if separators else "Tab"
    if separator not in SEPARATORS:
        raise RigInputError(f"{where}: Separator {separator!r}, allowed {' or '.join(SEPARATORS)}")
    fields = _split_fields(lines, SEPARATORS[separator])
    stated = {key: value[0].strip() for key, value in fields.items() if value}
    decimal = stated.get("Decimal_Separator", ".")
    # a decimal comma in a file separated by commas leaves an empty cell after the tag: it cannot be read
    if decimal not in (".", ",") or (decimal == "," and separator == "Comma"):
        raise RigInputError(f"{where}: Decimal_Separator {decimal!r}, allowed '.', or ',' where Separator is Tab")
    columns = stated.get("X_Columns", "One")
    if columns not in ("One", "Multi", "No"):
        raise RigInputError(f"{where}: X_Columns {columns!r}, allowed One, Multi or No")
    return _File(where, SEPARATORS[separator], decimal, columns, stated.get("Multi_Headings", "") == "No")


def _split_fields(lines: list[str], separator: str) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in lines:
        key, *values = line.split(separator)
        if key.strip():
            found[key.strip()] = values
    return found


def _split_segments(file: _File, lines: list[str]) -> Iterator[_Segment]:
    """Split the lines below the file's header into segments, each with the fields of its own header and its lines from
    the row of names on."""
    ends = [i for i, line in enumerate(lines) if line.startswith(END)]
    starts = []
    for end in ends:
        start = end
        while start > 0 and _is_tag(lines[start - 1], file):
            start -= 1
        starts.append(start)
    if any(line.strip() for line in lines[: starts[0]]):
        raise RigInputError(
            f"{file.where}: found {shorten_cell(lines[0])} before the first segment's header; the file is damaged"
        )
    for start, end, stop in zip(starts, ends, [*starts[1:], len(lines)], strict=True):
        yield _Segment(_split_fields(lines[start:end], file.separator), lines[end + 1 : stop])


def _is_tag(line: str, file: _File) -> bool:
    """Whether a line can stand in a segment's header: empty, or with a first cell that is no number or name."""
    cell = line.split(file.separator)[0].strip()
    if not cell:
        return not line.strip()
    return cell != TIME and not _is_number(cell, file.decimal)


def _is_number(cell: str, decimal: str) -> bool:
    try:
        parse_number(cell, decimal)
    except ValueError:
        return False
    return True


def _read_tables(file: _File, segment: _Segment, where: str) -> list[ChannelTable]:
    """Tables of a segment: one, or one for each packet of rows where only the first has a header; RigInputError, which
    begins with ``where``, where rows or names do not fit the header."""
    count = _parse_whole_numbers(segment.fields.get("Channels", [])[:1], "Channels", where)[0]
    if not 1 <= count <= 10_000:
        raise RigInputError(f"{where}: Channels {count}, allowed 1 to 10000")
    multi = file.columns == "Multi"
    at = list(range(1, 2 * count, 2)) if multi else list(range(1, count + 1))
    cells = [c for c in segment.fields.get("Samples", [])[: at[-1]] if c.strip()]
    samples = _parse_whole_numbers(cells, "Samples", where)
    longest = max(samples, default=0)
    if len(samples) != count or not longest:
        raise RigInputError(f"{where}: Samples {samples} of {count} channels; allowed one number for each, one from 1")
    rows = [line.split(file.separator) for line in segment.lines if line.strip()]
    if not rows:
        raise RigInputError(f"{where}: no row of channel names")
    heads = [cell.strip() for cell in rows[0]]
    time_at = list(range(0, 2 * count, 2)) if multi else [0] * count
    used = [k for k in range(count) if samples[k]]
    names = {at[k]: heads[at[k]] if at[k] < len(heads) else "" for k in used}
    if any(time_at[k] >= len(heads) or heads[time_at[k]] != TIME for k in used) or not (
        len(set(names.values())) == len(used) and all(names.values())
    ):
        raise RigInputError(f"{where}: column names {heads[:40]}; allowed {TIME} and {len(used)} unique names")
    packets, left = divmod(len(rows) - 1, longest)
    if left or packets < 1 or (packets > 1 and (not file.one_heading or len(set(samples) - {0}) > 1)):
        raise RigInputError(f"{where}: {len(rows) - 1} rows, but Samples says {longest}; the file is cut off or joined")
    lengths = {at[k]: samples[k] for k in range(count)}
    if file.columns != "No":
        lengths |= {time_at[k]: longest if not multi else samples[k] for k in used}
    empty = {heads[k]: f"{heads[k]} has no samples" for k in at if k < len(heads) and heads[k] and not lengths[k]}
    tables = []
    for k in range(packets):
        name = where if packets == 1 else f"{where} segment {k + 1}"
        part = rows[1 + k * longest : 1 + (k + 1) * longest]
        columns = _parse_columns(file, part, lengths, k * longest, where)
        tables.append(replace(_make_table(file, segment, names, columns, name), unreadable=empty))
    return tables


def _parse_columns(
    file: _File, rows: list[list[str]], lengths: dict[int, int], before: int, where: str
) -> dict[int, NDArray[np.float64]]:
    """Numbers of the columns, by index from 0; ``lengths``: by index, how many of the ``rows`` have a number there;
    ``before``: rows of the file above these, for messages that begin with ``where``."""
    width = max(lengths) + 1
    for i, row in enumerate(rows, before + 1):
        if any(cell.strip() for cell in row[width + 1 :]):
            raise RigInputError(f"{where}: row {i}: {len(row)} cells, allowed {width} and a comment")
        if len(row) > width and _is_number(row[width], file.decimal):
            raise RigInputError(
                f"{where}: row {i}: comment {shorten_cell(row[width])} is a number; the row has a cell too many"
            )
    columns = {}
    for k, length in lengths.items():
        cells = [row[k] if k < len(row) else "" for row in rows]
        try:
            values = parse_numbers(cells[:length], file.decimal)
        except ValueError as error:
            i, cell = error.args
            said = (
                f"{len(rows[i])} cells, allowed {width}"
                if k >= len(rows[i])
                else f"found {shorten_cell(cell)}, allowed a number"
            )
            raise RigInputError(f"{where}: row {before + i + 1}: {said}") from None
        if any(cell.strip() for cell in cells[length:]):
            raise RigInputError(f"{where}: column {k + 1} has more cells than the {length} that Samples says")
        if length:
            columns[k] = values
    return columns


def _make_table(
    file: _File, segment: _Segment, names: dict[int, str], values: dict[int, NDArray[np.float64]], where: str
) -> ChannelTable:
    """Table of a segment's channels with units, clocks and start as its header states; ``names`` and ``values`` (n,):
    by index of the column. RigInputError where the times are none or contradict the header."""

    def read_fields(tag: str) -> dict[str, str]:
        cells = segment.fields.get(tag, [])
        return {name: cells[k - 1].strip() for k, name in names.items() if k <= len(cells) and cells[k - 1].strip()}

    def quantity(tag: str) -> dict[str, float]:
        return {name: _numbers([cell], file.decimal, tag, where)[0] for name, cell in read_fields(tag).items()}

    dimensions = set(read_fields("X_Dimension").values()) or {"Time"}
    labels = {known_unit(label) or "s" for label in read_fields("X_Unit_Label").values()} or {"s"}
    if dimensions != {"Time"} or len(labels) != 1 or not labels <= set(SECONDS):
        raise RigInputError(
            f"{where}: X_Dimension {sorted(dimensions)} in {sorted(labels)}, allowed Time in one of {list(SECONDS)}"
        )
    unit = labels.pop()
    steps, starts = quantity("Delta_X"), quantity("X0")
    if any(not step > 0 for step in steps.values()):
        raise RigInputError(f"{where}: Delta_X {sorted(steps.values())}, allowed above 0")
    columns = {name: values[k] for k, name in names.items()}
    digits = {name: _resolution(cell) for name, cell in read_fields("Delta_X").items()}
    if file.columns == "No":
        if set(steps) != set(columns):
            raise RigInputError(f"{where}: X_Columns is No and Delta_X is missing; the times are not known")
        counts = {name: np.arange(values[k].size, dtype=np.float64) for k, name in names.items()}
        times = [starts.get(name, 0.0) + steps[name] * count for name, count in counts.items()]
        stated = {name: Clock(steps[name], starts.get(name, 0.0), 0.0, digits[name]) for name in columns}
    else:
        times = [values[k - 1] if file.columns == "Multi" else values[0][: values[k].size] for k in names]
        what = {name: f"{where}: {TIME} of {name}" for name in columns}
        found = {
            name: _column_clock(time, steps.get(name), digits.get(name, 0.0), what[name])
            for name, time in zip(columns, times, strict=True)
            if len(time) > 1
        }
        stated = {name: clock for name, clock in found.items() if clock is not None}
    dates, hours = read_fields("Date"), read_fields("Time")
    clocks = {
        name: Clock(
            clock.interval_s * SECONDS[unit],
            clock.start_s * SECONDS[unit],
            _seconds_since_1904(dates.get(name, ""), hours.get(name, ""), where),
            clock.resolution_s * SECONDS[unit],
        )
        for name, clock in stated.items()
    }
    units = read_fields("Y_Unit_Label")
    longest = max(times, key=len)
    if all(np.array_equal(time, longest[: time.size]) for time in times):
        columns[TIME], units[TIME] = longest.copy(), unit
    stamped = [clock.stamp_s for clock in clocks.values() if clock.stamp_s]
    try:
        started = (datetime(1904, 1, 1) + timedelta(seconds=stamped[0])).isoformat() if stamped else ""
    except OverflowError:
        raise RigInputError(f"{where}: Date and Time are {stamped[0]:g} s after 1904, no date of a calendar") from None
    computed = (TIME,) if file.columns == "No" else ()
    return ChannelTable(where, columns, units, clocks, computed=computed, started=started)


def _resolution(cell: str) -> float:
    """Return the place of the last digit of a ``Delta_X``: six decimals, also where zeros at the end are left out."""
    mantissa, _, exponent = cell.replace(",", ".").lower().partition("e")
    return min(DELTA_RESOLUTION, float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))))


def _column_clock(time: NDArray[np.float64], stated: float | None, resolution: float, what: str) -> Clock | None:
    """Clock of a column of times (n,), in the header's unit; the ``Delta_X`` that is ``stated`` must agree to the
    ``resolution`` it is written with, and decides where the times are too coarse; None without either."""
    try:
        found = even_interval(time, what)
    except CoarseTimes:
        if stated is None:
            return None  # the mapping has to state the rate
        count = np.arange(time.size)
        away = np.abs(time - time[0] - stated * count) - 0.51 * resolution * count
        if away.max() > JITTER * stated + 1.01 * time_resolution(time):
            row = int(np.argmax(away)) + 1
            raise RigInputError(
                f"{what} row {row}: {time[row - 1]:g} is not where Delta_X {stated:g} puts it"
            ) from None
        return Clock(stated, float(time[0]), 0.0, resolution)
    if stated is None:
        return Clock(found, float(time[0]))
    if not Clock(stated, resolution_s=resolution).agrees(found):
        raise RigInputError(f"{what} rises by {found:g}, but Delta_X says {stated:g}; one of them is wrong")
    if abs(stated / found - 1) * len(time) <= JITTER:
        return Clock(stated, float(time[0]), 0.0, resolution)
    return Clock(found, float(time[0]), 0.0, 2.0 * time_resolution(time) / (len(time) - 1))


def _seconds_since_1904(date: str, time: str, where: str) -> float:
    """Seconds of ``Date`` (YYYY/MM/DD) and ``Time`` (HH:MM:SS.XXX) after the beginning of 1904; 0 where not stated.

    The fraction may have either decimal sign, independent of the file's numbers.
    """
    try:
        day = (datetime.strptime(date, "%Y/%m/%d") - datetime(1904, 1, 1)).days if date else 0
        parts = [parse_number(part.replace(",", ".")) for part in time.split(":")] if time else [0.0, 0.0, 0.0]
        hour, minute, second = parts
        if not (0 <= hour < 24 and 0 <= minute < 60 and 0 <= second <= 60):  # nor what is not a number
            raise ValueError
    except ValueError:
        raise RigInputError(f"{where}: Date {date!r}, Time {time!r}, allowed YYYY/MM/DD and HH:MM:SS.XXX") from None
    return ((day * 24 + hour) * 60 + minute) * 60 + second if date and time else 0.0


def _parse_whole_numbers(cells: list[str], key: str, where: str) -> list[int]:
    cells = [cell.strip() for cell in cells]
    if not cells or not all(cell.isascii() and cell.isdigit() and len(cell) < 12 for cell in cells):
        raise RigInputError(f"{where}: {key} {cells}, allowed whole numbers")
    return [int(cell) for cell in cells]


def _numbers(cells: list[str], decimal: str, what: str, where: str) -> list[float]:
    try:
        return [parse_number(cell, decimal) for cell in cells]
    except ValueError as error:
        raise RigInputError(f"{where}: {what} found {shorten_cell(str(error))}, allowed a number") from None
