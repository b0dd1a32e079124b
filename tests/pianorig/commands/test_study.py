"""``pianorig study`` and ``--scale`` as a user meets them."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import model
from model.parameters.action import find_action
from pianorig.console.overrides import read_variant
from tests.command_line import run
from tests.pianorig.test_commands import DATA

FORTE = str(DATA / "forte_force.csv")


def test_variants_in_one_table_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "study"
    variants = ["--variant", "dry: --scale damping=0.1", "--variant", "slippery check: --set contact04.friction=0"]
    assert run("study", "variants", "--force", FORTE, *variants, "--out", str(out), "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert [row["variant"] for row in facts["variants"]] == ["as given", "dry", "slippery check"]
    assert [row["held"] for row in facts["variants"]] == [True, True, False]
    with open(out / "variants.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["hold_m"]) for row in rows] == [row["hold_m"] for row in facts["variants"]]
    assert sorted(p.name for p in out.iterdir()) == ["study.svg", "variants.csv"]
    assert run("study", "variants", "--force", FORTE, *variants) == 0
    text = capsys.readouterr().out
    assert text.splitlines()[3].startswith("slippery check") and " no " in text.splitlines()[3]


def test_study_thesis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The thesis's variants, on any action: each is what `study variants` makes of it."""
    out, lean = tmp_path / "thesis", ["--action", "hirschkorn2004-regulated"]
    assert run("study", "thesis", *lean, "--out", str(out), "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert [row["variant"] for row in facts["piano"]] == ["as given", "damping x 4.5"]
    assert len(facts["forte"]) == 7 and not facts["forte"][5]["held"]
    assert sorted(p.name for p in out.iterdir()) == ["forte.csv", "forte.svg", "piano.csv", "piano.svg"]
    force = tmp_path / "forte.csv"
    rows = zip(*(column.tolist() for column in model.force_table("thesis-forte")), strict=True)
    force.write_text("time_s,force_n\n" + "".join(f"{t!r},{f!r}\n" for t, f in rows))
    dry = ["--variant", "dry: --scale damping=0.1"]
    assert run("study", "variants", *lean, "--force", str(force), *dry, "--json") == 0
    alone = json.loads(capsys.readouterr().out)["variants"][1]
    assert alone | {"variant": "damping / 10"} == facts["forte"][1]


def test_what_was_typed_once_is_understood(capsys: pytest.CaptureFixture[str]) -> None:
    """`study ACTION`, and `--of` for what is `--action` everywhere."""
    assert run("study", "hirschkorn2004", "--force", FORTE, "--json") == 0
    first = json.loads(capsys.readouterr().out)
    assert run("study", "variants", "--of", "hirschkorn2004", "--force", FORTE, "--json") == 0
    assert json.loads(capsys.readouterr().out) == first
    assert run("study", "thesis", "--help") == 0 and "--of" not in capsys.readouterr().out


def test_scale_on_simulate(tmp_path: Path) -> None:
    out = tmp_path / "angles.csv"
    changes = ["--set", "contact04.friction=0", "--scale", "damping=0.1", "--scale", "*.mass=1.01"]
    assert run("simulate", "--force", FORTE, *changes, "--output-rate", "1000", "--out", str(out)) == 0
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    values = {f"contact{i:02d}.normal.D": 0.1 for i in range(1, 14) if i != 12} | {
        f"{b}.mass": 1.01 for b in model.BODIES
    }
    action = model.load_action()
    changed = action.with_values({p: f * action[p] for p, f in values.items()} | {"contact04.friction": 0})
    force = np.loadtxt(FORTE, delimiter=",", skiprows=1)
    solution = model.simulate(changed, force[:, 0], force[:, 1], output_time_s=rows[:, 0])
    np.testing.assert_array_equal(rows[:, 1:6], solution.angle_rad)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["thesis", "--variant", "a: --set hammer.mass=0.01"], "No such option: --variant"),
        (["variants"], "Missing option '--force'"),
        (["variant"], "No such command 'study variant'. Did you mean 'variants'?"),
        (["joints"], "simulate --scene giving-joints"),
        (["felt-law"], "simulate --set contact02.law=stulov"),
        (["string"], "python examples/thesis string"),
        (["variants", "--force", FORTE, "--variant", "dry"], "--variant 'dry': has no name"),
        (["variants", "--force", FORTE, "--variant", "a: --st x=1"], "--variant a: found '--st'"),
        (["variants", "--force", FORTE, "--variant", "a: --set hammer.mas=1"], "did you mean hammer.mass"),
        (["variants", "--force", FORTE, "--variant", "a: --scale dampin=1"], "did you mean damping"),
        (["variants", "--force", FORTE, "--variant", "a: --set"], "allowed path=value"),
        (["variants", "--force", FORTE, "--variant", "a:"], "changes nothing"),
        (["variants", "--force", FORTE, "--scale", "damping"], "allowed name=factor"),
        (["variants", "--force", FORTE, "--set", "a=1", "--set", "a=2"], "given twice"),
        (["variants", "--force", FORTE, "--out", "no/such/folder"], "folder cannot be made"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(arguments: list[str], words: str, refused: Callable[..., None]) -> None:
    refused(words, "study", *arguments)


@pytest.mark.parametrize(
    "text",
    [
        "a b: --set x.y=1 --scale damping=0.1",
        "a b:--set=x.y=1   --scale=damping=0.1",
        " a b : --scale damping=.1 --set x.y=1",
    ],
)
def test_variant_grammar(text: str) -> None:
    assert read_variant(text) == ("a b", {"x.y": 1.0}, {"damping": 0.1})


def test_a_blow_on_the_key_does_not_drive_a_motor(tmp_path: Path, refused: Callable[..., None]) -> None:
    """Newtons of the built-in table would be taken for the newton metres of the action's scene."""
    own = tmp_path / "own.toml"
    own.write_text(find_action("hirschkorn2004").read_text() + '\n[scene]\neffects = ["motor_arm"]\n')
    refused(
        "driven by torque_nm, allowed one with all bodies driven by force_n", "study", "thesis", "--action", str(own)
    )
