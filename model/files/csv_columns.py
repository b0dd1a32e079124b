"""Reading a CSV file of named columns: force tables, loading curves, motions.

First row the names, then one row per sample; lines that begin with # and empty lines are skipped. Errors name
file, row and column; rows count from 1 below the names.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError


@dataclass(frozen=True)
class ColumnFile:
    """Names of the columns and their cells as text, one row each."""

    where: str
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def words(self, name: str) -> list[str]:
        """Cells of one column, stripped."""
        k = self.names.index(name)
        return [row[k].strip() for row in self.rows]

    def numbers(self, name: str) -> NDArray[np.float64]:
        """One column as numbers (m,); ``InputError`` at the first cell that is not a number."""
        out = np.empty(len(self.rows))
        for i, cell in enumerate(self.words(name)):
            try:
                out[i] = float(cell)
            except ValueError:
                raise InputError(f"{self.where}: row {i + 1}: {name} found {cell!r}, allowed a number") from None
        return out


def read_columns(
    path: str | Path, wanted: Sequence[str], optional: Sequence[str] | None = None, prefix: str | None = None
) -> ColumnFile:
    """Read a CSV file, without lines that begin with ``#``: it must have the columns ``wanted``; others must be in
    ``optional`` (None: any) or begin with ``prefix``. `InputError` else."""
    where, allowed = str(path), ",".join(wanted)
    if optional:
        allowed += f" and optionally {','.join(optional)}"
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [tuple(row) for row in csv.reader(file) if row and not row[0].startswith("#")]
    except OSError as problem:
        raise InputError(f"{where}: cannot be read ({problem.strerror}); allowed a CSV file") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(f"{where}: is not a CSV text file in UTF-8; allowed columns {allowed}") from None
    if not rows:
        raise InputError(f"{where}: is empty; allowed columns {allowed}")
    names = tuple(name.strip() for name in rows[0])
    free = {name for name in names if prefix is not None and name.startswith(prefix)}
    known = optional is None or set(names) <= {*wanted, *optional, *free}
    if not set(wanted) <= set(names) or len(set(names)) < len(names) or not known:
        raise InputError(f"{where}: columns found {','.join(names)}; allowed {allowed}")
    for i, row in enumerate(rows[1:], 1):
        if len(row) != len(names):
            raise InputError(f"{where}: row {i}: found {len(row)} cells, allowed {len(names)}, one for each column")
    return ColumnFile(where, names, tuple(rows[1:]))
