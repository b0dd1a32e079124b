"""``pianorig touch`` as a user meets it."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command_line import run


def test_two_actions_side_by_side(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure, curve = tmp_path / "touch.svg", tmp_path / "curve.csv"
    names = ["hirschkorn2004", "hirschkorn2004-regulated"]
    assert run("touch", *names, "--figure", str(figure), "--curve", str(curve)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[-2:] == names
    assert max(len(line) for line in lines if str(tmp_path) not in line) <= 80
    table = [line for line in lines[1:] if re.match(r"[a-z].* \(|hammer at", line)]
    assert len(table) < 20
    rows = {line.split(")")[0] + ")": line.split(")")[1].split() for line in table}
    assert [float(x) for x in rows["key dip (mm)"]] == [9.34, 10.0]
    assert rows["down weight (g)"][1] == rows["down weight (g)"][4] == "±"
    said = " ".join(" ".join(lines).split())
    assert said.count("presses the rising hammer") <= 2  # the softest blow of each action
    assert float(rows["fastest repetition (1/s)"][1]) > 1.5 * float(rows["fastest repetition (1/s)"][0])
    with open(curve, newline="") as file:
        table = list(csv.DictReader(file))
    assert {(r["action"], r["way"]) for r in table} == {(n, w) for n in names for w in ("down", "up")}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["curve.csv", "touch.svg"]


def test_the_back_check_is_told_of_once_and_the_larger_forces_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("touch", "hirschkorn2004", "--scale", "friction=0.3", "--scale", "joint_friction=0.3")
    assert run(*arguments, "--json") == 0
    facts = json.loads(capsys.readouterr().out)["actions"][0]
    assert facts["friction weight, g"] < 8.0  # 14.4 g as printed
    loaded = [remark for remark in facts["remarks"] if "presses the rising hammer" in remark]
    assert run(*arguments) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert len(loaded) > 2 and said.count("presses the rising hammer") == 1
    assert f"hirschkorn2004: the check presses it at {len(loaded) - 1} larger forces, too; --json lists them" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["steinway"], "action 'steinway': not found"),
        (["hirschkorn2004", "--figure", "f.jpeg"], "f.jpeg: ending found '.jpeg', allowed .svg"),
        (["hirschkorn2004", "--curve", "c.txt"], "c.txt: ending found '.txt', allowed .csv"),
        (["hirschkorn2004", "--set", "hammer.mas=1"], "did you mean hammer.mass"),
        (["hirschkorn2004", "--set", "contact02.first.y=0.01"], "key dip found"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], words: str, refused: Callable[..., None]) -> None:
    refused(words, "touch", *arguments)
