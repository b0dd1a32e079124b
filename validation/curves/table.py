"""Every curve of a result in one tidy table on one time base.

Conventions: SI and rad; changes since rest, counter-clockwise; the base is the one of ``spread``, sample times of the
first trial inside the evaluation window; jack and repetition lever are read between the film's frames by straight
lines. What does not exist is NaN.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd

from validation.conventions import BODIES, FILM_CHANNELS, Array
from validation.curves.time_base import on_base

VALUES = ("measured_rad", "predicted_rad", "null_rad", "u_rad")
COLUMNS = ["trial", "channel", "time_s", *VALUES, "left_out", "force_n"]


def trial_curves(base_s: Array, encoder: pd.DataFrame, film: pd.DataFrame | None) -> dict[str, dict[str, Array]]:
    """Curves of one trial by channel and column, on the base.

    Parameters
    ----------
    base_s : (n,) s
    encoder, film : DataFrame
        `validation.result.SessionTables.traces` and ``film_traces`` of the trial.
    """
    out = {}
    for channel in BODIES:
        frame = film if channel in FILM_CHANNELS else encoder
        nothing = np.full(base_s.size, np.nan)
        columns = {}
        for value in VALUES:
            name = f"{channel}_{value}"
            columns[value] = nothing
            if frame is not None and name in frame:
                columns[value] = on_base(base_s, frame["time_s"].to_numpy(), frame[name].to_numpy())
        if film is None and channel in FILM_CHANNELS:  # predicted all the same
            predicted = encoder[f"{channel}_predicted_rad"].to_numpy()
            columns["predicted_rad"] = on_base(base_s, encoder["time_s"].to_numpy(), predicted)
        out[channel] = columns
    return out


def force_on_base(base_s: Array, encoder: pd.DataFrame) -> Array:
    """Corrected force of one trial on the base, N."""
    return on_base(base_s, encoder["force_time_s"].to_numpy(), encoder["force_n"].to_numpy())


def left_out_on_base(base_s: Array, encoder: pd.DataFrame, channel: str) -> Array:
    """1 where a sample of a channel is left out of the scores."""
    flag = f"{channel}_marked"
    if flag not in encoder:
        return np.zeros(base_s.size)
    return on_base(base_s, encoder["time_s"].to_numpy(), encoder[flag].to_numpy(dtype=float))


def curve_table(
    base_s: Array,
    traces: Mapping[int, pd.DataFrame],
    films: Mapping[int, pd.DataFrame],
    trials: Iterable[int] | None = None,
) -> pd.DataFrame:
    """One row per trial, channel and time.

    Parameters
    ----------
    base_s : (n,) s
    traces, films : mapping of trial to DataFrame
        `validation.result.SessionTables.traces` and ``film_traces``.
    trials : iterable of int, optional
        Only these.

    Returns
    -------
    DataFrame
        trial, channel, time_s, measured_rad, predicted_rad, null_rad (null model), u_rad (of the film), left_out
        (of the scores), force_n (corrected, the same for all channels).
    """
    parts = []
    for trial in traces if trials is None else trials:
        force = force_on_base(base_s, traces[trial])
        for channel, columns in trial_curves(base_s, traces[trial], films.get(trial)).items():
            if not any(np.isfinite(v).any() for v in columns.values()):
                continue
            left_out = np.nan_to_num(left_out_on_base(base_s, traces[trial], channel)) > 0
            rest = {"left_out": left_out, "force_n": force}
            parts.append(pd.DataFrame({"trial": trial, "channel": channel, "time_s": base_s, **columns, **rest}))
    if not parts:
        return pd.DataFrame(columns=COLUMNS)
    table = pd.concat(parts, ignore_index=True)
    table["channel"] = pd.Categorical(table["channel"], categories=list(BODIES))
    return table
