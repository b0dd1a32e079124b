"""The back check on a rising hammer: found where contact forces show it, against runs with and without the check."""

from __future__ import annotations

import math

import numpy as np
import pytest

import model
from model.touch import find_check_load
from model.touch.hammer_speed import string_contact_starts


def blow(force_n: float, rise_s: float) -> tuple[list[float], list[float]]:
    return [0.0, rise_s, 0.15], [0.0, force_n, force_n]


def test_a_sudden_blow_is_caught_on_its_way_up(regulated: model.Action) -> None:
    found = find_check_load(regulated, *blow(40.0, 0.01))
    assert found is not None
    time_s = np.arange(0.0, 0.05, 1e-5)
    plain = model.simulate(regulated, *blow(40.0, 0.01), output_time_s=time_s, contact_forces=True)
    first = string_contact_starts(plain.hammer_height_m)[0]
    push = plain.contact_normal_n[:first, plain.contacts.index("contact04")]
    assert found.largest_n == pytest.approx(push.max(), rel=0.02)
    assert found.largest_at_s == pytest.approx(time_s[push.argmax()], abs=2e-4)
    assert found.strike_m_per_s == pytest.approx(plain.hammer_approach_m_per_s[first], rel=0.01)
    none = model.load_scene("whole")
    free = model.simulate(
        regulated, *blow(40.0, 0.01), output_time_s=time_s, scene=model.SceneChoice(none.bodies, ("contact04",))
    )
    first = string_contact_starts(free.hammer_height_m)[0]
    assert found.without_m_per_s == pytest.approx(free.hammer_approach_m_per_s[first], rel=0.01)
    assert "the back check presses the rising hammer from 7.3 ms on" in str(found)


def test_a_hammer_that_never_strikes_says_so(regulated: model.Action) -> None:
    found = find_check_load(regulated, *blow(50.0, 0.01))
    assert found is not None and math.isnan(found.strike_m_per_s) and found.without_m_per_s > 7.5
    assert "it never strikes, without the check it strikes at" in str(found)


@pytest.mark.parametrize("name", ["forte", "piano", "double", "fortissimo"])
def test_usual_blows_are_free_of_it(name: str, regulated: model.Action) -> None:
    assert find_check_load(regulated, *model.force_table(name)) is None


def test_a_table_that_begins_late(regulated: model.Action) -> None:
    times, forces = blow(40.0, 0.01)
    late = find_check_load(regulated, [0.0, *(3.0 + t for t in times)], [0.0, *forces])
    now = find_check_load(regulated, times, forces)
    assert late is not None and now is not None
    assert late.start_s - 3.0 == pytest.approx(now.start_s, abs=2e-4)
    assert late.strike_m_per_s == pytest.approx(now.strike_m_per_s, rel=0.01)
