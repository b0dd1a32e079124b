"""Pages and pictures that are made by a script are as the script makes them today."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import is_typeddict

import pytest
import typer

from pianorig import cli

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"] + [
    page for page in sorted(DOCS.rglob("*.md")) if not {"_build", "generated"} & set(page.parts)
]
PAGES_WITH_CODE = {
    "first_blow", "own_film", "regulate_and_feel", "cluster", "regulate", "odd_trial", "inner_forces",
    "which_parameters", "identify", "drive_the_motor",
}  # fmt: skip
LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)#\s]+)")
OWN_FILE = re.compile(
    r"(?<![\w/.-])((?:model|vision|rig|validation|pianorig|tests|benchmarks|examples|docs|\.ci)/[\w./-]*\w)"
)
SHELL = re.compile(r"^ *```sh\n(.*?)^ *```", re.MULTILINE | re.DOTALL)


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_architecture_is_drawn_from_todays_imports() -> None:
    made = script("make_architecture")
    for package in made.PACKAGES:
        drawn = made.picture(package).read_text(encoding="utf-8")
        assert drawn == made.draw(package), "run: python docs/make_architecture.py"
    assert made.PAGE.read_text(encoding="utf-8") == made.page(), "run: python docs/make_architecture.py"


def test_code_points_to_pages_that_exist() -> None:
    folders = ["model", "vision", "rig", "validation", "pianorig", "benchmarks", "examples", "tests", "docs"]
    files = [path for folder in folders for ending in ("py", "toml") for path in (ROOT / folder).rglob(f"*.{ending}")]
    missing = [
        f"{path.relative_to(ROOT).as_posix()}: {page}"
        for path in [*files, ROOT / "pyproject.toml"]
        for page in re.findall(r"docs/[\w/-]+\.md", path.read_text(encoding="utf-8"))
        if not (ROOT / page).exists()
    ]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_files_named_in_a_page_exist(page: Path) -> None:
    named = OWN_FILE.findall(page.read_text(encoding="utf-8"))
    missing = [name for name in named if not (ROOT / name).exists() and not list(ROOT.glob(name + "*"))]
    assert not [name for name in missing if not name.startswith("docs/_build")], f"{page.name}: {missing}"


def test_every_dependency_is_listed_with_its_licence() -> None:
    made = script("make_licences_page")
    listed = re.findall(r"^\| (\S+) \| (.+?) \| (.+?) \|$", made.PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    needed = {name: ", ".join(groups) for name, groups in made.dependencies().items()}
    assert {name: groups for name, groups, _ in listed[2:]} == needed, "run: python docs/make_licences_page.py"
    assert all(stated for _, _, stated in listed)


def test_the_readme_is_short_and_has_the_two_commands() -> None:
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 100
    assert "python -m pip install -e . && pianorig demo" in lines
    assert 'python -m pip install -e ".[dev]" && python -m pytest' in lines


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    missing = [target for target in LINK.findall(text) if not (page.parent / target).exists()]
    assert not missing, f"{page.name}: {missing}"


def shell_lines(text: str) -> list[list[str]]:
    """Calls of ``pianorig`` in the shell blocks of a page, split as a shell would."""
    lines = (line for block in SHELL.findall(text) for line in block.splitlines())
    calls = (shlex.split(line, comments=True) for line in lines if line.strip().startswith("pianorig "))
    return [call[1:] for call in calls]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_and_options_in_the_text_exist(page: Path) -> None:
    root = typer.main.get_command(cli.app)
    for call in shell_lines(page.read_text(encoding="utf-8")):
        group, context = root, root.make_context("pianorig", [], resilient_parsing=True)
        while hasattr(group, "get_command"):
            name = call.pop(0)
            command = group.get_command(context, name)
            assert command is not None, f"{page.name}: pianorig {name} does not exist"
            if hasattr(command, "get_command"):
                context = command.make_context(name, [], parent=context, resilient_parsing=True)
            group = command
        group.make_context(name, [word for word in call if word != "…"], parent=context)  # raises for a wrong option


def test_a_wrong_option_in_a_text_is_noticed() -> None:
    root = typer.main.get_command(cli.app)
    context = root.make_context("pianorig", [], resilient_parsing=True)
    with pytest.raises(Exception, match="--profil"):
        root.get_command(context, "record").make_context("record", ["--profil", "forte"], parent=context)


def test_the_reference_has_every_command_and_every_parameter(tmp_path: Path) -> None:
    made = script("make_reference_pages")
    made.write(tmp_path)
    commands = (tmp_path / "commands.md").read_text(encoding="utf-8")
    root = typer.main.get_command(cli.app)
    for name in root.list_commands(root.make_context("pianorig", [], resilient_parsing=True)):
        assert f"## pianorig {name}" in commands
    parameters = (tmp_path / "parameters.md").read_text(encoding="utf-8")
    assert "| `contact04.friction.A` | 0.434 | 1 |" in parameters
    assert "| `contact08.second.y` | " in parameters
    assert "autofunction:: simulate" in (tmp_path / "api_model.md").read_text(encoding="utf-8")


def test_signatures_of_public_names_show_values_and_not_objects() -> None:
    made = script("make_reference_pages")
    for face in made.faces():
        module = importlib.import_module(face)
        for name in made.public_names(face)[0]:
            found = getattr(module, name)
            plain = isinstance(found, type) and (issubclass(found, BaseException) or is_typeddict(found))
            if (inspect.isfunction(found) or inspect.isclass(found)) and not plain:
                signature = str(inspect.signature(found))
                assert " at 0x" not in signature and "np.float64(" not in signature, f"{face}.{name}{signature}"


@pytest.mark.slow  # records, films, regulates: about a minute
@pytest.mark.parametrize("name", sorted(PAGES_WITH_CODE))
def test_pages_run_and_print_what_they_show(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = script("run_pages")
    page = next(page for page in made.pages() if page.stem == name)
    monkeypatch.chdir(tmp_path)
    assert made.outputs(made.run(page)) == made.outputs(page.read_text(encoding="utf-8"))


def test_every_page_with_code_is_run() -> None:
    assert {page.stem for page in script("run_pages").pages()} == PAGES_WITH_CODE


@pytest.mark.slow  # imports every package and writes every page: a minute
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", str(tmp_path / "trees")]
    done = subprocess.run([*command, str(DOCS), str(tmp_path / "html")], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "html" / "reference" / "generated" / "api_model.html").exists()
