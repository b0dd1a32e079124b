"""A trial judged by itself agrees with the comparison of the whole session, as far as both say the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import rig
import validation
from validation.errors import ValidationError

EXAMPLE = Path(__file__).parents[3] / "sessions" / "example_forte"


@pytest.fixture(scope="module")
def judged() -> list[validation.TrialJudgement]:
    judge, session = validation.TrialJudge("hirschkorn2004"), rig.open_session(EXAMPLE)
    return [judge.judge(session, trial.number) for trial in session]


def test_the_last_trial_has_the_errors_and_repeatability_of_the_comparison(judged) -> None:
    whole = validation.compare(
        EXAMPLE, "hirschkorn2004", budget=False, explain=False, keep_predictions=False, rivals=()
    )
    scores = whole.scores[whole.scores["source"] == "encoder"].set_index(["trial", "channel"])
    channels = whole.channels.set_index("channel")
    last = judged[-1]
    assert [one.n_trials for one in judged] == [1, 2, 3] and set(last.rmse_rad) == {"key", "whippen", "hammer"}
    for name, rmse in last.rmse_rad.items():
        assert rmse == pytest.approx(scores.loc[(3, name), "rmse_rad"], rel=1e-9)
        assert last.repeatability_rad[name] == pytest.approx(channels.loc[name, "s_r_rad"], rel=1e-9)
    assert all(np.isnan(s) for s in judged[0].repeatability_rad.values())
    assert not any(one.differing or one.findings for one in judged)


def test_its_differences_are_those_of_its_own_curve(judged) -> None:
    speed = next(d for d in judged[1].differences if d.quantity.name == "hammer_speed")
    assert abs(speed.value) < 0.1 and 0 < speed.scatter < 0.1 and speed.n_trials == 2
    curve = judged[1].curves["hammer"]
    apart = curve["predicted_rad"] - curve["measured_rad"]
    assert len(apart) <= 300 and np.sqrt(np.mean(apart**2)) == pytest.approx(judged[1].rmse_rad["hammer"], rel=0.1)


def test_what_differs_is_said_and_written_as_plain_values(judged) -> None:
    changed = validation.TrialJudge("hirschkorn2004")
    changed = validation.TrialJudge(changed.tested.action.with_values({"contact04.second.x": -0.2182}))
    found = changed.judge(EXAMPLE, 1)
    assert any(text.startswith("check height") for text in found.differing)
    assert found.lines()[1].startswith("  differs")
    plain = json.loads(json.dumps(found.content(), allow_nan=False))
    assert plain["trial"] == 1 and plain["differing"] == list(found.differing)
    assert plain["repeatability_rad"]["hammer"] is None and plain["differences"]["check_height"]["unit"] == "m"
    turned = plain["curves"]["key"]["measured_deg"]
    assert len(turned) == len(plain["curves"]["key"]["time_s"])
    deepest = float(np.degrees(np.abs(found.curves["key"]["measured_rad"]).max()))
    assert max(turned) == pytest.approx(deepest, rel=1e-6), "downwards is positive, as in the thesis"


def test_a_trial_that_cannot_be_used_is_refused_and_the_others_go_on() -> None:
    judge = validation.TrialJudge("hirschkorn2004")
    with pytest.raises((ValidationError, rig.InputError), match="no trial 9"):
        judge.judge(EXAMPLE, 9)
    assert judge.judge(EXAMPLE, 2).n_trials == 1
    assert judge.judge(EXAMPLE, 2).n_trials == 1, "judged twice, it counts once"
