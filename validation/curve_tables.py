"""Tables of curves: traces of each trial, channel summary with repeatability, scores.

Place in the data flow: measurements and predictions → here → `validation.comparison`.
Conventions: SI and rad; differences are model − trial, paired by trial; nothing is aligned.
Failure: what cannot be stated is NaN, and the column ``state`` or ``reason`` says why.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from validation.geometry import Array
from validation.measurement import ENCODER_CHANNELS, FILM_CHANNELS, Measurement
from validation.metrics import pair_rmse, score_curve
from validation.paired import paired_difference
from validation.prediction import BODIES, Prediction
from validation.repeatability import curve_repeatability, s_interval_factors
from validation.window import Window

if TYPE_CHECKING:
    from validation.iso18571 import IsoScore

CURVE_COLUMNS = (
    "range_rad",
    "s_r_rad",
    "s_r_low_rad",
    "s_r_high_rad",
    "s_r_largest_rad",
    "limit_rad",
    "trial_to_trial_rmse_rad",
    "pairs",
    "iso_ceiling",
    "mean_difference_rad",
    "resolved_share",
)
CEILING_PAIRS = 10


def trace_table(m: Measurement, p: Prediction) -> pd.DataFrame:
    """Force, encoder angles and predicted angles of one trial on the DAQ's sample times."""
    columns = {
        "time_s": m.time_s,
        "raw_force_n": m.raw_force_n,
        "force_time_s": m.force.time_s,
        "force_n": m.force.force_n,
        "u_force_n": m.force.u_force_n,
    }
    columns |= {f"{name}_measured_rad": m.change_rad[:, i] for i, name in enumerate(ENCODER_CHANNELS)}
    columns |= {f"{body}_predicted_rad": p.change_rad(body) for body in BODIES}
    return pd.DataFrame(columns)


def film_trace_table(m: Measurement, p: Prediction) -> pd.DataFrame | None:
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
    return pd.DataFrame(columns)


def on_common_base(time_s: Array, frames: dict[int, pd.DataFrame], column: str) -> Array:
    """One column of several trials on one time base, (n_samples, n_trials); NaN outside a trial."""
    out = np.full((time_s.size, len(frames)), np.nan)
    for j, frame in enumerate(frames.values()):
        time, values = frame["time_s"].to_numpy(), frame[column].to_numpy()
        if time.size >= time_s.size:
            first = int(np.searchsorted(time, time_s[0] - 1e-9))
            if first + time_s.size <= time.size and np.allclose(
                time[first : first + time_s.size], time_s, atol=1e-9, rtol=0
            ):
                out[:, j] = values[first : first + time_s.size]
                continue
        out[:, j] = np.interp(time_s, time, values, left=np.nan, right=np.nan)
    return out


def channel_tables(
    traces: dict[int, pd.DataFrame],
    film: dict[int, pd.DataFrame],
    u_sample: dict[str, float],
    window: Window,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Channel summary without scores, and mean, s_r and paired difference over time, per channel.

    ``u_sample`` is the standard uncertainty of one sample by channel.
    """
    base = next(iter(traces.values()))["time_s"].to_numpy()
    base = base[window.mask(base)]
    rows: list[dict[str, object]] = []
    spread: dict[str, Array] = {"time_s": base}
    for names, frames, source in ((ENCODER_CHANNELS, traces, "encoder"), (FILM_CHANNELS, film, "film")):
        for name in names:
            if not frames:
                nothing = dict.fromkeys(CURVE_COLUMNS, np.nan)
                rows.append({"channel": name, "source": source, "n_trials": 0, **nothing, "state": "not filmed"})
                continue
            curves = on_common_base(base, frames, f"{name}_measured_rad")
            predicted = on_common_base(base, frames, f"{name}_predicted_rad")
            paired = paired_difference(predicted, curves, u_sample.get(name, 0.0))
            r = curve_repeatability(curves)
            low, high = s_interval_factors(r.n_trials)
            ceiling, pairs = pair_rmse(curves)
            extent = [float(np.ptp(c[np.isfinite(c)])) if np.isfinite(c).any() else np.nan for c in curves.T]
            spread[f"{name}_mean_rad"], spread[f"{name}_s_r_rad"] = r.mean, r.s_r
            spread[f"{name}_difference_rad"], spread[f"{name}_difference_u95_rad"] = paired.mean, paired.u95
            rows.append(
                {
                    "channel": name,
                    "source": source,
                    "n_trials": r.n_trials,
                    "range_rad": float(np.mean(extent)),
                    "s_r_rad": r.pooled,
                    "s_r_low_rad": r.pooled * low,
                    "s_r_high_rad": r.pooled * high,
                    "s_r_largest_rad": r.largest,
                    "limit_rad": r.limit,
                    "trial_to_trial_rmse_rad": ceiling,
                    "pairs": pairs,
                    "iso_ceiling": _iso_ceiling(base, curves),
                    "mean_difference_rad": paired.rms,
                    "resolved_share": paired.resolved_share,
                    "state": _state(curves),
                }
            )
    return pd.DataFrame(rows), pd.DataFrame(spread)


def _state(curves: Array) -> str:
    """Why a channel has no repeatability, or an empty text."""
    if not np.isfinite(curves).any():
        return "no frame tracked"
    return "one trial" if curves.shape[1] == 1 else ""


def score_table(
    traces: dict[int, pd.DataFrame],
    film: dict[int, pd.DataFrame],
    u_encoder: dict[int, Array],
    channels: pd.DataFrame,
    window: Window,
    impact_s: dict[int, float],
) -> pd.DataFrame:
    """Scores of every trial and channel inside the window."""
    s_r = dict(zip(channels["channel"], channels.get("s_r_rad", pd.Series(np.nan, channels.index)), strict=True))
    rows = []
    for names, frames, source in ((ENCODER_CHANNELS, traces, "encoder"), (FILM_CHANNELS, film, "film")):
        for number, whole in frames.items():
            frame = whole[window.mask(whole["time_s"].to_numpy())]
            time = frame["time_s"].to_numpy()
            early = time < impact_s.get(number, np.inf)
            for i, name in enumerate(names):
                trial, model = (
                    frame[f"{name}_measured_rad"].to_numpy(),
                    frame[f"{name}_predicted_rad"].to_numpy(),
                )
                score = score_curve(time, trial, model, s_r[name])
                iso = _iso(time, trial, model)
                before = score_curve(time[early], trial[early], model[early])
                if source == "encoder":
                    u = float(u_encoder[number][i])
                else:
                    stated = frame[f"{name}_u_rad"].to_numpy()
                    stated = stated[np.isfinite(stated)]
                    u = float(np.sqrt(np.mean(stated**2))) if stated.size else float("nan")
                rows.append(
                    {
                        "trial": number,
                        "channel": name,
                        "source": source,
                        "rmse_rad": score.rmse,
                        "before_impact_rmse_rad": before.rmse,
                        "rmse_over_range": score.rmse_over_range,
                        "rmse_over_s_r": score.rmse_over_s_r,
                        "iso_overall": iso.overall if iso else np.nan,
                        "iso_corridor": iso.corridor if iso else np.nan,
                        "iso_phase": iso.phase if iso else np.nan,
                        "iso_magnitude": iso.magnitude if iso else np.nan,
                        "iso_slope": iso.slope if iso else np.nan,
                        "iso_shift_s": iso.shift_samples * (time[1] - time[0]) if iso else np.nan,
                        "bias_rad": score.bias,
                        "scatter_rad": score.scatter,
                        "largest_rad": score.largest,
                        "largest_at_s": score.largest_at_s,
                        "u_rms_rad": u,
                        "n": score.n,
                        "n_lost": score.n_lost,
                    }
                )
    return pd.DataFrame(rows)


def _iso(time: Array, trial: Array, model: Array) -> IsoScore | None:
    """ISO 18571-style score, or None where a sample is lost or there are too few."""
    from validation.iso18571 import FEWEST_SAMPLES, iso_score

    if time.size < FEWEST_SAMPLES or not (np.isfinite(trial).all() and np.isfinite(model).all()):
        return None
    return iso_score(trial, model, float(np.mean(np.diff(time))))


def _iso_ceiling(base: Array, curves: Array) -> float:
    """Mean overall score of one trial against another, over the first ten pairs."""
    pairs = list(combinations(range(curves.shape[1]), 2))[:CEILING_PAIRS]
    scores = [_iso(base, curves[:, i], curves[:, j]) for i, j in pairs]
    known = [score.overall for score in scores if score is not None]
    return float(np.mean(known)) if known else float("nan")


def with_scores(channels: pd.DataFrame, scores: pd.DataFrame) -> pd.DataFrame:
    """Channel summary with the root mean square of its trials' RMSE."""
    rms = scores.groupby("channel")["rmse_rad"].agg(lambda v: float(np.sqrt(np.mean(np.square(v)))))
    out = channels.copy()
    out["rmse_rad"] = out["channel"].map(rms)
    out["iso_overall"] = out["channel"].map(scores.groupby("channel")["iso_overall"].mean())
    out["rmse_over_range"] = out["rmse_rad"] / out["range_rad"]
    out["rmse_over_s_r"] = out["rmse_rad"] / out["s_r_rad"].where(out["s_r_rad"] > 0)
    first = [
        "channel",
        "source",
        "n_trials",
        "rmse_rad",
        "range_rad",
        "rmse_over_range",
        "s_r_rad",
        "rmse_over_s_r",
    ]
    return out[first + [c for c in out.columns if c not in first]]
