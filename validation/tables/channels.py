"""Summary of every channel: repeatability, simultaneous band, paired difference between model and trials.

Conventions: SI and rad; differences are model − trial, paired by trial; samples left out of the scores are NaN. What
cannot be stated is NaN, and the column ``state`` says why.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import pandas as pd

from validation.conventions import CHANNEL_GROUPS, Array
from validation.findings.pooling import LeftOut, pooled, state_of
from validation.scores.metrics import pair_rmse
from validation.scores.traces import SessionTraces
from validation.statistics.common_base import on_common_base
from validation.statistics.paired_difference import paired_difference
from validation.statistics.repeatability import curve_repeatability
from validation.statistics.simultaneous_band import simultaneous_band

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
    "resolved_share",
    "resolved_pointwise_share",
)


def channel_tables(
    traces: SessionTraces,
    u_sample: Mapping[str, float],
    without: LeftOut = (),
    u_scale: Mapping[str, float] = MappingProxyType({}),
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Channel summary without scores; mean, s_r, bands and paired difference over time, per channel.

    ``u_sample`` is the standard uncertainty of one sample by channel; ``without`` the trials and channels not
    pooled; ``u_scale`` the relative standard uncertainty of each scale.
    """
    base = traces.base_s
    rows: list[dict[str, object]] = []
    spread: dict[str, Array] = {"time_s": base}
    for names, source in CHANNEL_GROUPS:
        every = traces.of(source)
        for name in names:
            frames, state = pooled(every, name, without), state_of(every, name, without)
            if not frames:
                nothing = dict.fromkeys(COLUMNS, np.nan)
                state = state or "not filmed"
                rows.append({"channel": name, "source": source, "n_trials": 0, **nothing, "state": state})
                continue
            row, columns = _channel(name, source, base, frames, u_sample.get(name, 0.0), u_scale.get(name, 0.0))
            row["state"] = "; ".join(text for text in (str(row["state"]), state) if text)
            rows.append(row)
            spread |= columns
    return pd.DataFrame(rows), pd.DataFrame(spread)


def _channel(
    name: str, source: str, base: Array, frames: dict[int, pd.DataFrame], u: float, u_scale: float
) -> tuple[dict[str, object], dict[str, Array]]:
    curves = on_common_base(base, frames, f"{name}_measured_rad")
    paired = paired_difference(on_common_base(base, frames, f"{name}_predicted_rad"), curves, u, u_scale)
    r = curve_repeatability(curves)
    band = simultaneous_band(curves, u_sample=u)
    low, high = r.interval
    ceiling, pairs = pair_rmse(curves)
    extent = [float(np.ptp(c[np.isfinite(c)])) if np.isfinite(c).any() else np.nan for c in curves.T]
    spread = {
        f"{name}_mean_rad": r.mean,
        f"{name}_s_r_rad": r.s_r,
        f"{name}_band95_rad": band.half_width,
        f"{name}_difference_rad": paired.mean,
        f"{name}_difference_u95_rad": paired.u95,
        f"{name}_difference_band95_rad": paired.band95,
    }
    row: dict[str, object] = {
        "channel": name,
        "source": source,
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
        "mean_difference_rad": paired.rms,
        "resolved_share": paired.resolved_share,
        "resolved_pointwise_share": paired.pointwise_share,
        "state": _state(curves),
    }
    return row, spread


def _state(curves: Array) -> str:
    """Why a channel has no repeatability, or an empty text."""
    if not np.isfinite(curves).any():
        return "no frame tracked"
    return "one trial" if curves.shape[1] == 1 else ""
