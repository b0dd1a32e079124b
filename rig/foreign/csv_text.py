"""CSV: one row of names, optionally one of units, then one row per sample; ``#`` lines and empty lines are skipped.

Conventions: separator, decimal sign and sign between thousands are given, never guessed. A unit may also stand in
brackets after a name, ``Force (N)``; the name keeps it. A column of clock times (``10:15:00.0002``, ISO 8601 date and
time) becomes seconds after its first row, whose date tells when the recording began. A row that is too short or long is
refused with its number (from 1 below the names), a column with a cell that is not a number when that column is used.

Text is UTF-8, UTF-16 with or without its mark, or the western Latin-1 of Windows. Numbers are ASCII in all of them; an
encoding guessed wrongly could only garble a name or a unit, which the mapping would then not find.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import zlib
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, is_units_row, number, of_name, shown
from rig.storage.atomic_write import refused

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


def read_csv(path: Path, separator: str = ",", decimal: str = ".", thousands: str = "") -> ChannelTable:
    """Read all columns of a CSV file.

    Raises RigInputError when the file cannot be read, has no rows, or rows of several lengths.
    """
    return parse_csv(read_text(path), str(path), separator, decimal, thousands)


def parse_csv(text: str, where: str, separator: str = ",", decimal: str = ".", thousands: str = "") -> ChannelTable:
    """Read CSV text; ``where`` names it in errors."""
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
    started = _clock(cells[0], decimal)
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        try:
            if started is None:
                values[i] = number(cell, decimal, thousands)
            else:
                read = _clock(cell, decimal)
                if read is None:
                    raise ValueError
                values[i] = (read - started).total_seconds()
        except (ValueError, TypeError):
            what = "a number" if started is None else "a time like the first"
            if started is None and "." in cell and decimal == "," and not thousands:
                what += ' (the mapping can say thousands = ".")'
            raise ValueError(f"row {first + i}: found {shown(cell)}, allowed {what}") from None
    return values, started


def _clock(cell: str, decimal: str) -> datetime | None:
    """A time of day, on an arbitrary date, or a date and time; None for anything else."""
    text = cell.strip().replace(decimal, ".")
    if ":" not in text:
        return None
    try:
        return datetime.fromisoformat(text if "-" in text or "/" in text else f"{UNDATED}-01-01T{text}")
    except ValueError:
        return None
