"""What the headline says where a rival is nearer than the model: what the advice rests on, too."""

from __future__ import annotations

import numpy as np

from validation.pipeline import advice
from validation.statistics.skill import compute_skill, describe_nearer_rivals


def test_a_rival_that_wins_is_named_with_how_much_larger_the_model_s_error_is() -> None:
    model = np.radians([3.6, 3.4, 3.8, 3.5, 3.7])
    found = compute_skill(model, {"null": 0.5 * model * np.array([1.0, 1.1, 0.9, 1.0, 1.0]), "fir": 2.0 * model})
    assert found is not None and found.rival == "null"
    said = describe_nearer_rivals({"hammer": found})
    assert said.startswith("Nearer than the model: in hammer the null model (the model's error is 2 times as large; ")
    assert said.endswith(f"95 % interval {1 - found.high:.2g} to {1 - found.low:.2g}, 5 strokes).")
    assert 1 < 1 - found.high < 2 < 1 - found.low


def test_headline_and_advice_rest_on_one_interval() -> None:
    model = np.array([1.0, 1.1, 0.9, 1.0])
    sure = compute_skill(model, {"null": 0.8 * model * np.array([1.0, 1.01, 0.99, 1.0])})
    doubtful = compute_skill(model, {"null": model * np.array([0.4, 1.3, 0.5, 1.2])})
    assert sure is not None and doubtful is not None
    said = describe_nearer_rivals({"key": sure, "hammer": doubtful})
    assert "in key the null model" in said and "in hammer the null model" in said
    assert 1 - sure.high > 1 > 1 - doubtful.high  # the interval of the second holds 1
    assert len(advice.advise_on_rivals({"key": sure})) == 1 and advice.advise_on_rivals({"hammer": doubtful}) == []
