"""Every score of every channel beside its ceiling, the null model and the raw force.

Conventions: scores of several trials are pooled without those whose encoder is wired wrong. The *ceiling* is what a
perfect model would score that knows each trial's force as well as it was measured (`validation.scores.perfect_model`).
What cannot be stated is NaN.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from validation.conventions import CHANNEL_GROUPS
from validation.findings.pooling import LeftOut, pooled
from validation.scores.curve_scores import SCORES, pooled_score
from validation.scores.perfect_model import Ceiling
from validation.scores.traces import SessionTraces

NO_CEILING = Ceiling()


def scorecard(
    scores: pd.DataFrame, traces: SessionTraces, ceiling: Ceiling = NO_CEILING, without: LeftOut = ()
) -> pd.DataFrame:
    """Every score of every channel beside its ceiling, the null model, and the raw force.

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
