"""What another law of felt changes in a blow with everything else equal."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import model
from model.study import felt_law_effects
from model.study.effects import PLAIN, blow_marks, with_usual_felts

BLOW = model.force_table("forte")


def test_felts_are_studied_in_one_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    """The press as well as the blow: the action by itself, whatever scene it carries."""
    action, weighed = model.load_action("hirschkorn2004-regulated"), list[model.Action]()
    monkeypatch.setattr(
        "model.study.effects.weigh", lambda a: weighed.append(a) or SimpleNamespace(down_n=1, let_off_n=2)
    )
    (carried,) = felt_law_effects(model.load_scene("giving-joints").on(action), *BLOW, {})
    assert [model.choice_of(a) for a in weighed] == [model.SceneChoice()]
    assert carried.value == felt_law_effects(action, *BLOW, {})[0].value


def test_a_blow_whose_table_ends_on_the_string_has_no_rebound() -> None:
    at = BLOW[0] < 0.1111
    found = blow_marks(model.load_action("hirschkorn2004-regulated"), (BLOW[0][at], BLOW[1][at]), PLAIN)
    assert 110.0 < found["strike_ms"] < 111.0 and np.isnan([found["contact_ms"], found["rebound"]]).all()


def test_numbers_of_a_law_that_is_set_aside_wait_for_it() -> None:
    """A tau that was set with its law had the whole study refused."""
    own = model.load_action().with_laws({"contact12": "stulov"}).with_values({"contact12.stulov.tau": 1e-4})
    plain, stulov = (with_usual_felts(own).with_laws({"contact12": law}) for law in ("hunt-crossley", "stulov"))
    numbers = [model.build_scene(action).vector for action in (model.load_action(), plain, own, stulov)]
    np.testing.assert_array_equal(numbers[0], numbers[1])
    np.testing.assert_array_equal(numbers[2], numbers[3])
