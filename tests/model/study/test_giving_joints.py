"""What joints that give change in a blow with everything else equal: ``python -m pytest -m slow tests/model/study``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import model
from model.parameters.effects import PINS
from model.study import joint_effects, joint_sweep
from model.study.effects import ALL, RIGID, loaded_as_at_rest
from tests.command_line import run

BLOW = model.force_table("forte")


@pytest.mark.slow
def test_loads_leave_the_rest_where_it_is() -> None:
    action = model.load_action("hirschkorn2004-regulated")
    rigid = model.rest_state(action).angle_rad
    given = model.rest_state(loaded_as_at_rest(action), scene=model.build_scene(loaded_as_at_rest(action), ALL))
    np.testing.assert_allclose(given.angle_rad, rigid, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_the_hammers_joint_takes_rebound_and_the_rail_the_check() -> None:
    action = model.load_action("hirschkorn2004-regulated")
    found = {e.of: e for e in joint_effects(action, *BLOW)}
    assert list(found) == ["none", *PINS, "all five", "balance_rail", "all, rail"]
    rigid = found["none"].value
    for name, effect in found.items():
        assert effect.value["strike_m_per_s"] == pytest.approx(rigid["strike_m_per_s"], rel=0.02), name
        assert name == "none" or effect.u["strike_ms"] > 0.0
    assert found["hammer_pin"].value["rebound"] < rigid["rebound"] - 3.0 * found["hammer_pin"].u["rebound"]
    assert found["balance_rail"].value["check_mm"] < rigid["check_mm"] - 1.0
    swept = joint_sweep(action, *BLOW, [1.0, 20.0, 400.0])
    gives = [swept[f]["give_mm"] for f in (0.0, 400.0, 20.0, 1.0)]
    assert gives == sorted(gives) and gives[0] == 0.0
    assert abs(swept[400.0]["check_mm"] - rigid["check_mm"]) < 0.1 * abs(swept[1.0]["check_mm"] - rigid["check_mm"])
    assert 100.0 * action["hammer_pin.stiffness"] < RIGID["stiffness"]


@pytest.mark.slow
def test_the_command_prints_and_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "joints"
    assert run("study", "joints", "--action", "hirschkorn2004-regulated", "--out", out) == 0
    shown = capsys.readouterr().out
    assert "hammer_pin" in shown and "guesses" in shown and "The thesis (5.2)" in shown
    assert (out / "joints.csv").is_file() and (out / "joints_stiffness.csv").is_file()
    assert run("study", "joints", "--action", "hirschkorn2004-regulated", "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert [row["of"] for row in facts["effects"]][:2] == ["none", "key_pin"] and len(facts["stiffness"]) == 8


@pytest.mark.parametrize("scene", ["motor-arm", "lifting-key"])
def test_loads_are_those_of_the_action_by_itself(scene: str) -> None:
    """Whatever scene it carries: the arm's preload made the key's joint bear 0.1 N more, a lifting key was refused."""
    action = model.load_action("hirschkorn2004-regulated")
    alone, carried = (loaded_as_at_rest(a) for a in (action, model.load_scene(scene).on(action)))
    paths = [f"{pin}.load.{axis}" for pin in PINS for axis in "xy"]
    assert len({alone[path] for path in paths}) == 10
    assert [carried[path] for path in paths] == [alone[path] for path in paths]
    assert loaded_as_at_rest(action.with_values({"key_pin.stiffness": 2e6}))["key_pin.stiffness"] == 2e6
