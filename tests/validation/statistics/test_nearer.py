"""What the headline says where a rival is nearer than the model."""

from __future__ import annotations

import numpy as np
import pandas as pd

from validation.statistics.skill import RIVALS, describe_nearer_rivals


def errors(model: dict[str, np.ndarray], **rivals: dict[str, np.ndarray]) -> pd.DataFrame:
    rows = []
    for channel, own in model.items():
        for t, rmse in enumerate(own):
            row = {f"{name}_rmse_rad": rivals[name][channel][t] if name in rivals else np.nan for name in RIVALS}
            rows.append({"trial": t + 1, "channel": channel, "rmse_rad": rmse, **row})
    return pd.DataFrame(rows)


def test_a_rival_that_wins_is_named_with_both_numbers() -> None:
    hammer, key = np.radians([3.6] * 5), np.radians([0.1] * 5)
    null = {"key": 2 * key, "hammer": np.radians([2.9] * 5)}
    said = "Nearer than the model: in hammer the null model (RMSE 2.9° against 3.6°, in 5 of 5 trials; not shown "
    assert describe_nearer_rivals(errors({"key": key, "hammer": hammer}, null=null)) == said + "at 5 %)."
    both = describe_nearer_rivals(
        errors({"key": key, "hammer": hammer}, null=null, fir={"key": key * 3, "hammer": 0.5 * hammer})
    )
    assert "in hammer the FIR filter (RMSE 1.8°" in both and both.endswith("not shown at 5 %), also the null model.")
    assert describe_nearer_rivals(errors({"key": key}, null={"key": 2 * key})) == ""


def test_eight_trials_may_show_it() -> None:
    model = np.linspace(0.02, 0.03, 8)
    said = describe_nearer_rivals(
        errors({"hammer": model, "key": model}, null={"hammer": 0.9 * model, "key": 1.1 * model})
    )
    assert "in 8 of 8 trials; shown at 5 %" in said and "key" not in said
    none = describe_nearer_rivals(
        errors({"hammer": model}, null={"hammer": 0.9 * model}), {(t, "hammer") for t in range(1, 9)}
    )
    assert none == ""
