"""``pianorig learn`` on the virtual bench: a forte force, and what the learned profile does when recorded."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.command_line import run

FORTE = Path(__file__).parents[2] / "model" / "data" / "forte_force.csv"


def test_a_recorded_forte_is_learned_and_played(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, again = tmp_path / "learned", tmp_path / "again"
    assert run("learn", str(FORTE), "--out", str(out), "--json") == 0
    found = json.loads(capsys.readouterr().out)["learned"][0]
    assert found["follows"] and found["rms_percent_of_peak"] <= 3.0 and len(found["rms_percent_by_blow"]) <= 8
    assert {"profile.toml", "learning.json", "pianist_and_motor.png", "recorded_forces.png", "blow_01"} <= {
        path.name for path in out.iterdir()
    }
    # each command passed the dry run on the model before it was played
    from rig import Session

    blows = [Session.open(out / f"blow_{k:02d}").info for k in range(1, len(found["rms_percent_by_blow"]) + 1)]
    assert [blow.dry_run["profile_sha256"] for blow in blows] == [blow.profile.sha256 for blow in blows]
    assert len({blow.profile.sha256 for blow in blows}) == len(blows)
    # independent of the learning: play the file, compare with the recorded table
    assert run("record", "--profile", str(out / "profile.toml"), "--trials", "1", "--out", str(again)) == 0
    data = Session.open(again).trials[0].read()
    wanted = np.loadtxt(FORTE, delimiter=",", skiprows=1)
    force = data.raw_force_n - data.raw_force_n[data.time_s < data.blow_start_s].mean()
    grid = np.arange(0.045, 0.104, 2e-4)
    target = np.interp(grid, wanted[:, 0], wanted[:, 1])
    errors = [
        np.sqrt(np.mean((np.interp(grid + shift, data.time_s, force) - target) ** 2))
        for shift in data.blow_start_s + data.force_info.group_delay_s + np.arange(-0.06, 0.01, 2e-4)
    ]
    assert min(errors) <= 0.035 * 9.9


def test_what_cannot_be_learned_is_one_line(refused: Callable[..., None]) -> None:
    for arguments, words in (
        ((str(FORTE), "--scale", "50"), "give a smaller scale"),
        (("none.csv",), "cannot be read"),
        ((str(FORTE), "--channel", "kraft"), "no channel 'kraft'"),
        ((str(FORTE), str(FORTE)), "same name"),
    ):
        refused(words, "learn", *arguments, "--out", "learned")
