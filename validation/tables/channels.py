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
from validation.findings.pooling import LeftOut, pooled, state_of
from validation.scores.metrics import pair_rmse
from validation.scores.traces import SessionTraces
from validation.statistics.common_base import on_common_base
from validation.statistics.paired_difference import COLUMNS as JUDGED
from validation.statistics.paired_difference import NOT_JUDGED, Judgement
from validation.statistics.repeatability import curve_repeatability
from validation.statistics.simultaneous_band import FEWEST_FOR_BAND, simultaneous_band

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
                nothing = dict.fromkeys(COLUMNS, np.nan) | {"judgement": NOT_JUDGED}
                state = state or "not filmed"
                rows.append(
                    {
                        "channel": name,
                        "source": source,
                        "n_trials": 0,
                        **nothing,
                        "judgement": NOT_JUDGED,
                        "state": state,
                    }
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
    difference = judgement.channel(name, base)
    if not np.isfinite(difference.mean).any():  # shown, not judged
        apart = on_common_base(base, frames, f"{name}_predicted_rad") - curves
        known = np.isfinite(apart).any(axis=1)
        difference.mean[known] = np.nanmean(apart[known], axis=1)
        if known.any():
            difference.row["mean_difference_rad"] = float(np.sqrt(np.mean(difference.mean[known] ** 2)))
    label = [next((k for k, part in enumerate(kinds) if number in part), -1) for number in frames]
    mixed = len(set(label)) > 1
    r = curve_repeatability(curves, label)
    # curves of two kinds have no mean that a band could hold
    band = simultaneous_band(np.full_like(curves, np.nan) if mixed else curves, u_sample=u)
    low, high = r.interval
    ceiling, pairs = pair_rmse(curves, kinds=label)
    extent = [float(np.ptp(c[np.isfinite(c)])) if np.isfinite(c).any() else np.nan for c in curves.T]
    spread = {
        f"{name}_mean_rad": r.mean,
        f"{name}_s_r_rad": r.s_r,
        f"{name}_band95_rad": band.half_width,
        f"{name}_difference_rad": difference.mean,
        f"{name}_difference_u95_rad": 1.96 * difference.u,
        f"{name}_difference_band95_rad": difference.band,
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
        **difference.row,
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
