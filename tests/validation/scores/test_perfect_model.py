"""The ceiling: a perfect model lies inside its range, a wrong one outside, and nothing is clipped."""

from __future__ import annotations

import numpy as np
import pytest

from validation.scores.perfect_model import INSIDE, NOT_MADE, OUTSIDE, Ceiling


def test_a_score_is_read_against_the_worst_perfect_model_and_never_clipped() -> None:
    drawn = np.linspace(0.010, 0.028, 19)
    ceiling = Ceiling({("key", "rmse_rad"): drawn, ("key", "iso_overall"): 1 - drawn}, (1, 2))
    row = ceiling.row("key", "rmse_rad", 0.002)  # better than every draw: stays as it is
    assert row["reading"] == INSIDE
    assert (row["ceiling"], row["ceiling_low"], row["ceiling_high"]) == pytest.approx((0.019, 0.010, 0.028))
    assert ceiling.row("key", "rmse_rad", 0.0281)["reading"] == OUTSIDE
    assert ceiling.row("key", "iso_overall", 0.9719)["reading"] == OUTSIDE
    assert ceiling.row("key", "iso_overall", 0.9999)["reading"] == INSIDE
    assert ceiling.row("hammer", "rmse_rad", 0.01) | {} == {
        "ceiling": pytest.approx(np.nan, nan_ok=True),
        "ceiling_low": pytest.approx(np.nan, nan_ok=True),
        "ceiling_high": pytest.approx(np.nan, nan_ok=True),
        "ceiling_draws": 0,
        "reading": NOT_MADE,
    }


def test_ceiling_of_a_session_is_scored_at_the_samples_of_the_trials(compared) -> None:
    card = compared.scorecard[compared.scorecard["channel"].isin(["key", "whippen", "hammer"])]
    assert (card["ceiling_draws"] == 19).all()
    assert (card["ceiling_low"] <= card["ceiling"]).all() and (card["ceiling"] <= card["ceiling_high"]).all()
    errors = card[card["score"] == "rmse_rad"].set_index("channel")
    for channel in ("key", "hammer"):
        # errors of gain, level and delay within their u, far below what a wrong friction makes
        assert 0 < errors.loc[channel, "ceiling"] < 0.1 * errors.loc[channel, "null"]
    assert compared.nuisance.empty  # only a comparison of models needs it
