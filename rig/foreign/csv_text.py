"""CSV: one row of names, then one row of numbers per sample; lines that begin with # and empty lines are passed over.

Conventions: UTF-8; separator and decimal sign are given, never guessed. A row that is too short or long, or a cell
that is no number, is refused with its row (from 1 below the names) and column.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from rig import toml_file
from rig.errors import InputError
from rig.foreign.channel_table import ChannelTable, number


def read_csv(path: Path, separator: str = ",", decimal: str = ".") -> ChannelTable:
    """Read all columns of a CSV file.

    Raises
    ------
    InputError
        When the file cannot be read, has no rows, or a name or cell cannot be used.
    """
    return parse_csv(toml_file.read_text(path), str(path), separator, decimal)


def parse_csv(text: str, where: str, separator: str = ",", decimal: str = ".") -> ChannelTable:
    """Read CSV text; ``where`` names it in errors."""
    if "\0" in text:
        raise InputError(f"{where}: holds null characters; not a CSV text file")
    lines = (line for line in text.removeprefix("\ufeff").splitlines() if line.strip() and not line.startswith("#"))
    try:
        rows = list(csv.reader(lines, delimiter=separator, strict=True))
    except csv.Error as error:
        raise InputError(f"{where}: not a CSV file ({error})") from None
    if len(rows) < 2:
        raise InputError(f"{where}: {max(len(rows) - 1, 0)} rows of numbers, allowed from 1 below a row of names")
    names = [name.strip() for name in rows[0]]
    if len(set(names)) != len(names) or not all(names):
        raise InputError(f"{where}: names {', '.join(names)[:200]!r} must be unique and not empty")
    values = np.empty((len(rows) - 1, len(names)))
    for i, row in enumerate(rows[1:]):
        if len(row) != len(names):
            raise InputError(f"{where}: row {i + 1}: {len(row)} cells, allowed {len(names)}, one for each name")
        for k, cell in enumerate(row):
            try:
                values[i, k] = number(cell, decimal)
            except ValueError:
                shown = cell if len(cell) <= 40 else cell[:37] + "..."
                raise InputError(f"{where}: row {i + 1}: {names[k]} found {shown!r}, allowed a number") from None
    return ChannelTable(where, {name: values[:, k].copy() for k, name in enumerate(names)})
