"""``pianorig sensitivity`` as a user meets it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from model.simulation.statics import NO_REST
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
        (["--trial", "2"], "--trial 2: goes with a session"),
        (["--parameters", " , "], "parameters: found none"),
        (["--parameters", "shank.frequency_hz"], "shank.frequency_hz: no effect in this scene"),
        (["--parameters", "contact12.friction.B1"], "contact12.friction.B1: does nothing in this blow"),
        (["--parameters", "contact12", "--set", "contact12=0"], "contact12: all its values are 0"),
        (["--parameters", "hammer.mass", "--set", "hammer.pivot.y=nan"], "hammer.pivot.y"),
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
    if told[0].startswith("differentiating"):  # progress, where kernels are compiled first
        told = told[1:]
    assert told == [f"pianorig: {NO_REST}"]
    assert not list(tmp_path.glob("out/*"))


def test_a_trial_without_a_force_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    session = Path(__file__).parents[3] / "sessions" / "kawai_kg3c"
    assert run("sensitivity", str(session), "--parameters", "hammer.mass") == 2
    assert "no force was recorded, positions only; give a trial with a force" in capsys.readouterr().err
