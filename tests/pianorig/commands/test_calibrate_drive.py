"""``pianorig calibrate drive``: a rehearsal, its log, the scene of it, and what is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import model
from tests.command_line import run

ACTION = ("--action", "hirschkorn2004-regulated")


@pytest.mark.slow  # compiles a scene
def test_a_rehearsed_log_gives_the_drive_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, scene = tmp_path / "log.csv", tmp_path / "mine.toml"
    assert run("calibrate", "drive", "--rehearse", "motor-drive", *ACTION, "--out", log) == 0
    words = capsys.readouterr().out
    assert "[0.6]" in words and "not determined" in words
    assert run("calibrate", "drive", log, "--out", scene, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    found = facts["determined"]["torque_constant"]
    assert abs(found["value"] - 0.6) < 3.0 * found["u"]
    assert {"resistance", "supply", "current_limit"} <= set(facts["not_determined"])
    choice = model.load_scene(scene)
    drive = choice.on(model.load_action())
    together = drive["motor_drive.resistance"] + drive["motor_drive.loop_gain"]
    assert together == pytest.approx(facts["determined"]["resistance_and_loop_gain"]["value"])
    assert model.build_scene(drive, choice).wound


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "neither a log nor --rehearse"),
        (("log.csv", "--rehearse", "motor-drive"), "or both"),
        (("nothing.csv",), "nothing.csv"),
        (("log.csv", "--known", "current_gain=2.0"), "NAME=VALUE+-U"),
        (("log.csv", "--known", "colour=2.0+-1"), "known of the drive"),
        (("log.csv", "--mode", "speed"), "torque or voltage"),
        (("--rehearse", "motor-arm"), "without the effect motor_drive"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(
    arguments: tuple[str, ...],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{k / 5000},{k // 50},0.0,0.0\n" for k in range(300))
    (tmp_path / "log.csv").write_text("time_s,command_v,force_n,arm_rad\n" + rows, "utf-8")
    assert run("calibrate", "drive", *arguments) == 2
    said = capsys.readouterr().err.strip()
    assert words in said and "\n" not in said
