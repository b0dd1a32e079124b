"""A report on trials that the model's values were fitted to says so."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

import model
from validation.pipeline.fitted_before import fitted_trials, identified_warnings, prediction_lines
from validation.prediction.posterior import make_posterior

NAME = "hammer.joint_friction.A"


@dataclass(frozen=True)
class Trial:
    """As much of a measured trial as is looked at."""

    number: int
    seal: str


def fitted_to(*seals: str) -> model.Action:
    """An action identified from trials with these hashes."""
    trials = {f"some, trial {i}": seal for i, seal in enumerate(seals)}
    made = make_posterior([(NAME, (NAME,), 0.3, True)], np.array([[0.1]]), trials)
    table = {"posterior": made.table(), "provenance": {"trials_sha256": trials}, "warnings": ["intervals are so"]}
    return replace(model.load_action(), identification=table)


TRIALS = [Trial(1, "a"), Trial(2, "b"), Trial(4, "c")]


@pytest.mark.parametrize(
    ("seals", "said"),
    [
        (("x", "y"), "A prediction: none of these trials is among the 2"),
        (("b", "x"), "Not a prediction: .* fitted to trial 2 "),
        (("c", "a"), "Not a prediction: .* fitted to trials 1, 4 "),
        (("a", "b", "c"), "Not a prediction: .* fitted to all of these trials "),
    ],
)
def test_the_hashes_decide(seals: tuple[str, ...], said: str) -> None:
    (line,) = prediction_lines(fitted_to(*seals), TRIALS)  # type: ignore[arg-type]
    assert re.match(said, line), line


def test_other_models_are_not_spoken_of() -> None:
    assert not prediction_lines(model.load_action(), TRIALS)  # type: ignore[arg-type]
    assert not identified_warnings(model.load_action()) and not fitted_trials(model.load_action(), TRIALS)  # type: ignore[arg-type]


def test_warnings_of_the_identification_go_along_and_values_set_by_hand_are_named() -> None:
    said = identified_warnings(fitted_to("a").with_values({NAME: 0.002}))
    assert "intervals are so" in said[0] and NAME in said[1] and "set by hand" in said[1]
