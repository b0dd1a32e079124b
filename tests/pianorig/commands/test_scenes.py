"""``--scene`` means the same in every command that asks an action something."""

from __future__ import annotations

from pathlib import Path

import pytest

import model
from tests.command_line import run

BLOW = "time_s,force_n\n0,0\n0.02,5\n0.12,5\n"


@pytest.fixture
def force(tmp_path: Path) -> Path:
    path = tmp_path / "force.csv"
    path.write_text(BLOW, encoding="utf-8")
    return path


def test_an_action_file_takes_its_scene_through_simulate(tmp_path: Path, force: Path, capsys) -> None:
    own = tmp_path / "lifting.toml"
    model.write_action(model.load_scene("lifting-key").on(model.load_action()), own)
    blows = []
    for name, options in (("own", ["--action", str(own)]), ("named", ["--scene", "lifting-key"])):
        out = tmp_path / f"{name}.csv"
        assert run("simulate", "--force", str(force), *options, "--out", str(out)) == 0
        blows.append(out.read_text(encoding="utf-8").splitlines()[-1])
    assert blows[0] == blows[1] and len(blows[0].split(",")) == 13
    assert run("simulate", "--force", str(force), "--action", str(own), "--scene", "whole", "--out", str(out)) == 0
    assert len(out.read_text(encoding="utf-8").splitlines()[-1].split(",")) == 11


def test_derivatives_and_variants_are_of_the_scene(force: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []

    def ask(action: model.Action, *given: object, **options: object) -> None:
        asked.append(action.scene)
        raise model.InputError("asked")

    for function in ("model.sensitivities", "model.study.compare"):  # which compile a scene that nothing else needs
        monkeypatch.setattr(function, ask)
    assert run("sensitivity", force, "--scene", "lifting-key", "--parameters", "balance_rail,hammer.mass") == 2
    stiff = ("--variant", "stiff: --scale balance_rail=2")
    assert run("study", "variants", "--scene", "lifting-key", "--force", force, *stiff) == 2
    assert asked == [model.load_scene("lifting-key").on(model.load_action()).scene] * 2 != [{}] * 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["touch", "hirschkorn2004", "--scene", "strin"], "scene 'strin': not found; did you mean string?"),
        (["regulate", "hirschkorn2004", "--set", "string.modes=3"], "string.modes is set but the scene has no string"),
    ],
)
def test_what_has_no_meaning_is_refused_in_one_line(words: list[str], said: str, capsys) -> None:
    assert run(*words) == 2
    assert said in capsys.readouterr().err
