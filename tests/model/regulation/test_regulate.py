"""Regulation: targets met from several starts at one and the same place, the shipped set reproduced, failures named."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import model
from model.regulation import REST_RAIL, SCREWS, TARGETS, Regulation, RegulationError, measure, regulate, write_action

SHIPPED = "hirschkorn2004-regulated"


@pytest.fixture(scope="module")
def done(action: model.Action) -> Regulation:
    return regulate(action)


def distances_mm(measurement: model.regulation.TargetValues) -> list[float]:
    return [1e3 * abs(measurement.value_m[t.name] - t.wanted_m) for t in TARGETS]


def test_all_seven_targets_are_met(done: Regulation) -> None:
    assert max(distances_mm(done.after)) < 0.02
    assert max(distances_mm(measure(done.action))) < 0.02
    assert max(distances_mm(done.before)) > 10.0


def test_only_the_seven_screws_are_turned(action: model.Action, done: Regulation) -> None:
    changed = {p for p, q in done.action.quantities.items() if q != action.quantities[p]}
    assert changed == {s.path for s in SCREWS}
    for s in SCREWS:
        q = done.action.quantities[s.path]
        assert q.source.startswith("regulated") and q.basis == "assumed" and 0.0 < q.u < 5e-5
        assert q.value - action[s.path] == pytest.approx(done.turned_m[s.target], abs=1e-12)


def test_another_start_ends_at_the_same_place(action: model.Action, done: Regulation) -> None:
    off = dict(zip([s.path for s in SCREWS], (-0.4, 0.5, -0.3, 0.6, -0.8, 0.7, -1.5), strict=True))
    start = action.with_values({path: action[path] + 1e-3 * x for path, x in off.items()})
    again = regulate(start)
    assert max(distances_mm(again.after)) < 0.02
    for s in SCREWS:
        assert again.action[s.path] == pytest.approx(done.action[s.path], abs=5e-6), s.name


def test_the_shipped_set_is_what_the_command_makes(done: Regulation, tmp_path: Path) -> None:
    shipped = model.load_action(SHIPPED)
    write_action(done.action, tmp_path / "again.toml")
    again = model.load_action(tmp_path / "again.toml")
    assert again.name == shipped.name == SHIPPED and dict(again.structure) == dict(shipped.structure)
    assert again.quantities.keys() == shipped.quantities.keys()
    turned = {s.path for s in SCREWS}
    for path, q in shipped.quantities.items():
        if path in turned:
            assert again[path] == pytest.approx(q.value, abs=3e-6), path
        else:
            assert again.quantities[path] == q, path
    assert max(distances_mm(measure(shipped))) < 0.02


def test_the_regulated_action_plays(done: Regulation) -> None:
    """Rest is found without help; a blow strikes, is caught at 15 mm and comes back to rest."""
    rest = model.rest_state(done.action)
    assert np.abs(rest.angle_rad - model.hand_set_rest(done.action)).max() < 1e-9
    time, force = np.array([0.0, 0.02, 0.4, 0.45, 0.9]), np.array([0.0, 5.0, 5.0, 0.0, 0.0])
    out = np.linspace(0.0, 0.9, 901)
    blow = model.simulate(done.action, time, force, output_time_s=out)
    height = model.observables.hammer_height_m(done.action, blow.angle_rad)
    assert height.min() < 0.0 and 0.01 < height[399] < 0.02 and height[-1] == pytest.approx(0.048, abs=1e-4)


def test_a_regulated_action_comes_back_unchanged() -> None:
    shipped = model.load_action(SHIPPED)
    again = regulate(shipped)
    assert again.action is shipped and set(again.turned_m.values()) == {0.0} and again.rest_rail_m == 0.0
    assert max(distances_mm(again.after)) < 0.02


@pytest.mark.parametrize(
    "small",
    [
        {"contact02.first.y": -0.0081917, "contact05.second.x": 0.0758402},
        {"contact07.first.radius": 10e-6},
    ],
    ids=["two screws", "knuckle"],
)
def test_what_is_nearly_regulated_is_regulated(small: dict[str, float]) -> None:
    """A screw that hardly has to turn keeps a stated uncertainty, and the regulation."""
    shipped = model.load_action(SHIPPED)
    off = shipped.with_values({path: x if len(small) == 2 else shipped[path] + x for path, x in small.items()})
    done = regulate(off)
    assert max(distances_mm(done.after)) < 0.02
    for s in SCREWS:
        if done.turned_m[s.target]:
            assert 1e-7 < done.action.quantities[s.path].u < 2e-4, s.name


def test_a_hammer_that_lies_on_its_rail_is_freed_by_lowering_the_rail(action: model.Action) -> None:
    high = model.load_action(SHIPPED).with_values({REST_RAIL.path: action[REST_RAIL.path] + 1e-3})
    rest = model.rest_state(high)
    assert rest.contact_normal_n[rest.contacts.index("contact13")] > 0.02
    done = regulate(high)
    assert max(distances_mm(done.after)) < 0.02 and -2.5e-3 < done.rest_rail_m < -1e-3
    after = model.rest_state(done.action)
    assert after.penetration_m[after.contacts.index("contact13")] == pytest.approx(-0.5e-3, abs=0.02e-3)
    rail = done.action.quantities[REST_RAIL.path]
    assert rail.value - high[REST_RAIL.path] == pytest.approx(done.rest_rail_m, abs=1e-12)
    assert rail.source.startswith("regulated: rest rail lowered")


def test_a_screw_that_is_too_short_is_told_how_far_it_would_have_to_go() -> None:
    shipped = model.load_action(SHIPPED)
    off = shipped.with_values({"contact02.first.y": shipped["contact02.first.y"] - 4e-3})
    with pytest.raises(RegulationError, match=r"key-dip washers .* at its limit, \+3\.00 mm") as caught:
        regulate(off)
    found = re.search(r"would have to go to \+(\d\.\d\d) mm", str(caught.value))
    assert found and math.isclose(float(found[1]), 4.0, abs_tol=0.03)
