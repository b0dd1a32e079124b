"""CSV files of two named columns: a force or a key's angle over time.

Text in, numbers out, unchecked beyond being numbers; what they may be is the business of ``blow`` and ``motion_fit``.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .errors import InputError


def read_two_columns(path: str | Path, names: tuple[str, str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Columns ``names`` of a CSV file in that order, (k,) each; ``InputError`` says what is wrong in which row."""
    wanted = ",".join(names)
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror})") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(f"{path}: is not a CSV text file; allowed columns {wanted}") from None
    if not rows:
        raise InputError(f"{path}: is empty; allowed a header {wanted} and at least 2 rows")
    header = [name.strip() for name in rows[0]]
    if sorted(header) != sorted(names):
        raise InputError(f"{path}: columns found {','.join(header)}; allowed {wanted}")
    values = np.empty((len(rows) - 1, 2))
    for i, row in enumerate(rows[1:]):
        try:
            values[i] = [float(cell) for cell in row]
        except ValueError:
            raise InputError(f"{path}: row {i + 1}: found {','.join(row)!r}, allowed two numbers") from None
    return values[:, header.index(names[0])].copy(), values[:, header.index(names[1])].copy()
