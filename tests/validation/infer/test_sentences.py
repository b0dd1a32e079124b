"""Lines of the page and the terminal: sentences, one line for one reason; whether a fit predicts and fits better."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from validation.infer import scores
from validation.infer.identify import MOST_ASKED, list_size_warnings
from validation.infer.scores import CEILING, NULL, EventScore, explain_rising_rmse
from validation.infer.sentences import plain_sentences


def test_scatter_of_trials_is_about_the_mean_of_each_session(monkeypatch) -> None:
    monkeypatch.setattr(scores, "ModelResponse", lambda *_: SimpleNamespace(curves=lambda _: [None]))
    monkeypatch.setattr(scores, "_run_null_model", lambda *_: None)
    rng, shape = np.random.default_rng(3), np.sin(np.linspace(0.0, 3.0, 400))

    def session(place: int, n: int, size: float) -> list[SimpleNamespace]:
        curves = size * np.outer(shape, [0.05, 0.08, 0.8]) + np.array([1e-4, 2e-4, 3e-4]) * rng.normal(size=(n, 400, 3))
        return [SimpleNamespace(session=place, change_rad=c, channels=(0, 1, 2)) for c in curves]

    trials = [*session(0, 4, 1.0), *session(1, 3, 0.6), *session(2, 1, 0.3)]  # one trial alone says nothing
    found = scores.score(trials, {"before": object()}, 1e-5)["scatter of trials"]  # type: ignore[arg-type,dict-item]
    assert list(found.values()) == pytest.approx([1e-4, 2e-4, 3e-4], rel=0.06)


@pytest.mark.parametrize(("after", "said"), [(4.9e-3, "no better"), (2e-3, "better"), (7e-3, "worse")])
def test_a_fit_that_predicts_no_better_says_so(after: float, said: str) -> None:
    speeds = {
        who: {"hammer_speed": EventScore(0.0, rms, 2, 3)} for who, rms in (("identified", 0.01), ("before", 0.02))
    }
    nothing = {"hammer_speed": EventScore(0.0, float("nan"), 0, 3)}
    problem = SimpleNamespace(trials=(1,), seen=(0,))
    found = SimpleNamespace(
        estimates=(SimpleNamespace(verdict="", name="a"),),
        undetermined=(),
        details=SimpleNamespace(
            problem=problem, fitted=SimpleNamespace(converged=True), explained=("Which part: none.",)
        ),
        scores={"double": {"before": {"hammer": 5e-3}, "identified": {"hammer": after}, "null model": None}},
        events={"double": {**speeds, NULL: nothing, CEILING: nothing}},
    )
    lines = plain_sentences(found)  # type: ignore[arg-type]
    assert lines[0].startswith("No value of 1 parameter is identified from 1 trial: ")
    assert f"{np.degrees(after):.2f}° with the identified values" in lines[1]
    assert (
        "0.010 m/s with the identified values (where it strikes: 2 of 3 trials), 0.020 m/s with those before"
        in lines[1]
    )
    assert f"The identified values predict the angle {said} than those before." in lines[1] and "null" not in lines[1]


def test_an_rmse_that_rises_is_said_with_what_it_is_beside_the_errors_found() -> None:
    before, found = {"key": 1e-3, "hammer": 2e-3, "whippen": 1e-3}, {"key": 1.5e-3, "hammer": 1e-3, "whippen": 2e-3}
    lines = explain_rising_rmse(before, found, {"key": 4e-4, "hammer": 1e-3, "whippen": 1.9e-3})
    assert len(lines) == 2  # of those that rise
    assert (
        lines[0].startswith("the key's RMSE rises from 0.057° to 0.086°") and "it is 0.023°: values and err" in lines[0]
    )
    assert "it is 0.11°: the fit weighs each phase" in lines[1] and lines[1].startswith("the whippen's")
    assert explain_rising_rmse(before, before, before) == []


def test_more_values_than_were_tried_at_once_are_warned_of() -> None:
    assert list_size_warnings([f"law{k}" for k in range(MOST_ASKED)]) == []
    (line,) = list_size_warnings([f"law{k}" for k in range(60)])
    assert "60 values at once" in line and "ask for fewer" in line
