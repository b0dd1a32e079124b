"""What the headline says where the null model is closer."""

from __future__ import annotations

import numpy as np
import pandas as pd

from validation.statistics.model_comparison import null_closer


def scores(model: dict[str, np.ndarray], null: dict[str, np.ndarray]) -> pd.DataFrame:
    rows = [
        {"trial": t, "channel": c, "rmse_rad": m, "null_rmse_rad": n}
        for c in model
        for t, (m, n) in enumerate(zip(model[c], null[c], strict=True), start=1)
    ]
    return pd.DataFrame(rows)


def test_a_null_model_that_wins_is_named_with_both_numbers() -> None:
    hammer, key = np.radians([3.6] * 5), np.radians([0.1] * 5)
    said = null_closer(scores({"key": key, "hammer": hammer}, {"key": 2 * key, "hammer": np.radians([2.9] * 5)}))
    assert said == (
        "The null model of one degree of freedom is closer in hammer (RMSE 2.9° against 3.6°, closer in 5 of 5 trials; "
        "5 trials do not show it)."
    )
    assert null_closer(scores({"key": key}, {"key": 2 * key})) == ""


def test_eight_trials_may_show_it() -> None:
    model = np.linspace(0.02, 0.03, 8)
    said = null_closer(scores({"hammer": model, "key": model}, {"hammer": 0.9 * model, "key": 1.1 * model}))
    assert "closer in 8 of 8 trials; shown at 5 %" in said and "key" not in said
    assert null_closer(scores({"hammer": model}, {"hammer": 0.9 * model}), {(t, "hammer") for t in range(1, 9)}) == ""
