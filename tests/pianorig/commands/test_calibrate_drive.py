"""``pianorig calibrate drive``: a log, the scene of it, and what is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import model
from tests.command_line import run


def test_a_log_gives_the_drive_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A forte by the drive of the built-in scene, whose torque constant is 0.6 N m/A."""
    log, scene = tmp_path / "log.csv", tmp_path / "mine.toml"
    action, (time_s, force_n) = model.load_action("hirschkorn2004-regulated"), model.force_table("forte")
    begun = time_s < 0.2
    time_s, force_n = time_s[begun], force_n[begun]
    given = {"scene": "motor-drive", "output_time_s": time_s, "contact_forces": True, "tolerance": 1e-7}
    blow = model.simulate(action, time_s, force_n / 12.0, **given)  # type: ignore[arg-type]
    seen = model.drive.drive_readings(action, blow, time_s, force_n / 12.0)
    arm = blow.angle_rad[:, blow.bodies.index("motor")]
    rows = np.stack([time_s, force_n / 12.0, seen.force_n, arm, seen.current_a], axis=1).tolist()
    head = "time_s,command_v,force_n,arm_rad,current_a\n"
    log.write_text(head + "".join(",".join(map(repr, row)) + "\n" for row in rows), "utf-8")
    assert run("calibrate", "drive", log, "--out", scene, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    found = facts["determined"]["torque_constant"]
    assert abs(found["value"] - 0.6) < 3.0 * found["u"] < 0.02
    assert {"resistance", "supply"} <= set(facts["not_determined"])
    choice = model.load_scene(scene)
    drive = choice.on(model.load_action())
    together = drive["motor_drive.resistance"] + drive["motor_drive.loop_gain"]
    assert together == pytest.approx(facts["determined"]["resistance_and_loop_gain"]["value"])
    assert model.build_scene(drive, choice).wound
    assert run("calibrate", "drive", log, "--figure", figure := tmp_path / "drive.svg") == 0
    words = capsys.readouterr().out
    drawn = figure.read_text("utf-8")
    assert drawn.count("not determined") == words.count("not determined: ") and words.endswith(f"{figure}\n")
    assert "torque_constant" in words and "not determined: " in words


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "Missing argument 'LOG'"),
        (("--rehearse", "motor-drive"), "No such option: --rehearse"),
        (("nothing.csv",), "nothing.csv"),
        (("log.csv", "--known", "current_gain=2.0"), "NAME=VALUE+-U"),
        (("log.csv", "--known", "colour=2.0+-1"), "known of the drive"),
        (("log.csv", "--mode", "speed"), "torque or voltage"),
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
