"""A table of the key's measured angle: read, checked, lost angles left out.

Columns (n,) in, usable columns out; the first row that cannot be used ends in ``InputError``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .column_file import read_columns
from .errors import InputError

Array = NDArray[np.float64]

FEWEST, MOST = 20, 200_000  # samples
LARGEST_KEY_RAD, LARGEST_TIME_S = 3.0, 1e6


def check_motion_table(time_s: ArrayLike, key_rad: ArrayLike, where: str = "key motion") -> tuple[Array, Array]:
    """Times and angles (n,) that can be used; lost ones (NaN) are left out. ``InputError`` names the first bad row."""
    try:
        times, angles = np.asarray(time_s, dtype=float), np.asarray(key_rad, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{where}: found something that is not a number; allowed two columns of numbers") from None
    if times.ndim != 1 or times.shape != angles.shape:
        raise InputError(f"{where}: found shapes {times.shape} and {angles.shape}, allowed two equal columns")
    lost = np.isnan(angles)
    for name, column, limit in (("time_s", times, LARGEST_TIME_S), ("key_rad", angles, LARGEST_KEY_RAD)):
        bad = (np.abs(column) > limit) | (~np.isfinite(column) & ~(lost if name == "key_rad" else False))
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"{where}: row {row + 1}: {name} found {column[row]:g}, allowed finite numbers up to {limit:g}"
            )
    if (np.diff(times) <= 0).any():
        row = int(np.argmax(np.diff(times) <= 0)) + 1
        raise InputError(
            f"{where}: row {row + 1}: time {times[row]:g} s does not follow {times[row - 1]:g} s; times must increase"
        )
    times, angles = times[~lost], angles[~lost]
    if not FEWEST <= len(times) <= MOST:
        raise InputError(f"{where}: found {len(times)} rows with an angle, allowed {FEWEST} to {MOST}")
    return times, angles


def read_motion_table(path: str | Path) -> tuple[Array, Array]:
    """Read a CSV file with the columns ``time_s,key_rad``; (n,) each, without rows whose angle is NaN."""
    table = read_columns(path, ("time_s", "key_rad"), ())
    return check_motion_table(table.numbers("time_s"), table.numbers("key_rad"), table.where)
