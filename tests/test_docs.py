"""Pages: every command parses, the code of tutorials runs, links and named files exist; made pages are up to date."""

from __future__ import annotations

import importlib.util
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer

from pianorig import cli, commands

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "sessions/README.md")] + [
    page for page in sorted(DOCS.rglob("*.md")) if not {"_build", "generated"} & set(page.parts)
]
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)#\s]*)(?:#([^)\s]+))?")
OWN_FILE = re.compile(
    r"(?<![\w/.-])((?:model|vision|rig|validation|pianorig|tests|benchmarks|examples|docs|\.ci)/[\w./-]*\w)"
)
BLOCK = re.compile(r"^ *```.*?^ *```", re.MULTILINE | re.DOTALL)
SHELL = re.compile(r"^ *```sh.*?\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"(?<!`)`(pianorig [a-z-][^`]*)`(?!`)")
PROGRAM: Any = typer.main.get_command(cli.app)


def script(name: str) -> ModuleType:
    """A script of the folder ``docs``, as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def commands_of(text: str) -> Iterator[tuple[list[str], bool]]:
    """Words of every command without ``pianorig``, and whether it stands in a block, where it must be complete."""
    for block in SHELL.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            for part in shlex.join(shlex.split(line, comments=True)).split("'&&'"):
                words = shlex.split(part)
                if words[:1] == ["pianorig"]:
                    yield words[1:], True
    for line in INLINE.findall(BLOCK.sub("", text)):
        yield [word for word in shlex.split(line)[1:] if word != "…"], False


def parse_command(words: list[str], is_complete: bool) -> None:
    """Parse a command line as ``pianorig`` does; raises for a command or an option that does not exist."""
    line, rest, group = f"pianorig {' '.join(words)}", list(words), PROGRAM
    if rest[0].startswith("-"):
        assert rest[0] in {option for part in PROGRAM.params for option in part.opts}, line
        return
    context = PROGRAM.make_context("pianorig", [], resilient_parsing=True)
    while hasattr(group, "get_command") and rest:
        name = rest.pop(0)
        group = group.get_command(context, name)
        assert group is not None, f"{line}: {name} does not exist"
        if hasattr(group, "get_command"):
            context = group.make_context(name, [], parent=context, resilient_parsing=True)
    try:
        group.make_context(words[0], rest, parent=context)
    except Exception as error:
        if is_complete or type(error).__name__ not in ("MissingParameter", "BadOptionUsage"):
            raise AssertionError(f"{line}: {error}") from error


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_command_in_a_page_parses(page: Path) -> None:
    for words, is_complete in commands_of(page.read_text(encoding="utf-8")):
        parse_command(words, is_complete)


def test_every_command_has_an_example_in_its_help_that_parses() -> None:
    sys.path.insert(0, str(DOCS))
    try:
        text = script("make_reference_pages").commands_page()
    finally:
        sys.path.remove(str(DOCS))
    examples = [words for words, is_complete in commands_of(text) if is_complete]
    for name in commands.full_names():
        assert any(words[: len(name.split())] == name.split() for words in examples), name
    for words in examples:
        parse_command(words, True)


def headings(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub and MyST name them."""
    titles = re.findall(r"^#+ (.+)$", BLOCK.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


def test_links_resolve() -> None:
    missing = []
    for page in PAGES:
        for target, anchor in LINK.findall(BLOCK.sub("", page.read_text(encoding="utf-8"))):
            file = page.parent / target if target else page
            if not file.exists() or (anchor and anchor not in headings(file)):
                missing.append(f"{page.name}: {target}#{anchor}")
    assert not missing


def test_files_that_pages_and_code_name_exist() -> None:
    folders = ("model", "vision", "rig", "validation", "pianorig", "benchmarks", "examples", "tests", "docs")
    code = [path for folder in folders for ending in ("py", "toml") for path in (ROOT / folder).rglob(f"*.{ending}")]
    named = {(page.name, name) for page in PAGES for name in OWN_FILE.findall(page.read_text(encoding="utf-8"))}
    for path in [*code, ROOT / "pyproject.toml"]:
        named |= {(path.name, page) for page in re.findall(r"docs/[\w/-]+\.md", path.read_text(encoding="utf-8"))}
    missing = [one for one in named if not (ROOT / one[1]).exists() and not list(ROOT.glob(one[1] + "*"))]
    assert not [one for one in missing if not one[1].startswith("docs/_build")]


@pytest.mark.parametrize("name", ["first_blow", "own_film", "regulate_and_feel"])
def test_tutorials_run_and_print_what_they_show(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made, page = script("run_pages"), DOCS / "tutorials" / f"{name}.md"
    monkeypatch.chdir(tmp_path)
    assert made.outputs(made.run(page)) == made.outputs(page.read_text(encoding="utf-8"))


def test_the_glossary_has_each_term_once_and_names_that_exist() -> None:
    page = (DOCS / "glossary.md").read_text(encoding="utf-8")
    packages = ("model", "rig", "vision", "validation", "pianorig")
    files = [file for package in packages for file in (ROOT / package).rglob("*.py")]
    words = {word for file in files for word in re.findall(r"\w+", file.read_text(encoding="utf-8"))}
    rows = [[cell.strip() for cell in line.split(" | ")] for line in page.splitlines() if line.startswith("| ")]
    terms = [row[0].removeprefix("| ") for row in rows if row[0] != "| term"] + re.findall(r"^(.+)\n: ", page, re.M)
    assert len(terms) > 100 and sorted(set(terms)) == sorted(terms)
    for name in (name for row in rows for name in re.findall("`([^`]+)`", row[-1])):
        if "/" in name:
            assert any((ROOT / part / name).exists() for part in ("", *packages)), name
        else:
            for part in name.split("."):
                begins = part.endswith("_") and any(word.startswith(part) for word in words)
                assert begins or words >= set(re.findall(r"\w+", part)), name


def test_the_architecture_is_drawn_from_todays_imports() -> None:
    made = script("make_architecture")
    for package in made.PACKAGES:
        drawn = made.picture(package).read_text(encoding="utf-8")
        assert drawn == made.draw(package), "run: python docs/make_architecture.py"
    assert made.PAGE.read_text(encoding="utf-8") == made.page(), "run: python docs/make_architecture.py"


def test_every_dependency_is_listed_with_its_licence() -> None:
    made = script("make_licences_page")
    listed = re.findall(r"^- (\S+) \((.+?)\): (.+)$", made.PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    needed = {name: ", ".join(groups) for name, groups in made.dependencies().items()}
    assert {name: groups for name, groups, _ in listed} == needed, "run: python docs/make_licences_page.py"
    assert all(stated for _, _, stated in listed)
