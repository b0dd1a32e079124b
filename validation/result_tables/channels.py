"""Summary of every channel: repeatability, simultaneous band, paired difference between model and trials.

Conventions: SI and rad; differences are model − trial, paired by trial; samples left out of the scores are NaN. What
cannot be stated is NaN, and the column ``state`` says why. Two kinds of stroke have no mean and no band; their
repeatability is that within each kind.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pandas as pd

from validation.conventions import CHANNEL_GROUPS, Array, rms
from validation.findings.finding import LeftOut, describe_left_out, select_counted
from validation.prediction.joint_draws import CHANNELS
from validation.scores.curve_scores import SCORES, pair_rmse, pooled_score
from validation.scores.perfect_model import Ceiling
from validation.scores.traces import SessionTraces
from validation.statistics.bands import FEWEST_FOR_BAND, repeatability_band
from validation.statistics.repeatability import curve_repeatability, on_common_base
from validation.verdict.estimate import quantile_by_rank
from validation.verdict.verdict import Verdict, curve_errors, right_rmse, undecided_verdict

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
    "mean_difference_rad",
    "u_difference_rad",
    "resolved_share",
    "rmse_right_rad",
    "rmse_right_95_rad",
)
NOT_MADE = undecided_verdict("the uncertainties were not drawn")


SPREAD = ("mean", "s_r", "band95", "difference", "difference_u95")


def channel_tables(
    traces: SessionTraces,
    u_sample: Mapping[str, float],
    without: LeftOut = (),
    verdict: Verdict = NOT_MADE,
    kinds: Sequence[Collection[int]] = (),
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Channel summary without scores; mean, s_r, bands and paired difference over time, per channel.

    ``u_sample`` is the standard uncertainty of one sample by channel; ``without`` the trials and channels not
    pooled; ``verdict`` holds what the difference may be by chance; ``kinds`` the trials of each kind of
    stroke, where there are two.
    """
    base = traces.base_s
    rows: list[dict[str, object]] = []
    spread: dict[str, Array] = {"time_s": base}
    for names, source in CHANNEL_GROUPS:
        every = traces.of(source)
        for name in names:
            frames, state = select_counted(every, name, without), describe_left_out(every, name, without)
            if not frames:
                head = {"channel": name, "source": source, "n_trials": 0}
                rows.append({**head, **dict.fromkeys(COLUMNS, np.nan), "state": state or "not filmed"})
                if every:  # recorded, and wired wrong in all trials
                    spread |= {f"{name}_{part}_rad": np.full(base.shape, np.nan) for part in SPREAD}
                continue
            row, columns = _channel(name, base, frames, u_sample.get(name, 0.0), verdict, kinds)
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
    verdict: Verdict,
    kinds: Sequence[Collection[int]],
) -> tuple[dict[str, object], dict[str, Array]]:
    curves = on_common_base(base, frames, f"{name}_measured_rad")
    apart = on_common_base(base, frames, f"{name}_predicted_rad") - curves
    mean, u_mean, judged = _difference(base, apart, verdict, name)
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
        f"{name}_difference_u95_rad": COVERAGE * u_mean,
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


COVERAGE = 1.96


def _difference(base: Array, apart: Array, verdict: Verdict, name: str) -> tuple[Array, Array, dict[str, object]]:
    """Mean difference of a channel at times ``base`` (n,), its standard uncertainty, and figures of the channel table.

    ``apart``: model − trial, (n, trials).
    """
    known = np.isfinite(apart).any(axis=1)
    mean, u = np.full((2, base.size), np.nan)
    row: dict[str, object] = dict.fromkeys(COLUMNS[-5:], np.nan)
    if not known.any():
        return mean, u, row
    count = np.isfinite(apart).sum(axis=1)
    mean[known] = np.nanmean(apart[known], axis=1)
    row["mean_difference_rad"] = rms(mean[known])
    time, u_common = curve_errors(verdict, CHANNELS.index(name))
    drawn = np.isfinite(u_common)
    if not drawn.any():
        return mean, u, row
    several = known & (count > 1)
    scatter = np.zeros(base.size)
    scatter[several] = np.nanstd(apart[several], axis=1, ddof=1) / np.sqrt(count[several])
    u = np.where(known, np.hypot(np.interp(base, time[drawn], u_common[drawn]), scatter), np.nan)
    right = right_rmse(verdict, CHANNELS.index(name), base[[0, -1]])
    row |= {
        "u_difference_rad": rms(u),
        "resolved_share": float(np.mean(np.abs(mean[known]) > COVERAGE * u[known])),
        "rmse_right_rad": float(np.median(right)),
        "rmse_right_95_rad": quantile_by_rank(right, 0.95),
    }
    return mean, u, row


def _state(curves: Array) -> str:
    """Why a channel has no repeatability, or an empty text."""
    if not np.isfinite(curves).any():
        return "no frame tracked"
    n = curves.shape[1]
    if n == 1:
        return "one trial"
    return f"{n} trials: too few for a band, {FEWEST_FOR_BAND} needed" if n < FEWEST_FOR_BAND else ""


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
            frames = select_counted(every, name, without)
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
