"""CSV: one row of names, optionally one of units, then one row per sample; ``#`` lines and empty lines are skipped.

Separator, decimal sign and sign between thousands are given, never guessed. Names may stand on a stated line, below
lines that are skipped, or in the ``#`` lines directly above the numbers, as numpy.savetxt writes them. A column
of clock times (``10:15:00.0002``, with or without a date) becomes seconds after its first row; a date of ISO 8601 tells
when the recording began, any other must stay the same, because its order of day and month is not known. Rows of empty
cells at the end are left out. A row that is too short or long is refused with its number (from 1 below the names), a
column with a cell that is not a number when that column is used.

The standard library's parser is used, not pandas': it keeps a short row short, where pandas fills it with NaN.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import re
import zlib
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.atomic_write import translate_os_error
from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, is_units_row, parse_number, parse_numbers, shorten_cell

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # before UTF-16, whose mark begins like it
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def read_text(path: Path) -> str:
    """Return the text of a file of another program, decoded as `decode_text` does, unpacked where its name ends in
    ``.gz``; RigInputError when it cannot be read."""
    with translate_os_error(path, "read"):
        data = path.read_bytes()
    if path.suffix.lower() == ".gz":
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise RigInputError(f"{path}: not a whole gzip file ({error}); fetch it again") from None
    return decode_text(data, str(path))


def decode_text(data: bytes, where: str) -> str:
    """Decode bytes by their byte order mark; without one as UTF-16 where every other byte is zero, else UTF-8, else
    Windows-1252 or Latin-1. RigInputError, which names ``where``, where the mark is wrong."""
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return _decode(data[len(mark) :], encoding, where)
    if wide := _detect_utf16(data):
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


ASCII_SHARE = 0.9  # of a table's signs: units and names may hold others


def _detect_utf16(data: bytes) -> str:
    """Codec ``utf-16-le`` or ``utf-16-be`` of bytes without a byte order mark in which about every other byte is zero;
    empty for other text."""
    begin = data[:256]
    if len(begin) < 4 or len(data) % 2:
        return ""
    for order, zeros, signs in (("utf-16-le", begin[1::2], begin[::2]), ("utf-16-be", begin[::2], begin[1::2])):
        if zeros.count(0) > ASCII_SHARE * len(zeros) and 0 not in signs:
            return order
    return ""


UNDATED = 1900  # year of clock times without a date
_SEPARATOR_LINE = re.compile(r"\"?sep=(.)\"?\s*", re.IGNORECASE)
"""First line of a CSV file for Excel."""


def parse_csv(
    text: str,
    where: str,
    separator: str = ",",
    decimal: str = ".",
    thousands: str = "",
    *,
    names_row: int | None = None,
    skip_rows: int = 0,
) -> ChannelTable:
    """Read CSV text (names, optionally units, then a row a sample) into a table; a column with a cell that is no number
    is refused only when it is used. RigInputError, which begins with ``where``, for rows of unequal length.

    ``names_row`` is the line of the names, from 1, ``skip_rows`` how many lines before them are left out.
    """
    if "\0" in text:
        raise RigInputError(f"{where}: holds null characters; not a CSV text file")
    lines = text.removeprefix("\ufeff").splitlines()
    stated = _SEPARATOR_LINE.fullmatch(lines[0]) if lines else None
    if stated and stated[1] != separator:
        raise RigInputError(f"{where}: its first line says sep={stated[1]}, the mapping separator = {separator!r}")
    lines = lines[max(skip_rows if names_row is None else names_row - 1, int(stated is not None)) :]
    if names_row is not None and lines:
        lines[0] = lines[0].lstrip("# ")
    try:
        rows = list(csv.reader(_drop_comments(lines), delimiter=separator, strict=True))
        cells = [cell for cell in rows[0] if cell.strip()] if rows and names_row is None else []
        if cells and all(_is_value(cell, decimal, thousands) for cell in cells):
            rows = [*_commented_names(lines, len(rows[0]), separator, where), *rows]
    except csv.Error as error:
        raise RigInputError(f"{where}: not a CSV file ({error})") from None
    names = [name.strip() for name in rows[0]] if rows else []
    units = [""] * len(names)
    first = 1
    while rows and not any(cell.strip() for cell in rows[-1]):  # spreadsheets write them for formatted empty cells
        rows.pop()
    if len(rows) > 1 and all(len(row) == len(names) + 1 and not row[-1].strip() for row in rows[1:]):
        rows[1:] = [row[:-1] for row in rows[1:]]  # a separator at the end of each row but that of the names
    if len(rows) > 1 and len(rows[1]) == len(names) and is_units_row(rows[1], decimal):
        units = [cell.strip().strip("()[]").strip() or unit for cell, unit in zip(rows[1], units, strict=True)]
        first = 2
    if len(rows) <= first:
        raise RigInputError(
            f"{where}: {max(len(rows) - first, 0)} rows of numbers, allowed from 1 below a row of names"
        )
    for i, row in enumerate(rows[first:], first):
        if len(row) != len(names):
            raise RigInputError(
                f"{where}: row {i}: {len(row)} cells, allowed {len(names)}, one for each name (separator "
                f"{separator!r}); names_row in the mapping tells the line of the names"
            )
    if all(not name for name in names):
        raise RigInputError(f"{where}: its first row holds no name of a column")
    columns, unreadable, started = {}, {}, ""
    for k, name in enumerate(names):
        if names.count(name) > 1 and name:
            unreadable[name] = f"{names.count(name)} columns are named {name!r}; names must be unique"
        elif name:
            try:
                cells = [row[k] for row in rows[first:]]
                columns[name], clock = _parse_column(cells, decimal, thousands, first)
                units[k] = "s" if clock else units[k]
                if clock is not None and clock.year > UNDATED:
                    started = started or clock.isoformat()
            except ValueError as error:
                unreadable[name] = f"{name} {error}"
    known = {name: unit for name, unit in zip(names, units, strict=True) if unit and name in columns}
    return ChannelTable(where, columns, known, unreadable=unreadable, started=started)


def _drop_comments(lines: list[str]) -> Iterator[str]:
    return (line for line in lines if line.strip() and not line.startswith("#"))


def _is_value(cell: str, decimal: str, thousands: str) -> bool:
    """Whether a cell is a number or a time, so that no name of a column can be meant."""
    try:
        parse_number(cell, decimal, thousands)
    except ValueError:
        return _parse_clock_time(cell) is not None
    return True


def _commented_names(lines: list[str], width: int, separator: str, where: str) -> list[list[str]]:
    """Rows of cells in the ``#`` lines directly above the first row of numbers: the names and, where stated, the units;
    RigInputError, which begins with ``where``, if none has ``width`` cells."""
    first = next(i for i, line in enumerate(lines) if line.strip() and not line.startswith("#"))
    above = [line.lstrip("# ") for line in lines[max(first - 2, 0) : first] if line.startswith("#")]
    rows = [row for row in csv.reader(above, delimiter=separator, strict=True) if len(row) == width]
    rows = rows if len(rows) == 2 and is_units_row(rows[1]) else rows[-1:]
    if not rows or any(_is_value(cell, ".", "") for cell in rows[0]):
        raise RigInputError(
            f"{where}: its first row holds numbers, no names of columns; write a row of names above it, or tell its "
            "line by names_row in the mapping"
        )
    return rows


def _parse_column(
    cells: list[str], decimal: str, thousands: str, first: int
) -> tuple[NDArray[np.float64], datetime | None]:
    """Numbers (n,) of a column's cells and None; of clock times, s after the first, and that first time. ValueError
    names the row, counted from ``first``, of another cell."""
    begin = _parse_clock_time(cells[0])
    if begin is None:
        try:
            return parse_numbers(cells, decimal, thousands), None
        except ValueError as error:
            i, cell = error.args
        advice = _suggest_settings(cell, decimal, thousands)
        raise ValueError(f"row {first + i}: found {shorten_cell(cell)}, allowed a number{advice}")
    values = np.empty(len(cells))
    started, date = begin
    for i, cell in enumerate(cells):
        read = _parse_clock_time(cell)
        try:
            if read is None or read[1] != date:
                raise TypeError
            values[i] = (read[0] - started).total_seconds()
        except TypeError:  # one with a zone, one without
            raise ValueError(f"row {first + i}: found {shorten_cell(cell)}, allowed a time like the first") from None
    return values, started


def _suggest_settings(cell: str, decimal: str, thousands: str) -> str:
    """Advice, in brackets, which ``decimal`` or ``thousands`` in the mapping would make a number of a cell that is none
    by the present ones; empty where no sign does."""
    settings = [(sign, thousands) for sign in ".," if sign != decimal]
    settings += [(decimal, sign) for sign in (".", ",", " ", "'") if sign != decimal and not thousands]
    helpful = []
    for mark, sign in settings:
        try:
            parse_number(cell, mark, sign)
        except ValueError:
            continue
        helpful.append(f'thousands = "{sign}"' if mark == decimal else f'decimal = "{mark}"')
    return f" (the mapping can say {' or '.join(helpful)})" if helpful else ""


_TIME_OF_DAY = re.compile(
    r"(?P<date>[\d./-]+,?[ T]+)?((?P<hour>\d{1,2}):)?(?P<minute>\d{1,2}):(?P<second>\d\d)([.,:](?P<fraction>\d+))?"
    r" ?(?P<half>[AP]M)?",
    re.IGNORECASE,
)


def _parse_clock_time(cell: str) -> tuple[datetime, str] | None:
    """Read a date and time of ISO 8601 (the text is then empty), or a time of day, as of 1900, and the text of the date
    before it; None for anything else."""
    text = cell.strip()
    if ":" not in text:
        return None
    found = _TIME_OF_DAY.fullmatch(text)
    if found is None or "-" in (found["date"] or ""):
        try:
            return datetime.fromisoformat(text), ""
        except ValueError:
            pass
    if found is None:
        return None
    hour = int(found["hour"] or 0)
    if found["half"]:
        hour = hour % 12 + 12 * (found["half"].lower() == "pm")  # hours of half a day
    second = float(f"{found['second']}.{found['fraction'] or 0}")
    if second >= 61.0:  # the last one of a day may be a leap second
        return None
    try:
        day = datetime(UNDATED, 1, 1, hour, int(found["minute"]))
    except ValueError:
        return None
    return day + timedelta(seconds=second), found["date"] or ""
