"""Commands of README, pages and ``--help`` run from their own text, on the files of ``pianorig examples``."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pianorig import commands
from tests.command_line import run
from tests.documented_commands import commands_of, is_quick, run_documented

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if not {"_build", "generated"} & set(page.parts)]
PAGES = [page for page in PAGES if list(commands_of(page.read_text("utf-8")))]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a reader stands: the examples beside a clone's sessions."""
    monkeypatch.chdir(tmp_path)
    assert run("examples", ".") == 0
    for name in ("planted_faults", "kawai_kg3c"):
        shutil.copytree(ROOT / "sessions" / name, tmp_path / "sessions" / name)
    return tmp_path


@pytest.mark.slow  # scenes of several pages are compiled
def test_quick_commands_of_all_pages_run_as_they_stand(folder: Path) -> None:
    shutil.copytree(ROOT / "sessions" / "example_forte", folder / "sessions" / "try")
    ran: list[list[str]] = []
    for words in (words for page in PAGES for words in commands_of(page.read_text("utf-8"))):
        if words not in ran and is_quick(words, folder):  # what two pages say is run once: files are not written over
            assert run(*words, *(["--no-show"] if words[0] == "open" else [])) == 0, words
            ran.append(words)
    assert len({words[0] for words in ran}) >= 3, ran


@pytest.mark.slow
def test_commands_of_the_readme_change_no_tracked_file_of_a_clone(tmp_path: Path) -> None:
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", "--no-hardlinks", str(ROOT), str(clone)], check=True)
    run_documented(["examples", "."], clone)
    for words in commands_of((clone / "README.md").read_text("utf-8")):
        run_documented(words, clone)
    changed = subprocess.run(
        ["git", "status", "--porcelain", "--untracked-files=no"], cwd=clone, capture_output=True, text=True, check=True
    )
    assert changed.stdout == ""


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES[1:], ids=lambda page: page.stem)
def test_all_commands_of_a_page_run_as_they_stand_one_after_the_other(page: Path, folder: Path) -> None:
    text = page.read_text("utf-8")
    if "--out sessions/try" not in text:  # a page that goes on with the README's session
        run_documented(["record", "--trials", "3", "--film", "1", "--out", "sessions/try"], folder)
    for words in commands_of(text):
        run_documented(words, folder)


def helps() -> str:
    """The examples of every command's help, as the reference shows them."""
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        return str(importlib.import_module("make_reference_pages").commands_page())
    finally:
        sys.path.pop(0)


def test_every_command_has_an_example_in_its_help() -> None:
    assert {words[0] for words in commands_of(helps())} == set(commands.COMMANDS)


LONG = ("validate", "identify")
"""Commands whose examples take a minute or two."""


@pytest.mark.slow  # every command once: a few minutes
@pytest.mark.parametrize("part", [*LONG, "others"])
def test_all_examples_of_the_helps_run_as_they_stand(folder: Path, part: str) -> None:
    first = ["record", "demo", "annotate"]  # others use what these make
    learned = "learned/forte/profile.toml"  # what another example makes

    def rank(words: list[str]) -> int:
        if words[0] == "open":  # the report that an example of validate writes
            return len(first) + 1
        return first.index(words[0]) if words[0] in first and learned not in words else len(first)

    for words in sorted(commands_of(helps()), key=rank):
        of = words[0] if words[0] in LONG else "validate" if words[0] == "open" else "others"
        if of == part or rank(words) == 0:
            run_documented(words, folder)


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
    assert (
        run("calibrate-felt", "felt.csv", "--contact", "contact02", "--force", "force.csv", "--out", "mine.toml") == 0
    )
    assert run("simulate", "--key-motion", "key.csv", "--from-rest", "--out", "force_of_key.csv") == 0
