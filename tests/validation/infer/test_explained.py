"""The page of `identify` says what the report of `validate` says of the same strokes, session by session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import model
from tests.validation.infer import toy
from validation.infer import result as explained
from validation.infer.causes.explain import Explained
from validation.infer.result import BY_MOTION, explained_lines
from validation.infer.sources import Sources

ACTION = model.load_action()
(MADE,) = toy.made(np.zeros(3), 1, np.random.default_rng(1))


@dataclass
class Asked:
    """What the two entrances of the engine were given."""

    measured: list[Sequence[Any]]
    observed: list[list[str]]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Asked:
    """The engine replaced by one that notes what it is asked."""
    seen = Asked([], [])

    def difference(tested: Any, trials: Sequence[Any]) -> Explained:
        assert tested.action is ACTION
        seen.measured.append(trials)
        return Explained("this change explains it")

    def observed(tested: Any, trials: Sequence[Any]) -> Explained:
        seen.observed.append([t.label for t in trials])
        return Explained()

    monkeypatch.setattr(explained, "explain_difference", difference)
    monkeypatch.setattr(explained, "explain_observed", observed)
    return seen


def trial(label: str, session: int, **changes: Any) -> Any:
    """A trial that a force drives."""
    return replace(MADE, label=label, session=session, **changes)


def test_each_session_is_asked_with_its_own_trials_and_tables_as_they_are(asked: Asked) -> None:
    late = MADE.time_s + 0.5 * float(np.median(np.diff(MADE.force_time_s)))
    fitted = (
        trial("table, trial 1", 0),
        trial("table, trial 2", 0, time_s=late),
        trial("table, trial 3", 0, time_s=MADE.time_s**1.1),  # other phases: not laid on the first
        trial("forte, trial 1", 1),
        trial("forte, trial 2", 1),
        trial("held by its key, trial 1", 2, key=object()),
        trial("piano, trial 4", 3),
    )
    lines = explained_lines(ACTION, Sources(fitted, {}, {}, {}, (), measured=("f1", "f2", "p4")))  # type: ignore[arg-type]
    assert asked.measured == [["f1", "f2"], ["p4"]] and asked.observed == [["table, trial 1", "table, trial 2"]]
    assert lines[0].startswith("Which part of the model explains the difference, table: nothing was looked for")
    assert lines[1] == "Which part of the model explains the difference, forte: this change explains it."
    assert [line.split(", ")[1].split(":")[0] for line in lines] == ["table", "forte", "piano"]


def test_strokes_driven_by_the_key_are_not_asked(asked: Asked) -> None:
    fitted = (trial("one, trial 1", 0, key=object()),)
    assert explained_lines(ACTION, Sources(fitted, {}, {}, {}, ())) == (BY_MOTION,)
    assert not asked.measured and not asked.observed
