"""Where the null model is closer than the model under test, by trial, and whether so few trials can show it.

Conventions: RMSE in rad, paired by trial; a channel is named where the null model's pooled RMSE is the smaller one. A
claim at 5 % needs the sign flips of all channels together (`model_comparison.joint_sign_flip`), which six trials allow.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pandas as pd

from validation.statistics.model_comparison import LEVEL, joint_sign_flip


def null_closer(scores: pd.DataFrame, without: Collection[tuple[int, str]] = ()) -> str:
    """What the headline says of the null model; empty where the model is closer in every channel."""
    counts = [pair not in without for pair in zip(scores["trial"], scores["channel"], strict=True)]
    known = scores[counts].dropna(subset=["rmse_rad", "null_rmse_rad"])
    wide = known.pivot_table(index="trial", columns="channel", values=["rmse_rad", "null_rmse_rad"]).dropna()
    if not len(wide):
        wide = known.pivot_table(index="trial", columns="channel", values=["rmse_rad", "null_rmse_rad"])
    difference = wide["null_rmse_rad"] - wide["rmse_rad"] if len(wide) else pd.DataFrame()
    p = joint_sign_flip(difference.to_numpy(dtype=float)) if len(wide) and difference.notna().all(axis=None) else None
    parts = []
    for channel, part in known.groupby("channel", sort=False):
        model, null = (float(np.degrees(np.sqrt(np.mean(part[c] ** 2)))) for c in ("rmse_rad", "null_rmse_rad"))
        if null >= model:
            continue
        closer, n = int((part["null_rmse_rad"] < part["rmse_rad"]).sum()), len(part)
        said = f"{channel} (RMSE {null:.2g}° against {model:.2g}°, closer in {closer} of {n} trials"
        shown = p is not None and p[list(difference.columns).index(channel)] <= LEVEL
        parts.append(said + ("; shown at 5 %)" if shown else f"; {n} trial{'s do' if n > 1 else ' does'} not show it)"))
    return f"The null model of one degree of freedom is closer in {', '.join(parts)}." if parts else ""
