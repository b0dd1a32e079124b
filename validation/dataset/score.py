"""Scores of predictions on the test trials of a split whose truth is open.

Task: from the force of a trial, and its angles in the initialisation window, predict the angles. The score of a channel
is the RMSE after the window over the range of that channel in all scored trials, in percent; that of a prediction is
the mean over channels. Trials with a planted fault are not scored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from validation.dataset.files import Array, DataTrial, check_truth, read_index, trials_of
from validation.errors import ValidationInputError

if TYPE_CHECKING:
    import pandas as pd

SCORED = ("key_angle", "whippen_angle", "hammer_angle")
LEAST_RATE_HZ = 900.0
"""Predictions may be given at a lower rate than the data, but not below a millisecond and a tenth."""


@dataclass(frozen=True)
class Scores:
    """Scores in percent of the channels' ranges: by channel, their mean, and the mean of each trial."""

    by_channel: dict[str, float]
    overall: float
    by_trial: dict[int, float]


def score(folder: str | Path, predictions: str | Path | pd.DataFrame) -> Scores:
    """Score a table of predictions on the open split.

    Parameters
    ----------
    folder : path
        The data set.
    predictions : path or DataFrame
        Columns ``trial``, ``time`` (s) and ``key_angle``, ``whippen_angle``, ``hammer_angle`` (rad, since the first
        sample), at least at 1 kHz, for every test trial.

    Returns
    -------
    Scores

    Raises
    ------
    ValidationInputError
        A column or trial is missing, a value is not finite, or times do not cover a trial.

    Examples
    --------
    >>> import validation
    >>> measured = validation.dataset.load("dataset", part="test")  # a perfect prediction
    >>> validation.dataset.score("dataset", measured).overall
    0.0
    """
    import pandas as pd  # start-up: pandas costs 0.4 s, the loader of single trials does not need it

    where = "predictions" if isinstance(predictions, pd.DataFrame) else str(predictions)
    try:
        table = predictions if isinstance(predictions, pd.DataFrame) else pd.read_csv(predictions)
    except (OSError, ValueError) as error:
        raise ValidationInputError(f"{where}: cannot be read as a table ({str(error).splitlines()[0]})") from None
    if missing := [name for name in ("trial", "time", *SCORED) if name not in table]:
        raise ValidationInputError(
            f"{where}: no column {missing[0]!r}; found {list(table.columns)}, needed trial, time, {', '.join(SCORED)}"
        )
    try:
        table = table[["trial", "time", *SCORED]].astype(float)
    except (TypeError, ValueError) as error:
        raise ValidationInputError(f"{where}: {error}; allowed numbers") from None
    curves = {}
    for trial in scored_trials(folder):
        number = int(trial.facts["trial"])
        rows = table[table["trial"] == number].sort_values("time")
        curves[number] = _on_clock(rows, trial, f"{where}: trial {number}")
    return score_curves(folder, curves)


def scored_trials(folder: str | Path) -> list[DataTrial]:
    """Test trials of the open split without a planted fault."""
    index = read_index(folder)
    faults = check_truth(folder, Path(folder) / index["open_truth"], "open")["faults"]
    return [one for one in trials_of(folder, "open", "test") if str(one.facts["trial"]) not in faults]


def score_curves(folder: str | Path, curves: Mapping[int, Array]) -> Scores:
    """Score arrays (n, 3) in the order of `SCORED` at the sample times of each test trial."""
    window_s = float(read_index(folder)["window_s"])
    trials = scored_trials(folder)
    spans = {name: max(float(np.ptp(one.values[name])) for one in trials) for name in SCORED}
    relative = {}
    for one in trials:
        number, use = int(one.facts["trial"]), one.time_s >= window_s
        relative[number] = [
            100.0 * float(np.sqrt(np.mean((curves[number][use, k] - one.values[name][use]) ** 2))) / spans[name]
            for k, name in enumerate(SCORED)
        ]
    table = np.array(list(relative.values()))
    by_channel = dict(zip(SCORED, table.mean(axis=0).tolist(), strict=True))
    return Scores(by_channel, float(table.mean()), {number: float(np.mean(row)) for number, row in relative.items()})


def _on_clock(rows: pd.DataFrame, trial: DataTrial, where: str) -> Array:
    """Predictions (n, 3) at the sample times of the trial."""
    times = rows["time"].to_numpy(dtype=float)
    if not times.size:
        raise ValidationInputError(f"{where}: missing; every test trial must be predicted")
    values = rows[list(SCORED)].to_numpy(dtype=float)
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        row = int(np.argmin(np.isfinite(np.column_stack([times, values])).all(axis=1))) + 1
        raise ValidationInputError(f"{where}: row {row} of it holds a value that is not finite")
    edge = 1.5 / LEAST_RATE_HZ
    if times[0] > trial.time_s[0] + edge or times[-1] < trial.time_s[-1] - edge:
        raise ValidationInputError(
            f"{where}: times {times[0]:g} to {times[-1]:g} s, allowed are {trial.time_s[0]:g} to {trial.time_s[-1]:g} s"
        )
    if np.diff(times).max(initial=0.0) > 1.0 / LEAST_RATE_HZ:
        raise ValidationInputError(f"{where}: samples up to {np.diff(times).max():g} s apart, allowed 1 ms")
    return np.column_stack([np.interp(trial.time_s, times, values[:, k]) for k in range(len(SCORED))])
