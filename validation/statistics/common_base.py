"""Curves of several trials on one time base."""

from __future__ import annotations

import numpy as np
import pandas as pd

from validation.conventions import Array
from validation.curves.time_base import on_base
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
        out[:, j] = on_base(time_s, time, values)
    return out
