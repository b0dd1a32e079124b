"""A report on trials that the model's values were fitted to says so."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

import model
from validation.pipeline.verdict import fitted_trials, identified_warnings, prediction_lines
from validation.prediction.posterior import digests, list_alterations, make_posterior, posterior_of

NAME = "hammer.joint_friction.A"


@dataclass(frozen=True)
class Trial:
    """As much of a measured trial as is looked at."""

    number: int
    seal: str
    samples: tuple[str, ...] = ()


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
        (("b", "x"), "Not a prediction: .* fitted to trial 2 .by hash.; trials 1, 4 were kept aside"),
        (("c", "a"), "Not a prediction: .* fitted to trials 1, 4 .by hash.; trial 2 was kept aside"),
        (("a", "b", "c"), "Not a prediction: .* fitted to all of these trials "),
    ],
)
def test_the_hashes_decide(seals: tuple[str, ...], said: str) -> None:
    (line,) = prediction_lines(fitted_to(*seals), TRIALS)  # type: ignore[arg-type]
    assert re.match(said, line), line


def test_samples_decide_whatever_file_they_come_in() -> None:
    posterior = posterior_of(fitted_to("a"))
    assert posterior is not None
    known = replace(posterior, samples={"1": ["p", "q", "r"]})
    assert known.was_fitted_to("a", ()) and known.was_fitted_to("another file", ("q", "r", "s"))
    assert not known.was_fitted_to("another file", ("r", "s"))  # one word alone may be the same by chance


def test_other_models_are_not_spoken_of() -> None:
    assert not prediction_lines(model.load_action(), TRIALS)  # type: ignore[arg-type]
    assert not identified_warnings(model.load_action()) and not fitted_trials(model.load_action(), TRIALS)  # type: ignore[arg-type]


def test_warnings_of_the_identification_go_along_and_values_set_by_hand_are_named() -> None:
    said = identified_warnings(fitted_to("a").with_values({NAME: 0.002}))
    assert "intervals are so" in said[0] and NAME in said[1] and "set by hand" in said[1]


def written(**changes: object) -> model.Action:
    """An identified action as its file has it, then changed."""
    action = fitted_to("x")
    table = dict(action.identification)
    return replace(action, identification=table | digests(action, table["provenance"], table["posterior"]), **changes)  # type: ignore[arg-type]


def test_what_was_edited_since_makes_no_prediction() -> None:
    whole = written()
    assert not list_alterations(whole) and prediction_lines(whole, TRIALS)[0].startswith("A prediction")  # type: ignore[arg-type]
    value = whole.quantities[NAME]
    edited = written(quantities={**whole.quantities, NAME: replace(value, value=2 * value.value)})
    forgotten = replace(whole, identification={**whole.identification, "provenance": {"trials_sha256": {}}})
    for action, said in (
        (edited, "values in .* were edited after it was written"),
        (forgotten, "says of its trials or uncertainty was edited"),
        (whole.with_values({NAME: 0.002}), f"{NAME} set by hand since"),
    ):
        (line,) = prediction_lines(action, TRIALS)  # type: ignore[arg-type]
        assert re.match(f"Whether this is a prediction is not known: none .* but .*{said}", line), line
        assert re.search(said, identified_warnings(action)[-1])


def test_an_edited_list_of_trials_clears_no_other_trial() -> None:
    whole = written()
    table = {**whole.identification, "provenance": {"trials_sha256": {"some, trial 1": "b"}}}
    (line,) = prediction_lines(replace(whole, identification=table), TRIALS)  # type: ignore[arg-type]
    assert line.startswith("Not a prediction") and "were kept aside" not in line and "edited after" in line


def test_strokes_of_earlier_fits_are_remembered() -> None:
    action = fitted_to("x")
    provenance = {**action.identification["provenance"], "earlier_sha256": ["b"]}
    chained = replace(action, identification={**action.identification, "provenance": provenance})
    assert fitted_trials(chained, TRIALS) == [2]  # type: ignore[arg-type]
