"""``pianorig sensitivity`` as a user meets it."""

from __future__ import annotations

import csv
import json
import logging
from pathlib import Path

import pytest

from model.simulation.statics import NO_REST
from pianorig.workflows.cluster import _quiet
from tests.command_line import run
from tests.pianorig.test_commands import DATA

FORTE = str(DATA / "forte_force.csv")
FEW = ["--parameters", "friction,hammer.mass"]


def rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_local_table_as_text_json_and_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "local"
    assert run("sensitivity", FORTE, *FEW, "--out", str(out)) == 0
    text = capsys.readouterr().out.splitlines()
    assert text[0] == "hirschkorn2004: percent of a quantity per percent of a parameter"
    assert text[1].split()[:3] == ["parameter", "let-off", "speed"]
    table = rows(out / "local.csv")
    speed = {r["parameter"]: float(r["percent_per_percent"]) for r in table if r["quantity"] == "strike_m_per_s"}
    assert speed["friction"] == pytest.approx(-0.041, abs=0.002) and speed["hammer.mass"] < -0.1
    assert (out / "local.svg").stat().st_size > 5000
    assert run("sensitivity", FORTE, *FEW, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert len(facts["local"]) == len(table) and facts["local"][0]["rank"] == 1


def test_morris_and_sobol_go_on_from_what_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], undrawn: None
) -> None:
    out = tmp_path / "study"
    study = ["sensitivity", FORTE, *FEW, "--u", "friction=0.05", "--morris", "3", "--sobol", "8", "--workers", "1"]
    assert run(*study, "--out", str(out)) == 0
    text = capsys.readouterr().out
    assert "Morris: mean size" in text and "Sobol': share of the variance" in text
    morris, sobol = rows(out / "morris.csv"), rows(out / "sobol.csv")
    speed = [r for r in morris if r["quantity"] == "strike_m_per_s"]
    assert [r["parameter"] for r in speed] == ["friction", "hammer.mass"]
    # a linear effect: u x the slope of the local table
    assert float(speed[0]["mu_star"]) == pytest.approx(0.05 * 0.0957, rel=0.02)
    assert {r["parameter"] for r in sobol} == {"friction", "hammer.mass"}
    kept = {p.name: p.stat().st_mtime_ns for p in (out / "members").glob("*.npz")}
    assert run(*study, "--out", str(out), "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert {p.name: p.stat().st_mtime_ns for p in (out / "members").glob("*.npz")} == kept
    assert [r["total"] for r in again["sobol"]] == [float(r["total"]) if r["total"] else None for r in sobol]


def test_a_session_or_a_trial_gives_the_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = tmp_path / "try"
    assert run("record", "--trials", "1", "--profile", "forte", "--out", str(session), "--yes", "--json") == 0
    capsys.readouterr()
    for blow in (session, session / "trial_0001.h5"):
        assert run("sensitivity", str(blow), "--parameters", "hammer.mass", "--json") == 0
        facts = json.loads(capsys.readouterr().out)
        assert facts["blow"].endswith("trial_0001.h5")
        assert {row["quantity"] for row in facts["local"]} >= {"strike_m_per_s", "hammer curve"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--parameters", "hammer.mas"], "hammer.mas: no such parameter, law or group; did you mean hammer.mass"),
        (["--parameters", "friction", "--morris", "3"], "friction: no declared uncertainty"),
        (["--parameters", "hammer.mass", "--u", "friction=0.1"], "--u: goes with --morris or --sobol"),
        (["--parameters", "hammer.mass", "--sobol", "100"], "found 100, allowed a power of 2"),
        (["--parameters", "hammer.mass", "--morris", "1"], "found 1, allowed 2 to"),
        (["--trial", "2"], "--trial 2: goes with a session"),
        (["--parameters", " , "], "parameters: found none"),
        (["--parameters", "shank.frequency_hz"], "shank.frequency_hz: no effect in this scene"),
        (["--parameters", "contact12.friction.B1"], "contact12.friction.B1: does nothing in this blow"),
        (["--parameters", "contact12", "--set", "contact12=0"], "contact12: all its values are 0"),
        (["--parameters", "hammer.mass", "--set", "hammer.pivot.y=nan"], "hammer.pivot.y"),
        (["--parameters", "hammer.mass", "--morris", "2", "--workers", "0"], "--workers 0: allowed 1 or more"),
        (["--parameters", "hammer.parent"], "hammer.parent: is fixed by the geometry"),
        (["--parameters", "contact04.second.normal.x"], "one component of a direction of length 1"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_writes_nothing(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("sensitivity", FORTE, *options, "--out", str(tmp_path / "out")) in (2, 3)
    told = capsys.readouterr().err.strip()
    assert words in told and "Traceback" not in told and len(told.splitlines()[-1]) < 400
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.processor
def test_a_set_without_a_rest_state_is_one_line_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    floating = ["--parameters", "hammer.mass", "--set", "gravity.g=0"]
    assert run("sensitivity", FORTE, *floating, "--out", str(tmp_path / "out")) == 1  # as `simulate` says it
    told = capsys.readouterr().err.strip().splitlines()
    assert told == [f"pianorig: {NO_REST}"]
    assert not list(tmp_path.glob("out/*"))


def test_a_trial_without_a_force_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    session = Path(__file__).parents[3] / "sessions" / "kawai_kg3c"
    assert run("sensitivity", str(session), "--parameters", "hammer.mass") == 2
    assert "no force was recorded, positions only; give a trial with a force" in capsys.readouterr().err


def test_a_cluster_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    monkeypatch.setattr("pianorig.workflows.cluster.TIMEOUT_S", 0.5)
    words = ["--parameters", "hammer.mass", "--morris", "2", "--cluster"]
    assert run("sensitivity", FORTE, *words, "tcp://127.0.0.1:1", "--out", str(tmp_path / "out")) == 2
    assert not list(tmp_path.glob("out/*"))
    assert "--cluster tcp://127.0.0.1:1: no scheduler answers" in capsys.readouterr().err


@pytest.mark.slow  # starts a scheduler and two processes
def test_a_cluster_gives_the_numbers_of_this_computer(capsys: pytest.CaptureFixture[str]) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    study = ["sensitivity", FORTE, "--parameters", "hammer.mass,key.mass", "--morris", "2", "--json"]
    assert run(*study) == 0
    here = json.loads(capsys.readouterr().out)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        assert run(*study, "--cluster", cluster.scheduler_address) == 0
    assert json.loads(capsys.readouterr().out)["morris"] == here["morris"]


def test_a_scheduler_that_is_lost_midway_prints_no_traceback_of_dask(caplog: pytest.LogCaptureFixture) -> None:
    log = logging.getLogger("distributed.client")
    before = log.level
    with _quiet():
        log.error("Traceback")
    assert not caplog.records and log.level == before
