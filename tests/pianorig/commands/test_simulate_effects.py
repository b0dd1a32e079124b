"""``pianorig simulate`` with effects: scenes by name and file, values by path, the motor's torque as input."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.command_line import run

SCENE = "lifting-key-flexible-shank"


@pytest.fixture()
def blow(tmp_path: Path) -> Path:
    path = tmp_path / "force.csv"
    t = np.linspace(0.0, 0.12, 121)
    rows = np.column_stack([t, np.where(t < 0.02, 0.0, 12.0)])
    np.savetxt(path, rows, delimiter=",", header="time_s,force_n", comments="", fmt="%.6g")
    return path


def test_columns_of_effects_and_values_by_path(blow: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    soft, stiff, file = (tmp_path / f"{name}.csv" for name in ("soft", "stiff", "file"))
    base = ("simulate", "--force", blow, "--forces", "--json", "--scene")
    assert run(*base, SCENE, "--set", "shank.frequency_hz=60", "--out", soft) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == 121
    assert run(*base, SCENE, "--scale", "shank.frequency_hz=16", "--out", stiff) == 0
    scene = tmp_path / "own.toml"
    scene.write_text('effects = ["balance_rail"]\n[shank]\nfrequency_hz = 60.0\n')
    assert run(*base, scene, "--out", file) == 0
    a, b, c = (pd.read_csv(path) for path in (soft, stiff, file))
    for name in ("key_lift_m", "key_lift_m_per_s", "shank_rad", "shank_rad_per_s", "balance_rail_normal_n"):
        assert name in a
    assert np.ptp(a["shank_rad"]) > 30.0 * np.ptp(b["shank_rad"])
    pd.testing.assert_frame_equal(a, c)  # the same value by path and by file


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--set", "shank.frequency_hz=60"), "shank.frequency_hz is set but the scene has no shank"),
        (("--set", "shank.frequenzy=60"), "did you mean shank.frequency_hz"),
        (("--scene", "motor-arm"), "allowed time_s,torque_nm"),
    ],
)
def test_what_would_have_no_meaning_is_refused(
    blow: Path, words: tuple, message: str, refused: Callable[..., None]
) -> None:
    refused(message, "simulate", "--force", blow, "--out", "out.csv", *words)


def test_the_motor_presses_with_its_torque_over_its_length(tmp_path: Path) -> None:
    path, out = tmp_path / "torque.csv", tmp_path / "out.csv"
    path.write_text("time_s,torque_nm\n0,0\n0.05,0.02\n0.5,0.02\n")
    words = ("simulate", "--force", path, "--scene", "motor-arm", "--forces", "--out", out)
    assert run(*words, "--set", "motor_arm.length=0.08", "--set", "motor_arm.spring_stiffness=0") == 0
    table = pd.read_csv(out)
    # at rest: torque over length, and the return spring's preload
    assert table["motor_arm_normal_n"].iloc[-1] == pytest.approx(0.02 / 0.08 + 0.05, rel=2e-3)
    assert table["motor_rad"].iloc[0] == pytest.approx(0.0, abs=2e-3)
