"""``simulate --force`` takes a recorded trial: the same force, rest and motion as in a comparison."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import model
import rig
import validation
from tests.command_line import run

SHIPPED = Path(__file__).parents[3] / "sessions" / "example_forte"


def test_the_motion_is_that_of_the_comparison(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = tmp_path / "session"
    shutil.copytree(SHIPPED, session, ignore=shutil.ignore_patterns("derived", "trial_0002*", "trial_0003*"))
    out = tmp_path / "angles.csv"
    drawn: list[model.Solution] = []
    monkeypatch.setattr("model.inside.draw_sheet", lambda _, solution, *rest: drawn.append(solution))
    figure = tmp_path / "sheet.svg"
    assert run("simulate", "--force", session / "trial_0001.h5", "--out", out, "--figure", figure) == 0
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    assert np.abs(drawn[0].angle_rad[0] - rows[0, 1:6]).max() < 1e-9  # drawn from where the output starts: preloaded
    quick = {"by_motion": False, "rivals": (), "budget": False, "explain": False}
    trace = validation.compare(rig.Session.open(session), "hirschkorn2004", **quick).traces[1]
    known = trace.dropna(subset=["hammer_predicted_rad"])
    np.testing.assert_array_equal(rows[:, 0], trace["force_time_s"].to_numpy()[: len(rows)])
    for column, body in ((1, "key"), (2, "whippen"), (5, "hammer")):
        curve = CubicHermiteSpline(rows[:, 0], rows[:, column], rows[:, column + 5])
        turned = curve(known["time_s"]) - rows[0, column]
        assert np.abs(turned - known[f"{body}_predicted_rad"]).max() < 2e-5, body  # twice the requested error
        assert np.abs(turned).max() > 0.02


def test_a_trial_drives_no_scene_that_takes_a_torque_and_must_be_a_trial(tmp_path: Path, refused: Callable) -> None:
    trial = SHIPPED / "trial_0001.h5"
    refused("driven by torque_nm", "simulate", "--force", trial, "--scene", "motor-arm", "--out", "o.csv")
    (tmp_path / "other.h5").write_bytes(b"no trial")
    refused("other.h5", "simulate", "--force", tmp_path / "other.h5", "--out", "o.csv")
