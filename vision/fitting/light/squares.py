"""Values of squares of a picture: medians, those that stand alone, those that say nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


def row_median(values: F64) -> F64:
    """Median of what is known in each row; several times faster than `numpy.nanmedian` on rows this short."""
    ordered, count = np.sort(values, axis=1), np.isfinite(values).sum(axis=1)
    row = np.arange(len(values))
    return np.asarray(0.5 * (ordered[row, (count - 1) // 2] + ordered[row, count // 2]))


def among_others(change: F64) -> F64:
    """Squares that are believed without most of their neighbours are flat by chance, not the body's texture."""
    known = np.pad(np.isfinite(change).astype(int), 1)
    rows, columns = change.shape
    inside = np.pad(np.ones(change.shape, dtype=int), 1)
    near, there = (
        sum(one[y : y + rows, x : x + columns] for y in range(3) for x in range(3)) - one[1:-1, 1:-1]
        for one in (known, inside)
    )
    return np.where(2 * near >= there, change, np.nan)


def filled(change: F64) -> F64:
    """Squares that say nothing get the value of the nearest ones that do, step by step."""
    values = change.copy()
    while np.isnan(values).any():
        padded = np.pad(values, 1, constant_values=np.nan)
        near = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
        known = np.isfinite(near)
        if not known.any():
            return np.zeros_like(values)
        mean = np.where(known, near, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        unknown = np.isnan(values) & known.any(axis=0)
        values[unknown] = mean[unknown]
    return values
