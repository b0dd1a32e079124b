"""The judged difference by channel and phase of the blow: the verdict's test, told apart by when and where.

Conventions: a phase begins with the mean time of an event in the trials and ends where the next one begins; a phase
whose event fewer than half of the trials show, or that would begin before the one in front of it, is left out and the
phase in front of it goes on. ``ratio`` is the largest |difference| in the unit of the one simultaneous test
(`validation.statistics.simultaneous_test`), so the largest of a channel's phases is the channel's ``largest_ratio``.
What was not judged is NaN, and ``state`` says why.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from validation.events.evaluation_window import Window
from validation.prediction.joint_draws import CHANNELS
from validation.statistics.paired_difference import NOT_JUDGED, NOT_SHOWN, SHOWN, Judgement

BEGINS = {"check": "string_impact", "hold": "check_time", "release": "key_release", "landing": "landing"}
PHASES = ("attack", *BEGINS)
COLUMNS = ["channel", "phase", "start_s", "end_s", "ratio", "ratio_limit", "difference_rad", "at_s", "outcome", "state"]
NO_SAMPLE = "no sample"


def phase_intervals(summary: pd.DataFrame, window: Window) -> dict[str, tuple[float, float]]:
    """Start and end of every phase of a session, s; NaN where a phase did not happen.

    Parameters
    ----------
    summary : DataFrame
        `validation.tables.events.event_summary`.
    window : Window
    """
    events = summary.set_index("event")
    starts = {"attack": window.start_s}
    last = window.start_s
    for phase, event in BEGINS.items():
        row = events.loc[event]
        begin = float(row["trial_mean"]) if 2 * row["found_trial"] >= max(row["n_trials"], 1) else float("nan")
        if last < begin < window.end_s:
            starts[phase] = last = begin
    ends = [*list(starts.values())[1:], window.end_s]
    found = dict(zip(starts, zip(starts.values(), ends, strict=True), strict=True))
    nothing = (float("nan"), float("nan"))
    return {phase: found.get(phase, nothing) for phase in PHASES}


def phase_table(judgement: Judgement, summary: pd.DataFrame, channels: pd.DataFrame, window: Window) -> pd.DataFrame:
    """One row per channel and phase.

    Parameters
    ----------
    judgement : Judgement
        The test of the session.
    summary : DataFrame
        `validation.tables.events.event_summary`.
    channels : DataFrame
        `validation.tables.channels.channel_tables`: which channels there are, and why one is no measurement.
    window : Window

    Returns
    -------
    DataFrame
        channel, phase, start_s, end_s, ratio, ratio_limit, difference_rad (model − trial where the ratio is largest),
        at_s, outcome, state (why there is no ratio).
    """
    intervals = phase_intervals(summary, window)
    states = dict(zip(channels["channel"], channels["state"].fillna(""), strict=True))
    unmeasured = {name for name, n in zip(channels["channel"], channels["n_trials"], strict=True) if n == 0}
    rows = []
    for channel in CHANNELS:
        for phase, (start, end) in intervals.items():
            row: dict[str, object] = {"channel": channel, "phase": phase, "start_s": start, "end_s": end}
            row |= _largest(judgement, channel, start, end, last=end >= window.end_s)
            if channel in unmeasured:
                row["state"] = states[channel]
            rows.append(row)
    return pd.DataFrame(rows, columns=COLUMNS)


def _largest(judgement: Judgement, channel: str, start: float, end: float, *, last: bool) -> dict[str, object]:
    nan = float("nan")
    row: dict[str, object] = dict.fromkeys(("ratio", "ratio_limit", "difference_rad", "at_s"), nan)
    row |= {"outcome": NOT_JUDGED, "state": ""}
    if judgement.draws is None or judgement.test is None:
        return row | {"state": judgement.why}
    if not np.isfinite(start):
        return row | {"state": "this phase did not happen"}
    time, test, i = judgement.draws.time_s, judgement.test, CHANNELS.index(channel)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(test.scale[:, i] > 0, np.abs(test.difference[:, i]) / test.scale[:, i], np.nan)
    inside = (time >= start) & ((time <= end) if last else (time < end)) & np.isfinite(ratio)
    if not inside.any():
        return row | {"state": NO_SAMPLE}
    at = int(np.argmax(np.where(inside, ratio, -np.inf)))
    return row | {
        "ratio": float(ratio[at]),
        "ratio_limit": test.factor,
        "difference_rad": float(test.difference[at, i]),
        "at_s": float(time[at]),
        "outcome": SHOWN if ratio[at] > test.factor else NOT_SHOWN,
    }
