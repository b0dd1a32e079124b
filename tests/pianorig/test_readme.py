"""The README's commands run as they stand in a clone, and the files of ``pianorig examples`` are what they are for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.command_line import run
from tests.test_docs import commands_of

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_commands_of_the_readme_change_no_tracked_file_of_a_clone(tmp_path: Path) -> None:
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", "--no-hardlinks", str(ROOT), str(clone)], check=True)
    for words, is_complete in commands_of((clone / "README.md").read_text("utf-8")):
        if is_complete:
            done = subprocess.run([sys.executable, "-m", "pianorig", *words], cwd=clone, capture_output=True)
            assert done.returncode == 0, (words, done.stderr.decode("utf-8"))
    changed = subprocess.run(
        ["git", "status", "--porcelain", "--untracked-files=no"], cwd=clone, capture_output=True, text=True, check=True
    )
    assert changed.stdout == ""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files of ``pianorig examples``."""
    monkeypatch.chdir(tmp_path)
    assert run("examples", ".") == 0
    return tmp_path


def test_examples_refuse_to_write_over_a_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    (folder / "force.csv").unlink()
    assert run("examples", ".") == 2
    assert "recorded_force.csv: is there already" in capsys.readouterr().err
    assert not (folder / "force.csv").exists()


def test_an_example_of_every_kind_is_read_by_what_it_is_for(folder: Path) -> None:
    assert run("record", "--dry-run", "--rig", "my_rig.toml") == 0
    assert run("record", "--dry-run", "--plan", "plan.toml") == 0
    assert run("import", "lab.csv", "--mapping", "lab.toml", "--out", "sessions/lab") == 0
    felt = ("felt.csv", "--contact", "contact02", "--force", "force.csv", "--out", "mine.toml")
    assert run("calibrate", "felt", *felt) == 0
    assert run("simulate", "--key-motion", "key.csv", "--from-rest", "--out", "force_of_key.csv") == 0
