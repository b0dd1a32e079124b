"""Summary of every channel: repeatability, simultaneous band, paired difference between model and trials.

Conventions: SI and rad; differences are model − trial, paired by trial; samples left out of the scores are NaN. What
cannot be stated is NaN, and the column ``state`` says why. Two kinds of stroke have no mean and no band; their
repeatability is that within each kind.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pandas as pd

from validation.conventions import CHANNEL_GROUPS, Array
from validation.events.session_events import Window
from validation.findings.finding import LeftOut, pooled, state_of
from validation.prediction.joint_draws import CHANNELS
from validation.scores.curve_scores import SCORES, pair_rmse, pooled_score
from validation.scores.perfect_model import Ceiling
from validation.scores.traces import SessionTraces
from validation.statistics.bands import FEWEST_FOR_BAND, repeatability_band
from validation.statistics.paired_difference import COLUMNS as JUDGED
from validation.statistics.paired_difference import NOT_JUDGED, NOT_SHOWN, SHOWN, Judgement
from validation.statistics.repeatability import curve_repeatability, on_common_base

COLUMNS = (
    "range_rad",
    "s_r_rad",
    "s_r_low_rad",
    "s_r_high_rad",
    "s_r_largest_rad",
    "limit_rad",
    "band_factor",
    "trial_to_trial_rmse_rad",
    "pairs",
    *JUDGED,
)
NOT_MADE = Judgement()


SPREAD = ("mean", "s_r", "band95", "difference", "difference_u95", "difference_band95")


def channel_tables(
    traces: SessionTraces,
    u_sample: Mapping[str, float],
    without: LeftOut = (),
    judgement: Judgement = NOT_MADE,
    kinds: Sequence[Collection[int]] = (),
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Channel summary without scores; mean, s_r, bands and paired difference over time, per channel.

    ``u_sample`` is the standard uncertainty of one sample by channel; ``without`` the trials and channels not
    pooled; ``judgement`` the test of the difference; ``kinds`` the trials of each kind of stroke, where there are two.
    """
    base = traces.base_s
    rows: list[dict[str, object]] = []
    spread: dict[str, Array] = {"time_s": base}
    for names, source in CHANNEL_GROUPS:
        every = traces.of(source)
        for name in names:
            frames, state = pooled(every, name, without), state_of(every, name, without)
            if not frames:
                head = {"channel": name, "source": source, "n_trials": 0}
                rows.append(
                    {**head, **dict.fromkeys(COLUMNS, np.nan), "judgement": NOT_JUDGED, "state": state or "not filmed"}
                )
                if every:  # recorded, and wired wrong in all trials
                    spread |= {f"{name}_{part}_rad": np.full(base.shape, np.nan) for part in SPREAD}
                continue
            row, columns = _channel(name, base, frames, u_sample.get(name, 0.0), judgement, kinds)
            row["source"] = source
            row["state"] = "; ".join(text for text in (str(row["state"]), state) if text)
            rows.append(row)
            spread |= columns
    return pd.DataFrame(rows), pd.DataFrame(spread)


def _channel(
    name: str,
    base: Array,
    frames: dict[int, pd.DataFrame],
    u: float,
    judgement: Judgement,
    kinds: Sequence[Collection[int]],
) -> tuple[dict[str, object], dict[str, Array]]:
    curves = on_common_base(base, frames, f"{name}_measured_rad")
    mean, u_mean, reach, judged = judgement.channel(name, base)
    if not np.isfinite(mean).any():  # shown, not judged
        apart = on_common_base(base, frames, f"{name}_predicted_rad") - curves
        known = np.isfinite(apart).any(axis=1)
        mean[known] = np.nanmean(apart[known], axis=1)
        if known.any():
            judged["mean_difference_rad"] = float(np.sqrt(np.mean(mean[known] ** 2)))
    label = [next((k for k, part in enumerate(kinds) if number in part), -1) for number in frames]
    mixed = len(set(label)) > 1
    r = curve_repeatability(curves, label)
    # curves of two kinds have no mean that a band could hold
    band = repeatability_band(np.full_like(curves, np.nan) if mixed else curves, u_sample=u)
    low, high = r.interval
    ceiling, pairs = pair_rmse(curves, kinds=label)
    extent = [float(np.ptp(c[np.isfinite(c)])) if np.isfinite(c).any() else np.nan for c in curves.T]
    spread = {
        f"{name}_mean_rad": r.mean,
        f"{name}_s_r_rad": r.s_r,
        f"{name}_band95_rad": band.half_width,
        f"{name}_difference_rad": mean,
        f"{name}_difference_u95_rad": 1.96 * u_mean,
        f"{name}_difference_band95_rad": reach,
    }
    row: dict[str, object] = {
        "channel": name,
        "source": "",
        "n_trials": r.n_trials,
        "range_rad": float(np.mean(extent)),
        "s_r_rad": r.pooled,
        "s_r_low_rad": low,
        "s_r_high_rad": high,
        "s_r_largest_rad": r.largest,
        "limit_rad": r.limit,
        "band_factor": band.factor,
        "trial_to_trial_rmse_rad": ceiling,
        "pairs": pairs,
        **judged,
        "state": "two kinds of stroke: compared within each, no band" if mixed else _state(curves),
    }
    return row, spread


def _state(curves: Array) -> str:
    """Why a channel has no repeatability, or an empty text."""
    if not np.isfinite(curves).any():
        return "no frame tracked"
    n = curves.shape[1]
    if n == 1:
        return "one trial"
    return f"{n} trials: too few for a band, {FEWEST_FOR_BAND} needed" if n < FEWEST_FOR_BAND else ""


BEGINS = {"check": "string_impact", "hold": "check_time", "release": "key_release", "landing": "landing"}
PHASES = ("attack", *BEGINS)
PHASE_COLUMNS = [
    "channel",
    "phase",
    "start_s",
    "end_s",
    "ratio",
    "ratio_limit",
    "difference_rad",
    "at_s",
    "outcome",
    "state",
]
NO_SAMPLE = "no sample"


def phase_intervals(summary: pd.DataFrame, window: Window) -> dict[str, tuple[float, float]]:
    """Start and end of every phase of a session, s; NaN where a phase did not happen.

    Parameters
    ----------
    summary : DataFrame
        `validation.result_tables.events.event_summary`.
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

    Conventions: a phase begins with the mean time of an event in the trials and ends where the next one begins; a phase
    whose event fewer than half of the trials show, or that would begin before the one in front of it, is left out and
    the phase in front of it goes on. ``ratio`` is the largest |difference| in the unit of the one simultaneous test
    (`validation.statistics.paired_difference`), so the largest of a channel's phases is the channel's
    ``largest_ratio``. What was not judged is NaN, and ``state`` says why.

    Parameters
    ----------
    judgement : Judgement
        The test of the session.
    summary : DataFrame
        `validation.result_tables.events.event_summary`.
    channels : DataFrame
        `validation.result_tables.channels.channel_tables`: which channels there are, and why one is no measurement.
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
    return pd.DataFrame(rows, columns=PHASE_COLUMNS)


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


NO_CEILING = Ceiling()


def scorecard(
    scores: pd.DataFrame, traces: SessionTraces, ceiling: Ceiling = NO_CEILING, without: LeftOut = ()
) -> pd.DataFrame:
    """Every score of every channel beside its ceiling, the null model, and the raw force.

    Conventions: scores of several trials are pooled without those whose encoder is wired wrong. The *ceiling* is what a
    perfect model would score that knows each trial's force as well as it was measured
    (`validation.scores.perfect_model`). What cannot be stated is NaN.

    Returns
    -------
    DataFrame
        channel, score, title, unit, better (lower or higher), value, ceiling (median over draws), ceiling_low,
        ceiling_high (their range), ceiling_draws, reading, null, raw_force.
    """
    rows = []
    for names, source in CHANNEL_GROUPS:
        every = traces.of(source)
        for name in names if every else ():
            frames = pooled(every, name, without)
            part = scores[(scores["channel"] == name) & scores["trial"].isin(frames)]
            same = part[part["trial"].isin(ceiling.trials)]
            for score, kind in SCORES.items():
                rows.append(
                    {
                        "channel": name,
                        "score": score,
                        "title": kind.title,
                        "unit": kind.unit,
                        "better": kind.better,
                        "value": pooled_score(score, part[score].to_numpy(dtype=float)),
                        **ceiling.row(name, score, pooled_score(score, same[score].to_numpy(dtype=float))),
                        "null": pooled_score(score, part[f"null_{score}"].to_numpy(dtype=float)),
                        "raw_force": pooled_score(score, part[f"raw_force_{score}"].to_numpy(dtype=float)),
                    }
                )
    return pd.DataFrame(rows)


def with_repeatability(scores: pd.DataFrame, channels: pd.DataFrame, without: LeftOut = ()) -> pd.DataFrame:
    """Scores of every curve with the RMSE over the channel's s_r, and whether figures of several trials count it.

    The column ``pooled`` is the one place where that is decided: every figure of several trials reads it.
    """
    s_r = dict(zip(channels["channel"], channels["s_r_rad"], strict=True))
    ratio = [
        rmse / s_r[name] if s_r[name] > 0 else float("nan")
        for name, rmse in zip(scores["channel"], scores["rmse_rad"], strict=True)
    ]
    out = scores.copy()
    place = out.columns.get_loc("source") + 1
    out.insert(place, "pooled", [pair not in without for pair in zip(out["trial"], out["channel"], strict=True)])
    out.insert(place + 1, "rmse_over_s_r", ratio)
    return out


def with_scores(
    channels: pd.DataFrame, scores: pd.DataFrame, card: pd.DataFrame, without: LeftOut = ()
) -> pd.DataFrame:
    """Channel summary with the root mean square of its trials' RMSE, the ISO-style score and its ceiling."""
    counts = [pair not in without for pair in zip(scores["trial"], scores["channel"], strict=True)]
    rms = scores[counts].groupby("channel")["rmse_rad"].agg(lambda v: float(np.sqrt(np.mean(np.square(v)))))
    overall = card[card["score"] == "iso_overall"].set_index("channel")
    rmse = card[card["score"] == "rmse_rad"].set_index("channel")
    out = channels.copy()
    out["rmse_rad"] = out["channel"].map(rms)
    out["null_rmse_rad"] = out["channel"].map(rmse["null"])
    out["iso_overall"] = out["channel"].map(overall["value"])
    out["iso_ceiling"] = out["channel"].map(overall["ceiling"])
    out["iso_null"] = out["channel"].map(overall["null"])
    out["rmse_over_range"] = out["rmse_rad"] / out["range_rad"]
    out["rmse_over_s_r"] = out["rmse_rad"] / out["s_r_rad"].where(out["s_r_rad"] > 0)
    first = ["channel", "source", "n_trials", "rmse_rad", "range_rad", "rmse_over_range", "s_r_rad", "rmse_over_s_r"]
    return out[first + [c for c in out.columns if c not in first]]
