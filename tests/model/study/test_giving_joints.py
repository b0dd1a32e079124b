"""What joints that give change in a blow with everything else equal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import model
from model.parameters.effects import PINS
from model.study.effects import OF_JOINTS, preload_joints
from tests.command_line import run

BLOW = model.force_table("forte")


def test_the_command_prints_and_writes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With marks made up of the numbers of the joints: what a blow says of them takes some sixty runs."""

    def marks(action: model.Action, blow: object, choice: model.SceneChoice) -> dict[str, float]:
        names = ("rebound", "strike_m_per_s", "contact_ms", "free_flight_ms", "check_mm", *OF_JOINTS)
        soft = sum(1e4 / action[f"{pin}.stiffness"] for pin in PINS if pin in choice.effects)
        return {"held": True} | {name: (k + 1.0) * (1.0 + soft) for k, name in enumerate(names)}

    monkeypatch.setattr("model.study.effects.blow_marks", marks)
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
    alone, carried = (preload_joints(a) for a in (action, model.load_scene(scene).on(action)))
    paths = [f"{pin}.load.{axis}" for pin in PINS for axis in "xy"]
    assert len({alone[path] for path in paths}) == 10
    assert [carried[path] for path in paths] == [alone[path] for path in paths]
    assert preload_joints(action.with_values({"key_pin.stiffness": 2e6}))["key_pin.stiffness"] == 2e6
