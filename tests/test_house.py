"""The house stays livable: no import circles, every folder says what it is, a late import says why."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("pianorig", "validation", "rig", "model", "vision")
FOLDERS = sorted({path.parent for package in PACKAGES for path in (ROOT / package).rglob("*.py")})
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    """Every import of the five packages, also inside functions and under ``TYPE_CHECKING``."""
    return grimp.build_graph(*PACKAGES, cache_dir=None)


def is_face(module: str) -> bool:
    """Is this a package's ``__init__``, which hands on names and is imported by no module of its own package?"""
    return (ROOT / Path(*module.split(".")) / "__init__.py").exists()


def circle(imports: dict[str, set[str]]) -> list[str]:
    """One circle of imports; empty where there is none."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_circle_among_files(graph: grimp.ImportGraph) -> None:
    imports = {m: set(graph.find_modules_directly_imported_by(m)) for m in graph.modules}
    assert circle(imports) == []


def test_no_circle_among_folders(graph: grimp.ImportGraph) -> None:
    for parent in sorted(module for module in graph.modules if graph.find_children(module)):
        between: dict[str, set[str]] = {child: set() for child in graph.find_children(parent)}
        for child in between:
            inside = {child, *graph.find_descendants(child)}
            for imported in {m for module in inside for m in graph.find_modules_directly_imported_by(module)} - inside:
                if imported.startswith(parent + "."):
                    between[child].add(".".join(imported.split(".")[: parent.count(".") + 2]))
        assert circle(between) == [], parent


def test_no_module_imports_its_own_packages_face(graph: grimp.ImportGraph) -> None:
    for package in PACKAGES:
        importers = graph.find_modules_that_directly_import(package)
        assert not [m for m in importers if m.startswith(package + ".")], package


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_folder_says_what_it_holds(folder: Path) -> None:
    said = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    assert len(said.split()) >= 8, f"{folder.name}: its __init__ does not say what lives there"


def test_imports_inside_functions_give_their_reason() -> None:
    silent = []
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        lines = text.splitlines()
        for function in ast.walk(ast.parse(text)):
            if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            for node in ast.walk(function):
                if isinstance(node, ast.Import | ast.ImportFrom):
                    row = node.lineno - 1
                    while row and lines[row - 1].lstrip().startswith(("import ", "from ")):
                        row -= 1  # one reason serves a block of imports
                    reason = lines[row - 1].strip() + lines[node.lineno - 1]
                    if "# start-up:" not in reason and "# platform:" not in reason:
                        silent.append(f"{path.relative_to(ROOT).as_posix()}:{node.lineno}")
    assert silent == []
