"""Scores of every trial and channel, and the scorecard: every score beside its ceiling and beside the null model.

Place in the data flow: traces of all trials → here → `ValidationResult.scores` and ``.scorecard``.
Conventions: SI and rad; differences are model − trial, paired by trial; nothing is aligned; marked samples are left
out and counted.  The *ceiling* is the same score of trial against trial: no model can be asked for better.
Failure: what cannot be stated is NaN.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from validation.cache.result_cache import Kept
from validation.events.evaluation_window import Window
from validation.findings.pooling import LeftOut, pooled
from validation.measurement.geometry import Array
from validation.scores.curve_scores import SCORES, all_scores, ceiling_scores, together
from validation.scores.metrics import score_curve
from validation.tables.channels import GROUPS
from validation.tables.traces import INFIX, on_common_base, scored

WORKERS = 2  # the warping runs without the interpreter's lock


def score_table(
    traces: dict[int, pd.DataFrame],
    film: dict[int, pd.DataFrame],
    u_encoder: dict[int, Array],
    channels: pd.DataFrame,
    window: Window,
    impact_s: dict[int, float],
    kept: Kept,
) -> pd.DataFrame:
    """Scores of every trial and channel inside the window, with guards; null model and raw force beside."""
    s_r = dict(zip(channels["channel"], channels.get("s_r_rad", pd.Series(np.nan, channels.index)), strict=True))
    jobs = [
        (number, name, i, source, frame[window.mask(frame["time_s"].to_numpy())])
        for names, source in GROUPS
        for number, frame in (traces if source == "encoder" else film).items()
        for i, name in enumerate(names)
    ]

    def row(job: tuple[int, str, int, str, pd.DataFrame]) -> dict[str, object]:
        number, name, i, source, frame = job
        u = float(u_encoder[number][i]) if source == "encoder" else _rms(frame[f"{name}_u_rad"].to_numpy())
        early = frame["time_s"].to_numpy() < impact_s.get(number, np.inf)
        time, trial, model = frame["time_s"].to_numpy(), scored(frame, name), frame[f"{name}_predicted_rad"].to_numpy()
        columns = {label: f"{name}_{infix}_rad" for label, infix in INFIX.items()}
        rivals = {label: frame[column].to_numpy() for label, column in columns.items() if column in frame}
        scores = kept.of(
            "curve scores",
            (time, trial, model, rivals, early),
            lambda: _scores(time, trial, model, rivals, early),
        )
        return {
            "trial": number,
            "channel": name,
            "source": source,
            "rmse_over_s_r": scores["rmse_rad"] / s_r[name] if s_r[name] > 0 else float("nan"),
            **scores,
            "u_rms_rad": u,
        }

    with ThreadPoolExecutor(WORKERS) as pool:
        return pd.DataFrame(list(pool.map(row, jobs)))


def _scores(
    time: Array, trial: Array, model: Array, rivals: dict[str, Array], early: NDArray[np.bool_]
) -> dict[str, object]:
    from validation.scores.iso18571_guards import guard_notes

    whole = score_curve(time, trial, model)
    scores = all_scores(time, trial, model, early)
    out: dict[str, object] = dict(scores)
    out |= {
        "bias_rad": whole.bias,
        "scatter_rad": whole.scatter,
        "largest_rad": whole.largest,
        "largest_at_s": whole.largest_at_s,
        "n": whole.n,
        "n_lost": whole.n_lost,
        "iso_guards": "; ".join(guard_notes(time, trial, model, scores)),
    }
    for label in INFIX:
        rival = all_scores(time, trial, rivals[label], early) if label in rivals else {}
        out |= {f"{label}_{score}": rival.get(score, np.nan) for score in SCORES}
    return out


def scorecard(
    scores: pd.DataFrame,
    traces: dict[int, pd.DataFrame],
    film: dict[int, pd.DataFrame],
    window: Window,
    impact_s: dict[int, float],
    kept: Kept,
    without: LeftOut = (),
) -> pd.DataFrame:
    """Every score of every channel beside its repeatability ceiling, the null model, and the raw force.

    Returns
    -------
    DataFrame
        channel, score, title, unit, better (lower or higher), value, ceiling, pairs, null, raw_force.
    """
    base = next(iter(traces.values()))["time_s"].to_numpy()
    base = base[window.mask(base)]
    early = base < min(impact_s.values(), default=np.inf)
    rows = []
    with ThreadPoolExecutor(WORKERS) as pool:
        for names, source in GROUPS:
            every = traces if source == "encoder" else film
            for name in names if every else ():
                frames = pooled(every, name, without)
                ceiling, pairs = ceiling_scores(
                    base, on_common_base(base, frames, f"{name}_measured_rad"), early, kept, run=pool.map
                )
                part = scores[(scores["channel"] == name) & scores["trial"].isin(frames)]
                for score, kind in SCORES.items():
                    rows.append(
                        {
                            "channel": name,
                            "score": score,
                            "title": kind.title,
                            "unit": kind.unit,
                            "better": kind.better,
                            "value": together(score, part[score].to_numpy(dtype=float)),
                            "ceiling": ceiling[score],
                            "pairs": pairs,
                            "null": together(score, part[f"null_{score}"].to_numpy(dtype=float)),
                            "raw_force": together(score, part[f"raw_force_{score}"].to_numpy(dtype=float)),
                        }
                    )
    return pd.DataFrame(rows)


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


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
