"""Curves of several trials on one time base."""

from __future__ import annotations

import numpy as np

from validation.conventions import Array


def on_base(base_s: Array, time_s: Array, values: Array) -> Array:
    """Values at other times, (n_base,); NaN outside the record.

    Sample times that agree to 1 ns are taken as they are; others are interpolated by straight lines.
    """
    if time_s.size >= base_s.size:
        first = int(np.searchsorted(time_s, base_s[0] - 1e-9))
        part = slice(first, first + base_s.size)
        if part.stop <= time_s.size and np.allclose(time_s[part], base_s, atol=1e-9, rtol=0):
            return np.asarray(values[part], dtype=float)
    return np.asarray(np.interp(base_s, time_s, values, left=np.nan, right=np.nan), dtype=float)
