"""Traces of each trial as tables: measured and predicted angles, forces, speeds.

Conventions: SI and rad; changes since rest; nothing is aligned; what cannot be stated is NaN. Speeds and the angles of
rivals are in single precision: they are shown and scored to three digits, and a session has hundreds of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from validation.conventions import BODIES, ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.events.evaluation_window import Window
from validation.events.key_lift import KeyLift, lifted_samples
from validation.measurement.trial import MeasuredTrial
from validation.prediction.session import PredictedTrial

# how the columns of a rival begin
INFIX = {"null": "null", "raw_force": "raw"}


@dataclass(frozen=True)
class SessionTraces:
    """Traces of all trials on encoder and on film times, the window they are scored in, and their string impacts."""

    encoder: dict[int, pd.DataFrame]
    film: dict[int, pd.DataFrame]
    window: Window
    impact_s: Mapping[int, float]

    def of(self, source: str) -> dict[int, pd.DataFrame]:
        """Traces of a source, ``encoder`` or ``film``."""
        return self.encoder if source == "encoder" else self.film

    @property
    def base_s(self) -> Array:
        """Common time base: sample times of the first trial inside the window."""
        base = next(iter(self.encoder.values()))["time_s"].to_numpy()
        return np.asarray(base[self.window.mask(base)])


def trace_table(m: MeasuredTrial, p: PredictedTrial, lifts: Sequence[KeyLift], speeds: pd.DataFrame) -> pd.DataFrame:
    """Force, angles, speeds and predicted angles of one trial on the DAQ's sample times; lifts of the key flagged."""
    columns: dict[str, NDArray[Any]] = {
        "time_s": m.time_s,
        "raw_force_n": m.raw_force_n,
        "force_time_s": m.force.time_s,
        "force_n": m.force.force_n,
        "u_force_n": m.force.u_force_n,
    }
    columns |= {f"{name}_measured_rad": m.change_rad[:, i] for i, name in enumerate(ENCODER_CHANNELS)}
    columns["key_marked"] = lifted_samples(m.time_s, lifts)
    columns |= {f"{body}_predicted_rad": p.model.change_rad(body) for body in BODIES}
    for rival, q in p.rivals.items():
        columns |= {f"{body}_{INFIX[rival]}_rad": q.encoder[body] for body in ENCODER_CHANNELS}
    columns |= {str(name): speeds[name].to_numpy(np.float32) for name in speeds.columns if name != "time_s"}
    return pd.DataFrame(columns, copy=False)  # the arrays of trial and prediction themselves: of 200 trials 0.3 GB


def film_trace_table(m: MeasuredTrial, p: PredictedTrial) -> pd.DataFrame | None:
    """Film angles, their uncertainty and predicted angles on the film's frame times; None when not filmed."""
    if m.film is None:
        return None
    columns = {"time_s": m.film.time_s}
    for name in FILM_CHANNELS:
        predicted = p.model.change_at(name, m.film.time_s)
        # a frame clock that is off by u_time moves a turning body by its speed times that
        moved = np.nan_to_num(np.abs(np.gradient(predicted, m.film.time_s))) * m.film.u_time_s
        columns[f"{name}_measured_rad"] = m.film.change_rad[name]
        columns[f"{name}_u_rad"] = np.hypot(m.film.u_rad[name], moved)
        columns[f"{name}_predicted_rad"] = predicted
        for rival, q in p.rivals.items():
            columns[f"{name}_{INFIX[rival]}_rad"] = q.film[name]
    return pd.DataFrame(columns)


def scored(frame: pd.DataFrame, channel: str) -> Array:
    """Measured angles of a channel, NaN where they are left out of the scores."""
    values = frame[f"{channel}_measured_rad"].to_numpy(dtype=float)
    flag = f"{channel}_marked"
    return np.where(frame[flag].to_numpy(dtype=bool), np.nan, values) if flag in frame else values
