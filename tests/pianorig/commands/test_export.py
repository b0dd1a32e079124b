"""``pianorig export``, and trials as the force of ``simulate`` and ``study``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pianorig.workflows import read_driving_force
from rig import Session
from tests.command_line import run

FORTE = Path(__file__).parents[3] / "sessions" / "example_forte"


def test_all_trials_or_one_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = Session.open(FORTE)
    assert run("export", FORTE, "--to", "csv", "--trial", "2", "--out", tmp_path / "one", "--json") == 0
    files = json.loads(capsys.readouterr().out)["files"]
    assert [Path(file).name for file in files] == ["trial_0002.csv", "trial_0002.csv-metadata.json"]
    table = np.genfromtxt(files[0], delimiter=",", names=True)
    np.testing.assert_array_equal(table["force_n"], session[2].force_n)
    np.testing.assert_array_equal(table["raw_force_n"], session[2].read().raw_force_n)
    assert run("export", FORTE, "--to", "mat", "--out", tmp_path / "all") == 0
    assert len(list((tmp_path / "all").glob("*.mat"))) == len(session.trials)
    assert run("export", FORTE / "trial_0001.h5", "--to", "csv", "--out", tmp_path / "file") == 0
    assert (tmp_path / "file" / "trial_0001.csv").is_file()


def test_the_exported_force_drives_and_that_of_an_older_export_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("export", FORTE, "--to", "csv", "--trial", "1", "--out", tmp_path) == 0
    file, older = tmp_path / "trial_0001.csv", tmp_path / "older.csv"
    np.testing.assert_array_equal(read_driving_force(file).force_n, Session.open(FORTE)[1].force_n)
    head, *rows = file.read_text().splitlines()
    names = head.replace("force_n,raw_force_n", "force_n", 1)
    older.write_text("\n".join([names, *(",".join(r.split(",")[:1] + r.split(",")[2:]) for r in rows)]))
    capsys.readouterr()
    assert run("simulate", "--force", older, "--out", tmp_path / "o.csv") == 2
    assert "older.csv: is an older export, its force_n is not corrected" in capsys.readouterr().err


def test_the_force_is_what_simulate_takes_from_the_trial(tmp_path: Path) -> None:
    assert run("export", FORTE, "--to", "force", "--trial", "1", "--out", tmp_path) == 0
    force = np.genfromtxt(tmp_path / "force.csv", delimiter=",", names=True)
    driving = read_driving_force(FORTE / "trial_0001.h5")
    np.testing.assert_array_equal(force["time_s"], driving.time_s)
    np.testing.assert_array_equal(force["force_n"], driving.force_n)
    assert run("export", FORTE, "--to", "force", "--out", tmp_path) == 0
    assert len(list(tmp_path.glob("force_0*.csv"))) == len(Session.open(FORTE).trials)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((FORTE, "--to", "xls"), "--to xls: allowed csv, mat, tdms, parquet, force"),
        ((FORTE, "--trial", "99"), "no trial 99"),
        ((FORTE / "trial_0001.h5", "--trial", "1"), "--trial goes with a session folder"),
        ((FORTE / "trial_0099.h5",), "is no trial of a session"),
    ],
)
def test_a_wrong_request_is_one_line(
    arguments: tuple[object, ...], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("export", *arguments, "--out", tmp_path / "o") == 2
    assert words in capsys.readouterr().err


def test_a_study_takes_a_trial(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trial = FORTE / "trial_0001.h5"
    assert run("study", "variants", "--force", trial, "--variant", "dry: --scale damping=0.5", "--json") == 0
    rows = json.loads(capsys.readouterr().out)["variants"]
    assert [row["variant"] for row in rows] == ["as given", "dry"] and rows[0]["strike_s"] > 0.3
