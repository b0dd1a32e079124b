"""Traces of each trial as tables, and curves of several trials on one time base.

Place in the data flow: measurements and predictions → here → channel and score tables.
Conventions: SI and rad; changes since rest; nothing is aligned.
Failure: what cannot be stated is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from validation.events.key_lift import Lift, marked
from validation.measurement.geometry import Array
from validation.measurement.trial import ENCODER_CHANNELS, FILM_CHANNELS, Measurement
from validation.prediction.trial_prediction import BODIES, Prediction

# how a rival's columns are called
INFIX = {"null": "null", "raw_force": "raw"}


def trace_table(
    m: Measurement, p: Prediction, rivals: Mapping[str, Prediction], lifts: Sequence[Lift] = ()
) -> pd.DataFrame:
    """Force, encoder angles and predicted angles of one trial on the DAQ's sample times; marked key samples flagged."""
    columns: dict[str, NDArray[Any]] = {
        "time_s": m.time_s,
        "raw_force_n": m.raw_force_n,
        "force_time_s": m.force.time_s,
        "force_n": m.force.force_n,
        "u_force_n": m.force.u_force_n,
    }
    columns |= {f"{name}_measured_rad": m.change_rad[:, i] for i, name in enumerate(ENCODER_CHANNELS)}
    columns["key_marked"] = marked(m.time_s, list(lifts))
    columns |= {f"{body}_predicted_rad": p.change_rad(body) for body in BODIES}
    for rival, q in rivals.items():
        columns |= {f"{body}_{INFIX[rival]}_rad": q.change_rad(body) for body in ENCODER_CHANNELS}
    return pd.DataFrame(columns)


def film_trace_table(m: Measurement, p: Prediction, rivals: Mapping[str, Prediction]) -> pd.DataFrame | None:
    """Film angles, their uncertainty and predicted angles on the film's frame times; None when not filmed."""
    if m.film is None:
        return None
    columns = {"time_s": m.film.time_s}
    for name in FILM_CHANNELS:
        measured = m.film.change_rad[name]
        step = np.gradient(p.change_at(name, m.film.time_s), m.film.time_s)
        # a frame clock that is off by u_time moves a turning body by its speed times that
        moved = np.nan_to_num(np.abs(step)) * m.film.u_time_s
        columns[f"{name}_measured_rad"] = measured
        columns[f"{name}_u_rad"] = np.hypot(m.film.u_rad[name], moved)
        columns[f"{name}_predicted_rad"] = p.change_at(name, m.film.time_s)
        for rival, q in rivals.items():
            columns[f"{name}_{INFIX[rival]}_rad"] = q.change_at(name, m.film.time_s)
    return pd.DataFrame(columns)


def scored(frame: pd.DataFrame, channel: str) -> Array:
    """Measured angles of a channel, NaN where they are marked as false."""
    values = frame[f"{channel}_measured_rad"].to_numpy(dtype=float)
    flag = f"{channel}_marked"
    return np.where(frame[flag].to_numpy(dtype=bool), np.nan, values) if flag in frame else values


def on_common_base(time_s: Array, frames: dict[int, pd.DataFrame], column: str) -> Array:
    """One column of several trials on one time base, (n_samples, n_trials); NaN outside a trial."""
    out = np.full((time_s.size, len(frames)), np.nan)
    for j, frame in enumerate(frames.values()):
        time = frame["time_s"].to_numpy()
        channel = column.removesuffix("_measured_rad")
        values = frame[column].to_numpy() if channel == column else scored(frame, channel)
        if time.size >= time_s.size:
            first = int(np.searchsorted(time, time_s[0] - 1e-9))
            if first + time_s.size <= time.size and np.allclose(
                time[first : first + time_s.size], time_s, atol=1e-9, rtol=0
            ):
                out[:, j] = values[first : first + time_s.size]
                continue
        out[:, j] = np.interp(time_s, time, values, left=np.nan, right=np.nan)
    return out
