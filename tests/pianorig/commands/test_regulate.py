"""``pianorig regulate`` as a user meets it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

import model
from tests.command_line import run


def test_regulate_writes_and_tells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "regulated.toml"
    # a little off the shipped set, so that the command is quick
    assert (
        run("regulate", "hirschkorn2004-regulated", "--set", "contact08.second.y=0.066", "--out", str(out), "--json")
        == 0
    )
    facts = json.loads(capsys.readouterr().out)
    rows = {row["target"]: row for row in facts["targets"]}
    assert rows["let_off"]["before_m"] > 1.2e-3
    assert all(abs(row["after_m"] - row["wanted_m"]) < 2e-5 for row in rows.values())
    assert rows["let_off"]["path"] == "contact08.second.y"
    assert model.load_action(out)["contact08.second.y"] == pytest.approx(0.066 + rows["let_off"]["turned_m"])
    assert [p.name for p in tmp_path.iterdir()] == ["regulated.toml"]


def test_another_length_may_be_wanted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "soft.toml"
    assert run("regulate", "hirschkorn2004-regulated", "--target-mm", "let_off=1.5", "--out", out, "--json") == 0
    rows = {row["target"]: row for row in json.loads(capsys.readouterr().out)["targets"]}
    assert rows["let_off"]["wanted_m"] == 1.5e-3 and rows["drop"]["wanted_m"] == 3e-3
    assert all(abs(row["after_m"] - row["wanted_m"]) < 2e-5 for row in rows.values())
    soft = model.load_action(out)
    assert abs(model.regulation.measure(soft).value_m["let_off"] - 1.5e-3) < 2e-5
    assert "let-off 1.5 mm, as asked for" in soft.quantities["contact08.second.y"].source
    assert "let-off 1.5 mm" in soft.description and "but let-off 1.5 mm" in out.read_text("utf-8").splitlines()[0]


def test_without_out_it_measures(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("regulate", "hirschkorn2004") == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 8 and "let-off" in lines[5] and lines[5].split()[-2:] == ["1.00", "12.11"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["hirschkorn2004", "--out", "o.csv"], "o.csv: ending found '.csv', allowed .toml"),
        (["hirschkorn2004", "--out", "no_such_folder/o.toml"], "folder no_such_folder does not exist"),
        (["steinway", "--out", "o.toml"], "action 'steinway': not found; built in: hirschkorn2004"),
        (["hirschkorn2004", "--target-mm", "letoff=1.5"], "'letoff': unknown; did you mean let_off"),
        (["hirschkorn2004", "--target-mm", "let_off=0.0015"], "let_off: found 0.0015 mm, allowed 0.2 to 20 mm"),
        (["hirschkorn2004", "--target-mm", "let_off"], "allowed name=mm, for example let_off=1.5"),
    ],
)
def test_what_cannot_be_done_is_one_line(arguments: list[str], words: str, refused: Callable[..., None]) -> None:
    refused(words, "regulate", *arguments)
