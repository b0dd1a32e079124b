"""Rest with the hammer let down: the jack is under the knuckle wherever it can stay there."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.simulation import hand_set_rest as hand_set
from model.simulation.hand_set_rest import hand_set_rest, slip_angle

SCREWS = ("contact02.first.y", "contact01.first.y", "contact05.second.x", "contact06.second.y")


def test_the_printed_action_rests_where_statics_says(action: model.Action) -> None:
    np.testing.assert_allclose(hand_set_rest(action), model.rest_state(action).angle_rad, atol=1e-10)


def test_the_jack_is_found_from_many_states_of_regulation(action: model.Action) -> None:
    random = np.random.default_rng(8)
    for _ in range(25):
        turns = random.uniform(-1e-3, 1e-3, size=4)
        turns[2] = -0.5 * abs(turns[2])  # the pad holds the jack in; turned the other way it does slip
        off = action.with_values({p: action[p] + float(x) for p, x in zip(SCREWS, turns, strict=True)})
        q = hand_set_rest(off)
        assert abs(slip_angle(off, q[None, :])[0]) < np.radians(15.0), turns


def test_all_places_are_tried_before_a_slipped_jack_is_accepted(
    action: model.Action, monkeypatch: pytest.MonkeyPatch
) -> None:
    raised = action.with_values({"contact01.first.y": action["contact01.first.y"] + 0.5e-3})
    good = hand_set_rest(raised)
    # from the usual place alone the search may slip; what settled then helps to find the jack
    monkeypatch.setattr(hand_set, "LIFTS", ((0.0, 0.0),))
    np.testing.assert_allclose(hand_set_rest(raised), good, atol=1e-9)
