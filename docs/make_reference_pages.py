"""Write the reference pages of the site from the code: public names, commands, parameters, fields of results.json.

``docs/conf.py`` calls `write` at every build; by hand:  python docs/make_reference_pages.py FOLDER
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

sys.path.insert(0, str(Path(__file__).parent))

import make_results_page

import model
from pianorig import cli
from validation import results_schema

ROOT = Path(__file__).parents[1]
PACKAGES = ("model", "vision", "rig", "validation")
SETS = ("hirschkorn2004", "hirschkorn2004-regulated")


def write(folder: Path) -> None:
    """Write ``api_*.md``, ``commands.md``, ``parameters.md`` and ``results_fields.md`` into a folder, made if need be.

    A page that has not changed keeps its time, so that Sphinx does not read it again.
    """
    pages = {f"api_{face.replace('.', '_')}": _face_page(face) for face in faces()}
    schema = results_schema()
    pages |= {"commands": commands_page(), "parameters": parameters_page()}
    pages |= {"results_fields": make_results_page.fields(schema)}
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.md"):
        if old.stem not in pages:
            old.unlink()
    for name, text in pages.items():
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def faces() -> list[str]:
    """Packages and subpackages that list public names in a stub, dotted, each package before its parts."""
    stubs = (stub for package in PACKAGES for stub in sorted((ROOT / package).rglob("__init__.pyi")))
    return [".".join(stub.parent.relative_to(ROOT).parts) for stub in stubs]


def public_names(face: str) -> tuple[list[str], list[str]]:
    """Return the objects that a face's stub lists, and the submodules."""
    stub = ROOT.joinpath(*face.split("."), "__init__.pyi")
    objects, modules = [], []
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            from_here = node.level == 1 and node.module is None
            (modules if from_here else objects).extend(alias.asname or alias.name for alias in node.names)
    return objects, modules


def _face_page(face: str) -> str:
    objects, modules = public_names(face)
    names = [name for name in objects if not name.startswith("__")]
    lines = [f"# {face}", "", "```{eval-rst}", f".. automodule:: {face}", "   :no-index:", ""]
    lines += [f".. currentmodule:: {face}", "", ".. autosummary::", "", *(f"   {name}" for name in names), ""]
    for name in names:
        lines += _directive(face, name)
    lines += ["```", ""]
    own = [f"{face}.{name}" for name in modules]
    parts = [name for name in faces() if name in own]
    if plain := [name for name in own if name not in parts]:
        lines += ["## Modules", "", "```{eval-rst}"]
        for name in plain:
            lines += [f".. automodule:: {name}", "   :members:", ""]
        lines += ["```", ""]
    return "\n".join(lines)


def _directive(face: str, name: str) -> list[str]:
    module = __import__(face, fromlist=[name])
    found = getattr(module, name)
    if isinstance(found, type):
        above = face.rpartition(".")[0]  # a class that the package above gives out as well is indexed there
        again = bool(above) and getattr(__import__(above, fromlist=[name]), name, None) is found
        return [f".. autoclass:: {name}", "   :members:", *(["   :no-index:"] if again else []), ""]
    if callable(found):
        return [f".. autofunction:: {name}", ""]
    return [f".. py:data:: {name}", "", f"   ``{_short(found)}``", ""]


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(map(str, value))
    if isinstance(value, (tuple, list)):
        return ", ".join(str(getattr(item, "name", item)) for item in value)
    return repr(value)


def commands() -> Iterator[tuple[str, Any, Any]]:
    """Yield every command in the order of ``--help``: its name with that of its group, itself, its context."""
    root = typer.main.get_command(cli.app)
    yield from _below(root, root.make_context("pianorig", [], resilient_parsing=True), "pianorig")


def _below(group: Any, context: Any, title: str) -> Iterator[tuple[str, Any, Any]]:
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if command is None or getattr(command, "hidden", False):
            continue
        own = command.make_context(name, [], parent=context, resilient_parsing=True)
        if hasattr(command, "list_commands"):
            yield from _below(command, own, f"{title} {name}")
        else:
            yield f"{title} {name}", command, own


def commands_page() -> str:
    """Return the reference of all commands, from the same texts that ``--help`` prints."""
    lines = ["# Commands", ""]
    lines += ["Made from the commands' own `--help`. Exit codes: 0 success, 2 bad input, 3 hardware or safety fault,"]
    lines += ["1 defect, 130 stopped by Ctrl-C. A traceback is shown only with `pianorig --debug COMMAND`.", ""]
    for title, command, context in commands():
        lines += [f"## {title}", ""]
        for paragraph in (command.help or "").replace("\b", "").strip().split("\n\n"):
            if "Example:" in paragraph:
                calls = [line.replace("Example:", "").strip() for line in paragraph.strip().splitlines()]
                lines += ["```sh", *calls, "```", ""]
            else:
                lines += [" ".join(paragraph.split()), ""]
        rows = [record for part in command.params if (record := _option(part, context)) is not None]
        lines += ["| option | meaning |", "| --- | --- |", *rows, ""]
    return "\n".join(lines)


def _option(part: Any, context: Any) -> str | None:
    record = part.get_help_record(context)
    if record is None:
        return None
    name, meaning = (" ".join(cell.split()).replace("|", "\\|") for cell in record)
    return f"| `{name}` | {meaning.replace('<', '&lt;').replace('*', '&#42;')} |"


def parameters_page() -> str:
    """Return every parameter path with both built-in values, unit, standard uncertainty and source."""
    printed, regulated = (model.load_action(name) for name in SETS)
    lines = ["# Parameters", ""]
    lines += [
        "Every parameter of an action by its path, for `--set path=value`, made from the files in `model/actions/`"
    ]
    lines += [
        f"and `model/parameters/effects.toml`. *value* is that of `{SETS[0]}`; where `{SETS[1]}` differs, its value"
    ]
    lines += [
        "follows in brackets. *u* is the standard uncertainty in the same unit, *basis* says what it rests on.",
        "",
    ]
    sections: dict[str, list[str]] = {}
    for path, quantity in {**printed.quantities, **printed.effects}.items():
        other = {**regulated.quantities, **regulated.effects}[path].value
        value = f"{quantity.value:.6g}" + (f" ({other:.6g})" if other != quantity.value else "")
        cells = (f"`{path}`", value, quantity.unit, f"{quantity.u:.2g}", quantity.basis, quantity.source)
        sections.setdefault(path.split(".")[0], []).append("| " + " | ".join(cells) + " |")
    for section, rows in sections.items():
        text = printed.structure.get(f"{section}.description", "")
        lines += [f"## {section}", "", *([f"{text}.", ""] if text else [])]
        lines += ["| path | value | unit | u | basis | source |", "| --- | ---: | --- | ---: | --- | --- |", *rows, ""]
    return "\n".join(lines)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
