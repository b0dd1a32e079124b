"""``pianorig simulate --key-motion`` as a user meets it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import model
from tests.command_line import run

FORCE = Path(__file__).parents[2] / "model" / "data" / "forte_force.csv"


@pytest.fixture(scope="module")
def blow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Key angles of the start of a forte, as an encoder counts them."""
    force = np.loadtxt(FORCE, delimiter=",", skiprows=1)[:600]
    key = model.simulate(model.load_action(), force[:, 0], force[:, 1]).angle_rad[:, 0]
    count = 2.0 * np.pi / 327680
    jitter = np.random.default_rng(2).normal(0.0, 0.5, len(key))
    path = tmp_path_factory.mktemp("key") / "key.csv"
    rows = np.column_stack([force[:, 0], np.floor(key / count + jitter + 0.5) * count])
    np.savetxt(path, rows, "%.12g", ",", header="time_s,key_rad", comments="")
    return path


def test_columns_and_facts(blow: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "force.csv"
    assert run("simulate", "--key-motion", str(blow), "--out", str(out), "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    header = out.read_text().splitlines()[0].split(",")
    bodies = ["key", "whippen", "jack", "repetition", "hammer"]
    assert header[:5] == ["time_s", "force_n", "u_force_n", "key_joint_y_n", "key_lifted"]
    assert header[5:] == [*(f"{b}_rad" for b in bodies), *(f"{b}_rad_per_s" for b in bodies)]
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    table = np.loadtxt(blow, delimiter=",", skiprows=1)
    driven = model.simulate_motion(model.load_action(), *table.T, tolerance=1e-5)
    np.testing.assert_array_equal(rows[:, 1], driven.force_n)  # seeded: the same numbers again
    np.testing.assert_array_equal(rows[:, 2], driven.u_force_n)
    assert facts["rows"] == 600 and facts["resolution_rad"] == pytest.approx(2.0 * np.pi / 327680, rel=1e-6)
    assert len(facts["key_would_lift"]) == 1 and facts["key_would_lift"][0]["start_s"] == pytest.approx(
        0.1094, abs=5e-4
    )


def test_rate_and_hdf5(blow: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import h5py

    out = tmp_path / "force.h5"
    assert run("simulate", "--key-motion", str(blow), "--output-rate", "1000", "--out", str(out)) == 0
    assert "largest force" in (text := capsys.readouterr().out) and "key would lift" in text
    with h5py.File(out) as file:
        assert file["u_force_n"].attrs["units"] == "N"
        assert file.attrs["coverage_factor_95"] == pytest.approx(2.02, abs=0.02)
        np.testing.assert_allclose(np.diff(file["time_s"][:]), 1e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,force_n\n0,1\n", "columns found time_s,force_n; allowed time_s,key_rad"),
        ("time_s,key_rad\n" + "".join(f"{t},0\n" for t in range(5)), "found 5 rows with an angle, allowed 20"),
        ("time_s,key_rad\n" + "".join(f"{-t},0\n" for t in range(30)), "row 2: time -1 s does not follow 0 s"),
        ("time_s,key_rad\n" + "".join(f"{t},0\n" for t in (*range(25), 24)), "row 26: time 24 s does not follow 24 s"),
        ("time_s,key_rad\n0,zero\n", "row 1: key_rad found 'zero', allowed a number"),
        ("time_s,key_rad\n0,4\n1,0\n", "row 1: key_rad found 4, allowed finite numbers up to 3"),
        ("time_s,key_rad\n0,0\n1,inf\n", "row 2: key_rad found inf"),
        ("time_s,key_rad\nnan,0\n1,0\n", "row 1: time_s found nan"),
        ("", "is empty"),
    ],
)
def test_bad_tables(tmp_path: Path, text: str, words: str, refused: Callable[..., None]) -> None:
    table = tmp_path / "key.csv"
    table.write_text(text)
    refused(words, "simulate", "--key-motion", table, "--out", "force.csv")


def test_what_cannot_go_together(blow: Path, refused: Callable[..., None]) -> None:
    for arguments, words in (
        (("--key-motion", str(blow), "--force", str(FORCE)), "--key-motion: found together with --force"),
        (("--key-motion", str(blow), "--inside"), "--key-motion: found together with --inside"),
        ((), "found neither --force nor --key-motion"),
    ):
        refused(words, "simulate", *arguments, "--out", "force.csv")


def test_changes_since_rest(
    blow: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., None]
) -> None:
    rows = np.loadtxt(blow, delimiter=",", skiprows=1)
    rows[:, 1] -= rows[0, 1]
    table, out = tmp_path / "change.csv", tmp_path / "force.csv"
    np.savetxt(table, rows, "%.12g", ",", header="time_s,key_rad", comments="")
    assert run("simulate", "--key-motion", str(table), "--from-rest", "--out", str(out)) == 0
    assert "from where" not in capsys.readouterr().out
    force = np.loadtxt(out, delimiter=",", skiprows=1)
    truth = np.loadtxt(FORCE, delimiter=",", skiprows=1)[:600, 1]
    assert np.sqrt(np.mean((force[:, 1] - truth) ** 2)) < 0.03 * truth.max()
    out.unlink()
    # taken as angles from ground, the key would be pressed far into its bed
    refused("allowed up to 1000 N", "simulate", "--key-motion", table, "--out", out)
    words = "--from-rest: found without --key-motion"
    refused(words, "simulate", "--force", FORCE, "--from-rest", "--out", out)


def test_a_force_from_coarse_counts_is_called_useless(
    blow: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = np.loadtxt(blow, delimiter=",", skiprows=1)[::2]
    for counts, useless in ((2000, True), (327680, False)):
        coarse, out = tmp_path / f"{counts}.csv", tmp_path / "force.csv"
        width = 2.0 * np.pi / counts
        angles = np.round(rows[:, 1] / width) * width
        np.savetxt(coarse, np.column_stack([rows[:, 0], angles]), "%.12g", ",", header="time_s,key_rad", comments="")
        assert run("simulate", "--key-motion", str(coarse), "--out", str(out)) == 0
        assert ("this force is useless: its 95 % interval is +-" in capsys.readouterr().out) == useless
