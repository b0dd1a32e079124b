"""The command line as a user meets it: names, exit codes, one-line errors, nothing half-written."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import model
from pianorig.console.column_file import write_columns
from rig import Session
from tests.command_line import run
from validation import ValidationResult
from validation.options import ComparisonOptions
from validation.pipeline import compare_sessions

DATA = Path(__file__).parents[1] / "model" / "data"


def test_simulate_writes_the_columns_in_their_order(
    short_force: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "angles.csv"
    assert run("simulate", "--force", str(short_force), "--out", str(out), "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    bodies = ["key", "whippen", "jack", "repetition", "hammer"]
    header = out.read_text().splitlines()[0].split(",")
    assert header == ["time_s", *(f"{b}_rad" for b in bodies), *(f"{b}_rad_per_s" for b in bodies)]
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    force = np.loadtxt(short_force, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(rows[:, 0], force[:, 0])
    assert facts["rows"] == 200 and facts["n_steps"] > 0

    solution = model.simulate(model.load_action(), force[:, 0], force[:, 1])
    np.testing.assert_array_equal(rows[:, 1:6], solution.angle_rad)  # the text reads back to the same numbers
    np.testing.assert_array_equal(rows[:, 6:], solution.speed_rad_per_s)


def test_simulate_with_forces_rate_settings_and_hdf5(short_force: Path, tmp_path: Path) -> None:
    import h5py

    out = tmp_path / "angles.h5"
    arguments = ["--set", "contact04.friction=0", "--set", "hammer.mass=0.012", "--output-rate", "1000", "--forces"]
    assert run("simulate", "--force", str(short_force), "--out", str(out), *arguments) == 0
    with h5py.File(out) as file:
        assert "contact01_normal_n" in file and "contact13_friction_n" in file
        assert file["contact04_friction_n"].attrs["units"] == "N"
        assert file["hammer_rad_per_s"].attrs["units"] == "rad/s"
        assert np.all(file["contact04_friction_n"][:] == 0.0)
        assert np.any(file["contact07_friction_n"][:] != 0.0)
        np.testing.assert_allclose(np.diff(file["time_s"][:]), 1e-3)
        assert "hammer.mass=0.012" in file.attrs["changed"] and ".law=" not in file.attrs["changed"]
    laws = ["contact02.law=stulov", "contact07.law=hysteresis", "contact12.law=hysteresis"]
    arguments = [word for law in laws for word in ("--set", law)]
    assert run("simulate", "--force", str(short_force), "--out", str(out), *arguments) == 0
    with h5py.File(out) as file:
        assert file.attrs["changed"] == ", ".join(laws)


def test_columns_of_a_motor_have_their_units(tmp_path: Path) -> None:
    import h5py

    units = {"time_s": "s", "torque_nm": "N m", "current_a": "A", "charge_c": "C", "force_n": "N", "held": "1"}
    write_columns(tmp_path / "o.h5", {name: np.zeros(2) for name in units})
    with h5py.File(tmp_path / "o.h5") as file:
        assert {name: column.attrs["units"] for name, column in file.items()} == units


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"--force": "missing.csv"}, "missing.csv: cannot be read"),
        ({"--action": "steinway"}, "action 'steinway': not found; built in: hirschkorn2004"),
        ({"--set": "hammer.mass=heavy"}, "--set hammer.mass: value found 'heavy'"),
        ({"--set": "hammer.mass"}, "allowed path=value"),
        ({"--set": "hammer.mass=-1"}, "hammer.mass: found -1, allowed above 0"),
        ({"--tolerance": "0"}, "tolerance: found 0"),
        ({"--output-rate": "0"}, "output rate: found 0"),
        ({"--out": "nowhere/angles.csv"}, "does not exist"),
        ({"--out": "angles.xlsx"}, "allowed .csv or .h5"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    short_force: Path,
    change: dict[str, str],
    words: str,
    refused: Callable[..., None],
) -> None:
    options = {"--force": short_force.name, "--out": "angles.csv", **change}
    refused(words, "simulate", *(part for pair in options.items() for part in pair))


def test_validate_refuses_a_folder_without_trials(tmp_path: Path, refused: Callable[..., None]) -> None:
    refused(str(tmp_path), "validate", tmp_path)


def test_track_refuses_a_film_without_outlines(tmp_path: Path, refused: Callable[..., None]) -> None:
    film = tmp_path / "film.mraw"
    film.write_bytes(b"1234")
    refused("--bodies", "track", film)


def test_simulate_a_smaller_scene(short_force: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "key.csv"
    assert run("simulate", "--force", str(short_force), "--scene", "key", "--out", str(out)) == 0
    assert out.read_text().splitlines()[0] == "time_s,key_rad,key_rad_per_s"
    assert run("simulate", "--force", str(short_force), "--scene", "upright", "--out", str(out)) == 2
    assert "scene 'upright': not found; built in: whole" in capsys.readouterr().err


@pytest.mark.usefixtures("without_figures")
def test_validate_names_what_it_cannot_read_and_reports_the_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    compared = compare_sessions.compare_by

    def quickly(session: Session, action: model.Action, options: ComparisonOptions) -> ValidationResult:
        return compared(session, action, replace(options, rivals=(), budget=False, explain=False))

    monkeypatch.setattr(compare_sessions, "compare_by", quickly)  # without what is not looked at here
    example = tmp_path / "example"
    shutil.copytree(Path(__file__).parents[2] / "sessions" / "example_forte", example)
    for number in (2, 3):
        (example / f"trial_000{number}.h5").unlink()
    out = tmp_path / "report"
    both = [str(example), str(tmp_path / "gone"), "--no-by-motion", "--out", str(out), "--json"]
    assert run("validate", *both) == 2
    said = json.loads(capsys.readouterr().out)
    assert said["refused"] == [f"{tmp_path / 'gone'}: no such session folder"]
    assert "Not compared:" in said["verdict"] and (out / "report.html").is_file()
    assert not (out / "report.inputs.json").exists()  # not kept as it is: what is missing is to be named again
    assert run("validate", str(example), str(example), "--out", str(out)) == 2
    assert "session given 2 times" in capsys.readouterr().err
    assert run("validate", str(example), "sessions/other") == 2
    assert "name a folder for their report with --out" in capsys.readouterr().err
