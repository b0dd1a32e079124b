"""``record --felt``: from the virtual bench to a calibrated action in three commands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import model
from rig import Session
from tests.command_line import run


def test_from_the_block_to_a_calibrated_felt(tmp_path: Path, capsys: Any) -> None:
    assert run("record", "--felt", "block", "--peak", "20", "--out", tmp_path / "block", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["compliance_m_per_n"] == pytest.approx(5e-6, rel=0.02)
    speeds = ["--speed", "0.004", "--speed", "0.016"]
    arguments = ["--felt", "contact02", "--rig", found["rig"], *speeds, "--peak", "20", "--out", tmp_path / "felt"]
    arguments += ["--action", "Boston"]
    assert run("record", *arguments) == 0
    said = capsys.readouterr().out
    assert "trial 3: " in said and "next: pianorig calibrate felt" in said
    command = said[said.index("calibrate felt") :].splitlines()[0].split()
    assert run(*command[:-1], tmp_path / "mine.toml") == 0, command
    assert "  uncertainty includes what all points share: compliance" in capsys.readouterr().out
    mine, truth = model.load_action(tmp_path / "mine.toml"), model.load_action()
    for letter in "abc":
        path = f"contact02.normal.{letter}"
        assert abs(mine[path] - truth[path]) < 3 * mine.quantities[path].u
    assert abs(mine["contact02.normal.D"] - 1.6) < 3 * mine.quantities["contact02.normal.D"].u  # bench.toml
    assert Session.open(tmp_path / "felt").info.action.name == "Boston"
    assert run("validate", tmp_path / "felt") == 2
    assert "presses of a felt, not blows" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--felt", "contact99x"], "--felt contact99x: allowed contact01 to contact13, or block"),
        (["--felt", "contact44"], "felt contact44: not found"),
        (["--felt", "contact02", "--passive"], "--felt: presses no key"),
        (["--speed", "0.1"], "--speed, --peak: go with --felt"),
        (["--felt", "contact02", "--speed", "3"], "speed 3 m/s, allowed 0.0001 to 0.2 m/s"),
        (["--felt", "contact02", "--trials", "0"], "0 repeats"),
        (["--felt", "contact02", "--dry-run"], "not with --dry-run"),
    ],
)
def test_what_cannot_be_pressed_is_refused(tmp_path: Path, capsys: Any, arguments: list[str], said: str) -> None:
    assert run("record", *arguments, "--out", tmp_path / "s") == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "s").exists()
