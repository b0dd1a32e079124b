"""The README's commands change no tracked file, and the files of ``pianorig examples`` are what they are for."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

import model
import rig
from pianorig.workflows import EXAMPLES
from tests.command_line import run
from tests.test_docs import commands_of

ROOT = Path(__file__).parents[2]
WRITES = ("--out", "--figure", "--animation")


def test_commands_of_the_readme_write_nothing_that_git_tracks() -> None:
    """`.ci/pages` runs them in a clone; here it is asked where they write: their files, and caches of sessions."""
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    lines = [words for words, is_complete in commands_of((ROOT / "README.md").read_text("utf-8")) if is_complete]
    written = {
        Path(place) for words in lines for option, place in zip(words, words[1:], strict=False) if option in WRITES
    }
    assert len(written) > 8 and not written & {
        folder for name in tracked for folder in (Path(name), *Path(name).parents)
    }
    sessions = {word for words in lines for word in words if f"{word}/session.toml" in tracked}
    assert sessions <= EXAMPLES.keys()  # what the README reads and does not make comes with the package
    caches = [f"{session}/derived/{cache}/some.h5" for session in sessions for cache in ("predictions", "events")]
    ignored = subprocess.run(
        ["git", "check-ignore", *caches], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert ignored.split() == caches


def test_an_example_of_every_kind_is_read_by_what_it_is_for_and_none_is_written_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("examples", ".") == 0
    for name in ("planted_faults", "kawai_kg3c"):
        shipped = {trial.number: trial.sha256 for trial in rig.open_session(ROOT / "sessions" / name)}
        assert shipped and {t.number: t.sha256 for t in rig.open_session(f"sessions/{name}")} == shipped
    assert model.load_action("sessions/kawai_kg3c/identified.toml").identification
    assert run("record", "--dry-run", "--rig", "my_rig.toml") == 0
    assert run("record", "--dry-run", "--plan", "plan.toml") == 0
    assert run("import", "lab.csv", "--mapping", "lab.toml", "--out", "sessions/lab") == 0
    felt = ("felt.csv", "--contact", "contact02", "--force", "force.csv", "--out", "mine.toml")
    assert run("calibrate", "felt", *felt) == 0
    assert run("simulate", "--key-motion", "key.csv", "--from-rest", "--out", "force_of_key.csv") == 0
    capsys.readouterr()
    Path("force.csv").unlink()
    assert run("examples", ".") == 2
    assert "recorded_force.csv: is there already" in capsys.readouterr().err
    assert not Path("force.csv").exists()
