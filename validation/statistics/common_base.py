"""Curves of several trials on one time base."""

from __future__ import annotations

import numpy as np
import pandas as pd

from validation.conventions import Array
from validation.scores.traces import scored


def on_common_base(time_s: Array, frames: dict[int, pd.DataFrame], column: str) -> Array:
    """One column of several trials on one time base, (n_samples, n_trials); NaN outside a trial.

    Sample times that agree are taken as they are; others are interpolated by straight lines.
    """
    out = np.full((time_s.size, len(frames)), np.nan)
    for j, frame in enumerate(frames.values()):
        time = frame["time_s"].to_numpy()
        channel = column.removesuffix("_measured_rad")
        values = frame[column].to_numpy() if channel == column else scored(frame, channel)
        if time.size >= time_s.size:
            first = int(np.searchsorted(time, time_s[0] - 1e-9))
            part = slice(first, first + time_s.size)
            if part.stop <= time.size and np.allclose(time[part], time_s, atol=1e-9, rtol=0):
                out[:, j] = values[part]
                continue
        out[:, j] = np.interp(time_s, time, values, left=np.nan, right=np.nan)
    return out
