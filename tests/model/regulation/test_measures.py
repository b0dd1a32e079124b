"""Seven measures: the printed action's known figures, closed-form geometry, what cannot be found."""

from __future__ import annotations

import math

import numpy as np
import pytest

import model
from model import hand_set_rest
from model.regulation import TARGETS, measure
from model.regulation.measures import first_touch_angle, measure_at_rest, medium_blow
from tests.model.verification.reference_equations import Twin


@pytest.fixture(scope="module")
def printed(action: model.Action) -> dict[str, float]:
    found = measure(action)
    assert not found.remarks
    return {name: 1e3 * value for name, value in found.value_m.items()}


def test_the_printed_action_is_out_of_regulation_as_known(printed: dict[str, float]) -> None:
    assert printed["dip"] == pytest.approx(9.34, abs=0.005)
    assert printed["hammer_height"] == pytest.approx(48.157, abs=0.0005)
    assert printed["jack"] == pytest.approx(0.11, abs=0.005)
    assert printed["repetition"] == pytest.approx(0.838, abs=0.0005)
    assert 12.0 < printed["let_off"] < 13.0
    assert printed["drop"] == pytest.approx(10.8, abs=0.05)
    assert printed["check"] == pytest.approx(16.2, abs=0.05)


def test_first_touch_closes_the_gap_of_the_twin(action: model.Action) -> None:
    q = hand_set_rest(action)
    q[0] = first_touch_angle(action, q[0])
    twin = Twin(action)
    twin.forces_and_mass(q, np.zeros(5), 0.0)
    assert abs(twin.gap("contact02")[0]) < 1e-15


def test_first_touch_of_a_felt_out_of_reach(action: model.Action) -> None:
    far = action.with_values({"contact02.first.x": 0.0, "contact02.first.y": -0.9, "contact02.first.radius": 0.9999})
    with pytest.raises(model.InputError, match=r"contact02: the key never touches"):
        first_touch_angle(far, 0.03)


def test_rest_measures_follow_their_own_part(action: model.Action) -> None:
    before = measure_at_rest(action)
    lower = measure_at_rest(action.with_values({"contact12.second.y": action["contact12.second.y"] - 2e-3}))
    assert lower["hammer_height"] - before["hammer_height"] == pytest.approx(-2e-3, abs=1e-12)  # string 2 mm lower
    assert lower["dip"] == before["dip"]
    wider = measure_at_rest(action.with_values({"contact09.second.x": action["contact09.second.x"] + 0.3e-3}))
    assert wider["jack"] - before["jack"] == pytest.approx(0.3e-3, abs=1e-12)  # jack 0.3 mm wider on its right


def test_a_lever_above_the_jack_reads_negative(action: model.Action) -> None:
    high = action.with_values({"contact06.second.y": action["contact06.second.y"] - 1.5e-3})
    assert -2e-3 < measure_at_rest(high)["repetition"] < -0.2e-3


def test_a_jack_that_never_lets_go_says_so(action: model.Action) -> None:
    stuck = action.with_values({"contact08.second.y": action["contact08.second.y"] + 4e-3})
    found = measure(stuck)
    assert math.isnan(found.value_m["let_off"]) and math.isnan(found.value_m["drop"])
    assert "does not let go" in found.remarks["let_off"]


def test_a_hammer_that_is_not_caught_says_so(action: model.Action) -> None:
    found = measure(action.with_values({"contact04.friction": 0}))
    assert math.isnan(found.value_m["check"]) and "not caught" in found.remarks["check"]


def test_the_medium_blow_is_what_the_decision_says() -> None:
    time, force = medium_blow()
    assert time[0] == force[0] == 0.0 and time[-1] == 0.5 and force[-1] == force[-2] == 5.0
    assert np.interp(0.075, time, force) == pytest.approx(1.25)


def test_targets_are_those_of_the_thesis() -> None:
    assert [round(1e3 * t.wanted_m, 6) for t in TARGETS] == [10.0, 48.0, 0.0, 0.0, 1.0, 3.0, 15.0]
