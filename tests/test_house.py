"""The structure of the packages: no import circles, few parameters, and a late import says why."""

from __future__ import annotations

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("pianorig", "validation", "rig", "model", "vision")
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
SCRIPTS = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.js"))
SCRIPT_IMPORT = re.compile(r'import \{ (\w+(?:, \w+)*) \} from "\./(\w+)\.js";')
SCRIPT_EXPORT = re.compile(r"export (?:async )?(?:function|class|const) (\w+)\b")
FIRST_SCRIPTS = {"animation", "bench"}
"""Modules that a page of HTML begins with, so that no other imports them."""


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    """Every import of the five packages, also inside functions and under ``TYPE_CHECKING``."""
    return grimp.build_graph(*PACKAGES, cache_dir=None)


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


@cache
def functions() -> list[tuple[Path, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Every function of the packages, with its file."""
    kinds = ast.FunctionDef | ast.AsyncFunctionDef
    nodes = ((path, node) for path in FILES for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    return [(path, node) for path, node in nodes if isinstance(node, kinds)]


def test_imports_inside_functions_give_their_reason() -> None:
    silent = []
    for path, function in functions():
        for node in ast.walk(function):
            if isinstance(node, ast.Import | ast.ImportFrom):
                lines = path.read_text(encoding="utf-8").splitlines()
                row = node.lineno - 1
                while row and lines[row - 1].lstrip().startswith(("import ", "from ")):
                    row -= 1  # one reason serves a block of imports
                reason = lines[row - 1].strip() + lines[node.lineno - 1]
                if "# start-up:" not in reason and "# platform:" not in reason:
                    silent.append(f"{path.relative_to(ROOT).as_posix()}:{node.lineno}")
    assert silent == []


def script_imports(texts: dict[str, str]) -> dict[str, list[tuple[str, str]]]:
    """Module and name of each import of each JavaScript module, of texts by module name; one form is allowed."""
    found: dict[str, list[tuple[str, str]]] = {}
    for module, text in texts.items():
        said = [SCRIPT_IMPORT.fullmatch(line) for line in text.splitlines() if re.match(r"\s*import\b", line)]
        if None in said or re.search(r"\bimport\s*\(", text):
            raise ValueError(f'{module}: an import that is not of the form  import {{ name }} from "./module.js";')
        found[module] = [(match[2], name) for match in said if match for name in match[1].split(", ")]
    return found


def script_faults(texts: dict[str, str]) -> list[str]:
    """What is wrong between JavaScript modules, of texts by module name; names come from where they are defined."""
    imports = script_imports(texts)
    exports: set[tuple[str, str]] = set()
    faults = []
    for module, text in texts.items():
        for line in text.splitlines():
            if re.match(r"\s*export\b", line):
                given = SCRIPT_EXPORT.match(line)
                if given is None:
                    faults.append(f"{module} hands on what it does not define: {line}")
                else:
                    exports.add((module, given[1]))
    between = {module: {source for source, _ in names} for module, names in imports.items()}
    faults += [f"circle {' '.join(around)}"] if (around := circle(between)) else []
    for module, names in imports.items():
        faults += [
            f"{module} imports {name}, not exported by {source}"
            for source, name in names
            if (source, name) not in exports
        ]
    imported = {one for names in imports.values() for one in names}
    return faults + [f"nobody imports {name} of {module}" for module, name in sorted(exports - imported)]


def test_scripts_have_no_circle_and_no_name_too_many_or_too_few() -> None:
    modules = [path for path in SCRIPTS if path.parent.name == "web"]
    texts = {path.stem: path.read_text(encoding="utf-8") for path in modules}
    assert len(texts) == len(modules) > 20  # the page serves both folders as one
    assert script_faults(texts) == []
    between = {module: {source for source, _ in names} for module, names in script_imports(texts).items()}
    assert set(texts) - set().union(*between.values()) == FIRST_SCRIPTS
    player = {path.stem for path in modules if path.parts[-3] == "player"}
    assert set().union(*(between[module] for module in player)) <= player  # an exported animation has only these
