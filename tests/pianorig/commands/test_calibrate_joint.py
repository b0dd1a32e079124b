"""``calibrate joint``: the action it writes has the specimen's friction, and the record every reading."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import model
from tests.command_line import run


def test_the_action_written_has_the_joint_of_the_specimen(tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "mine.toml"
    assert run("calibrate", "joint", "--body", "hammer", "--swings", "2", "--out", out) == 0
    assert "hammer: friction 0.0011" in capsys.readouterr().out
    found = model.load_action(out).quantities["hammer.joint_friction.A"]
    assert abs(found.value - 0.00111) < 3 * found.u < 0.02 * 0.00111  # bench.toml
    record = tomllib.loads((tmp_path / "mine.swing.toml").read_text("utf-8"))
    assert record["kind"] == "swing" and len(record["found"]["shares"]) == 2
    assert run("calibrate", "joint", "--body", "hammer", "--out", out) == 2
    assert "exists already" in capsys.readouterr().err
    assert run("calibrate", "joint", "--body", "jack", "--out", tmp_path / "jack.toml") == 2
    assert "allowed key, whippen, hammer" in capsys.readouterr().err
