"""The readers of foreign recordings, chosen by the ending of a file's name: CSV, LabVIEW text, TDMS and HDF5.

CSV: one row of names, optionally one of units, then one row per sample; ``#`` lines and empty lines are skipped.
Conventions: separator, decimal sign and sign between thousands are given, never guessed. A unit may also stand in
brackets after a name, ``Force (N)``; the name keeps it. A column of clock times (``10:15:00.0002``, ISO 8601 date and
time) becomes seconds after its first row, whose date tells when the recording began. A row that is too short or long is
refused with its number (from 1 below the names), a column with a cell that is not a number when that column is used.

Text is UTF-8, UTF-16 with or without its mark, or the western Latin-1 of Windows. Numbers are ASCII in all of them; an
encoding guessed wrongly could only garble a name or a unit, which the mapping would then not find.

LabVIEW measurement files (``.lvm``): a header of the file, then segments: a header each and rows of numbers.

Separator and decimal sign are those the header states. Values of a segment header stand in the column of the channel
they belong to. ``X_Columns`` ``One``, ``Multi`` and ``No`` (times from ``X0`` and ``Delta_X``) are read; where all
channels have the same times these are channel ``X_Value``. Every segment becomes a table; with ``Multi_Headings``
``No`` only the first has a header, and the others as many rows as that says. Special blocks are skipped. A number of
rows other than ``Samples`` says is refused. Source: National Instruments, Specification for the LabVIEW Measurement
File, 2.0.

Segments of a file are joined only where the file's own times continue from one to the next, or where it states none.

HDF5: a sealed trial of a session, or any file with one-dimensional datasets of numbers (``name``, ``group/name``).
A trial gives ``force_n`` (less its mean before the blow), ``motor_command_v`` and the angles in rad; its seal is
checked first. Other files carry no checksum: what the HDF5 library cannot read is refused. A dataset's attribute
``units`` is its unit.

TDMS of LabVIEW and NI-DAQmx, by npTDMS (extra ``tdms``): every numeric channel, as ``channel`` or ``group/channel``.
Clocks are the waveform properties ``wf_increment``, ``wf_start_offset`` and ``wf_start_time``; a channel of time stamps
becomes seconds after its first. Scales of DAQmx and LabVIEW are applied by npTDMS. TDMS has no checksum: a file that
is cut off or whose sizes do not fit the file is refused, changed numbers cannot be noticed.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import logging
import struct
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.atomic_write import refused
from rig.errors import RigInputError
from rig.foreign.channel_table import (
    JITTER,
    SECONDS,
    ChannelTable,
    Clock,
    even_interval,
    is_units_row,
    known,
    number,
    of_name,
    shown,
)
from rig.session.sealed_trial import SCHEMA, read_trial

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # before UTF-16, whose mark begins like it
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def read_text(path: Path) -> str:
    """Read a text file of another program, gzipped or not; raises RigInputError when it cannot be read."""
    with refused(path, "read"):
        data = path.read_bytes()
    if path.suffix.lower() == ".gz":
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise RigInputError(f"{path}: not a whole gzip file ({error}); fetch it again") from None
    return decoded(data, str(path))


def decoded(data: bytes, where: str) -> str:
    """Return the text of ``data``; ``where`` names it in errors."""
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return _decode(data[len(mark) :], encoding, where)
    if wide := _unmarked_utf16(data):
        return _decode(data, wide, where)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        # cp1252 leaves five bytes undefined, Latin-1 none
        return data.decode("latin-1" if set(data) & set(b"\x81\x8d\x8f\x90\x9d") else "cp1252")


def _decode(data: bytes, encoding: str, where: str) -> str:
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        raise RigInputError(f"{where}: byte {error.start} is not {encoding} text, as its first bytes say") from error


def _unmarked_utf16(data: bytes) -> str:
    """Return the byte order of UTF-16 without a mark: ASCII signs beside a zero each; empty for other text."""
    begin = data[:256]
    if len(begin) < 4 or len(data) % 2:
        return ""
    for order, zeros, signs in (("utf-16-le", begin[1::2], begin[::2]), ("utf-16-be", begin[::2], begin[1::2])):
        if zeros.count(0) > 0.9 * len(zeros) and 0 not in signs:
            return order
    return ""


UNDATED = 1900
"""Year of clock times without a date."""


def parse_csv(text: str, where: str, separator: str = ",", decimal: str = ".", thousands: str = "") -> ChannelTable:
    """Read CSV text; ``where`` names it in errors.

    Raises RigInputError when it has no rows, or rows of several lengths.
    """
    if "\0" in text:
        raise RigInputError(f"{where}: holds null characters; not a CSV text file")
    lines = (line for line in text.removeprefix("\ufeff").splitlines() if line.strip() and not line.startswith("#"))
    try:
        rows = list(csv.reader(lines, delimiter=separator, strict=True))
    except csv.Error as error:
        raise RigInputError(f"{where}: not a CSV file ({error})") from None
    names = [name.strip() for name in rows[0]] if rows else []
    stated = [of_name(name) for name in names]
    first = 1
    if len(rows) > 1 and len(rows[1]) == len(names) and is_units_row(rows[1]):
        stated = [cell.strip().strip("()[]").strip() or unit for cell, unit in zip(rows[1], stated, strict=True)]
        first = 2
    if len(rows) <= first:
        raise RigInputError(
            f"{where}: {max(len(rows) - first, 0)} rows of numbers, allowed from 1 below a row of names"
        )
    for i, row in enumerate(rows[first:], first):
        if len(row) != len(names):
            raise RigInputError(
                f"{where}: row {i}: {len(row)} cells, allowed {len(names)}, one for each name (separator {separator!r})"
            )
    if all(not name for name in names):
        raise RigInputError(f"{where}: its first row holds no name of a column")
    columns, unreadable, started = {}, {}, ""
    for k, name in enumerate(names):
        if names.count(name) > 1 and name:
            unreadable[name] = f"{names.count(name)} columns are named {name!r}; names must be unique"
        elif name:
            try:
                columns[name], clock = _column([row[k] for row in rows[first:]], decimal, thousands, first)
                stated[k] = "s" if clock else stated[k]
                if clock is not None and clock.year > UNDATED:
                    started = started or clock.isoformat()
            except ValueError as error:
                unreadable[name] = f"{name} {error}"
    known = {name: unit for name, unit in zip(names, stated, strict=True) if unit and name in columns}
    return ChannelTable(where, columns, known, unreadable=unreadable, started=started)


def _column(cells: list[str], decimal: str, thousands: str, first: int) -> tuple[NDArray[np.float64], datetime | None]:
    """Numbers of a column; the first of clock times, None for plain numbers."""
    started = _clock_time(cells[0], decimal)
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        try:
            if started is None:
                values[i] = number(cell, decimal, thousands)
            else:
                read = _clock_time(cell, decimal)
                if read is None:
                    raise ValueError
                values[i] = (read - started).total_seconds()
        except (ValueError, TypeError):
            what = "a number" if started is None else "a time like the first"
            if started is None and "." in cell and decimal == "," and not thousands:
                what += ' (the mapping can say thousands = ".")'
            raise ValueError(f"row {first + i}: found {shown(cell)}, allowed {what}") from None
    return values, started


def _clock_time(cell: str, decimal: str) -> datetime | None:
    """A time of day, on an arbitrary date, or a date and time; None for anything else."""
    text = cell.strip().replace(decimal, ".")
    if ":" not in text:
        return None
    try:
        return datetime.fromisoformat(text if "-" in text or "/" in text else f"{UNDATED}-01-01T{text}")
    except ValueError:
        return None


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


def parse_lvm(text: str, where: str) -> tuple[ChannelTable, ...]:
    """Read the segments of LVM text; ``where`` names it in errors.

    Raises RigInputError when it is not such a file or is truncated.
    """
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
            name: _column_clock(time, steps.get(name), f"{where}: {TIME} of {name}")
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


def _column_clock(time: NDArray[np.float64], stated: float | None, what: str) -> Clock:
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


def read_hdf5(path: Path) -> ChannelTable:
    """Read the channels of a trial or of a plain HDF5 file.

    Raises RigInputError when the file cannot be read or has no numbers.
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("schema") != SCHEMA:
                return _plain(path, file)
    except RigInputError:
        raise
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        raise RigInputError(f"{path}: not a readable HDF5 file ({' '.join(str(error).split())[:120]})") from None
    data = read_trial(path)
    no_force = not data.has_force
    before = data.time_s < data.blow_start_s
    baseline_n = float(data.force_n[before].mean()) if before.any() else 0.0
    angles = {f"{e.name}_rad": data.angle_rad()[:, i] for i, e in enumerate(data.encoders)}
    further = {}
    if no_force and data.channel_values is not None:
        further = {info.name: data.channel_values[:, k] for k, info in enumerate(data.channels)}
    force = {} if no_force else {"force_n": data.force_n - baseline_n}
    columns = {"time_s": data.time_s, **force, "motor_command_v": data.motor_command_v, **angles, **further}
    clock = Clock(1.0 / data.sample_rate_hz)
    units = {"time_s": "s", "force_n": "N", "motor_command_v": "V", **dict.fromkeys(angles, "rad")}
    return ChannelTable(str(path), columns, units, dict.fromkeys(columns, clock), started=data.started_utc)


def _plain(path: Path, file: h5py.File) -> ChannelTable:
    columns, units = {}, {}

    def take(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset) and node.ndim == 1 and node.dtype.kind in "iuf" and node.size:
            columns[name] = np.asarray(node[()], dtype=np.float64)
            stated = node.attrs.get("units", b"")
            units[name] = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else str(stated)

    file.visititems(take)
    if not columns:
        raise RigInputError(f"{path}: no one-dimensional dataset of numbers")
    return ChannelTable(str(path), columns, {name: unit for name, unit in units.items() if unit})


_MARK = struct.Struct("<4sI")
_SIZES = {False: struct.Struct("<IQQ"), True: struct.Struct(">IQQ")}
_BIG_ENDIAN = 1 << 6
"""Bit of the table of contents, which itself is always little-endian."""


class _Complaints(logging.Handler):
    """Collects the warnings of npTDMS."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Store one line."""
        self.lines.append(record.getMessage())


def read_tdms(path: Path) -> ChannelTable:
    """Read all numeric channels of a TDMS file.

    Raises RigInputError when npTDMS is not installed, or the file is damaged, cut off or without numeric channels of
    one length.
    """
    try:
        from nptdms import TdmsFile, log  # start-up: an optional package, only TDMS needs it
    except ImportError:
        raise RigInputError(f"{path}: reading TDMS needs npTDMS; pip install 'piano-action-rig[tdms]'") from None
    complaints = _Complaints()
    log.log_manager.set_level(logging.ERROR)
    logger = logging.getLogger("nptdms")
    logger.addHandler(complaints)
    try:
        size = path.stat().st_size
        _check_segments(path, size)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # npTDMS leaves a file open that it fails to read
            with path.open("rb") as stream, TdmsFile.open(stream) as file:
                return _read(path, file, size, complaints)
    except RigInputError:
        raise
    except OSError as error:
        raise RigInputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # a damaged file makes npTDMS raise nearly anything
        words = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise RigInputError(f"{path}: not a whole TDMS file ({words})") from None
    finally:
        logger.removeHandler(complaints)


def _check_segments(path: Path, size: int) -> None:
    """Refuse a file whose segments do not follow each other from its first byte to its last."""
    at = 0
    with path.open("rb") as stream:
        while at < size:
            stream.seek(at)
            lead = stream.read(_MARK.size + _SIZES[False].size)
            if len(lead) < _MARK.size + _SIZES[False].size or lead[:4] != b"TDSm":
                raise RigInputError(f"{path}: not a whole TDMS file (no segment at byte {at})")
            contents = _MARK.unpack_from(lead)[1]
            version, following, raw = _SIZES[bool(contents & _BIG_ENDIAN)].unpack_from(lead, _MARK.size)
            at += len(lead) + following
            if at > size or raw > following or version not in (4712, 4713):
                raise RigInputError(f"{path}: not a whole TDMS file (its last segment is cut off at byte {size})")
    if not size:
        raise RigInputError(f"{path}: is empty")


def _read(path: Path, file: object, size: int, complaints: _Complaints) -> ChannelTable:
    channels = [
        channel
        for group in file.groups()  # type: ignore[attr-defined]
        for channel in group.channels()
        if channel.dtype.kind in "iufM" and len(channel)
    ]
    if not channels:
        raise RigInputError(f"{path}: no numeric channel")
    if sum(len(channel) * channel.dtype.itemsize for channel in channels) > 16 * size:
        raise RigInputError(f"{path}: names more samples than its {size} bytes hold; the file is damaged")
    short = Counter(channel.name for channel in channels)
    columns, units, clocks, started = {}, {}, {}, ""
    for channel in channels:
        name = channel.name if short[channel.name] == 1 else f"{channel.group_name}/{channel.name}"
        values = channel[:]
        if len(values) != len(channel):
            raise RigInputError(f"{path}: not a whole TDMS file ({name} is cut off)")
        stamps = channel.dtype.kind == "M"
        columns[name] = (
            (values - values[0]) / np.timedelta64(1, "ns") * 1e-9 if stamps else np.asarray(values, dtype=np.float64)
        )
        units[name] = "s" if stamps else str(channel.properties.get("unit_string", ""))
        if (clock := _waveform_clock(channel.properties)) is not None:
            clocks[name] = clock
        begun = values[0] if stamps else channel.properties.get("wf_start_time")
        if not started and isinstance(begun, np.datetime64) and not np.isnat(begun):
            started = f"{begun.astype('datetime64[us]')}+00:00"  # TDMS keeps times in UTC
    if complaints.lines:
        raise RigInputError(f"{path}: not a whole TDMS file ({complaints.lines[0][:120]})")
    return ChannelTable(str(path), columns, {k: v for k, v in units.items() if v}, clocks, started=started)


def _waveform_clock(properties: Mapping[str, object]) -> Clock | None:
    """Clock by the waveform properties; None where the increment is not stated."""
    interval, offset = properties.get("wf_increment"), properties.get("wf_start_offset", 0.0)
    if not isinstance(interval, float | int) or not (np.isfinite(interval) and interval > 0):
        return None
    start = float(offset) if isinstance(offset, float | int) and np.isfinite(offset) else 0.0
    begun = properties.get("wf_start_time")
    stamp = begun.astype("datetime64[ns]").astype(np.int64) * 1e-9 if isinstance(begun, np.datetime64) else 0.0
    return Clock(float(interval), start, float(stamp))


SUFFIXES = (".csv", ".csv.gz", ".txt", ".lvm", ".tdms", ".h5", ".hdf5")


def read_segments(
    path: str | Path, *, separator: str = ",", decimal: str = ".", thousands: str = ""
) -> tuple[ChannelTable, ...]:
    """Read all channels of a recording, one table a segment; the signs are for CSV only.

    Raises RigInputError when the ending is not known or the file cannot be used.
    """
    file = Path(path)
    suffix = "".join(file.suffixes[-2:]).lower() if file.suffix.lower() == ".gz" else file.suffix.lower()
    if suffix in (".csv", ".txt", ".csv.gz", ".txt.gz"):
        return (parse_csv(read_text(file), str(file), separator, decimal, thousands),)
    if suffix == ".lvm":
        return parse_lvm(read_text(file), str(file))
    if suffix == ".tdms":
        return (read_tdms(file),)
    if suffix in (".h5", ".hdf5"):
        return (read_hdf5(file),)
    raise RigInputError(f"{file}: ending {suffix!r}, allowed {', '.join(SUFFIXES)}")


def read_channels(path: str | Path, *, separator: str = ",", decimal: str = ".") -> ChannelTable:
    """Read a recording of one segment.

    Parameters
    ----------
    path : path
        TDMS, LVM, CSV or HDF5 file.
    separator, decimal : str
        Of CSV.

    Returns
    -------
    ChannelTable
        Channels by name, each (n,), with units and clocks as far as the file states them.

    Raises
    ------
    RigInputError
        When the file cannot be read, or has several segments.

    Examples
    --------
    >>> import rig
    >>> rig.read_channels("lab.csv").channel("force_n").size
    5001
    """
    segments = read_segments(path, separator=separator, decimal=decimal)
    if len(segments) != 1:
        raise RigInputError(
            f"{path}: {len(segments)} segments, allowed 1 here; save the one that is meant to its own file"
        )
    return segments[0]


def joined(segments: Sequence[ChannelTable], names: Sequence[str]) -> ChannelTable:
    """Return segments as one table with the channels ``names``.

    Raises RigInputError when a channel is not in all of them, has several units or intervals, or time is missing
    between them.
    """
    first = segments[0]
    whole = {name: np.concatenate([segment.channel(name) for segment in segments]) for name in names}
    for before, after in zip(segments, segments[1:], strict=False):
        for name in names:
            if before.units.get(name, "") != after.units.get(name, ""):
                raise RigInputError(
                    f"{after.where}: {name} is in {after.units.get(name, '')!r}, in the segment before it in "
                    f"{before.units.get(name, '')!r}; such segments cannot be joined"
                )
            if name not in before.clocks or name not in after.clocks:
                continue
            one, other = before.clocks[name], after.clocks[name]
            n = before.channel(name).size
            if abs(other.interval_s - one.interval_s) * n > 0.5 * one.interval_s:
                raise RigInputError(
                    f"{after.where}: a sample every {other.interval_s:g} s, in the segment before it every "
                    f"{one.interval_s:g} s; such segments cannot be joined"
                )
            later = other.start_s - one.start_s, other.stamp_s - one.stamp_s
            if later == (0.0, 0.0):
                continue  # times restart and no stamp is stated: the mapping decides
            # times run on from the first segment's stamp, or restart at each segment's own
            spans = [sum(later)] if later[0] == 0.0 else [later[0], sum(later)]
            gap = min((span - n * one.interval_s for span in spans), key=abs)
            if abs(gap) > 0.5 * one.interval_s:
                raise RigInputError(
                    f"{after.where}: {name} begins {gap:g} s after the end of the segment before it; samples are "
                    'missing, segments = "trials" keeps them apart'
                )
    clocks = {name: first.clocks[name] for name in names if name in first.clocks}
    return ChannelTable(first.where.removesuffix(" segment 1"), whole, first.units, clocks, started=first.started)
