"""Write a parameter set as a TOML file that `load_action` reads back to the same numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from model.errors import InputError
from model.files.atomic_write import whole_file
from model.parameters.action import SCENE, Action, ActionLike, added_defaults, as_action


def _text(value: str) -> str:
    plain = value.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in plain) + '"'


def action_text(action: Action, comment: Sequence[str] = ()) -> str:
    """The TOML text of an action; ``comment`` lines come first."""
    lines = [f"# {line}".rstrip() for line in comment]
    lines += ["", f"name = {_text(action.name)}", f"description = {_text(action.description)}"]
    tables: dict[str, list[str]] = {}
    for path, text in action.structure.items():
        table, _, rest = path.partition(".")
        if rest:
            tables.setdefault(table, []).append(f"{rest} = {_text(text)}")
    usual = added_defaults()
    own = {path: q for path, q in action.effects.items() if q != usual[path]}
    for path, q in (*action.quantities.items(), *own.items()):
        table, _, rest = path.partition(".")
        tables.setdefault(table, []).append(
            f"{rest} = {{ value = {float(q.value)!r}, unit = {_text(q.unit)}, u = {float(q.u)!r}, "
            f"basis = {_text(q.basis)}, source = {_text(q.source)} }}"
        )
    if action.scene:
        lists = (f"{key} = [{', '.join(map(_text, names))}]" for key, names in action.scene.items())
        tables[SCENE] = [*lists]
    for table, rows in tables.items():
        lines += ["", f"[{table}]", *rows]
    return "\n".join(lines) + "\n"


def write_action(action: ActionLike, path: str | Path, comment: Sequence[str] = ()) -> None:
    """Write an action to a TOML file, whole or not at all.

    Parameters
    ----------
    action : parameter set
    path : file to write, ending in .toml
    comment : lines for its head

    Raises
    ------
    InputError : another ending, or the file cannot be written

    Examples
    --------
    >>> import model
    >>> heavier = model.load_action("hirschkorn2004", {"hammer.mass": 0.012})
    >>> model.write_action(heavier, "heavier.toml", ["a heavier hammer"])
    >>> model.load_action("heavier.toml")["hammer.mass"]
    0.012
    """
    action = as_action(action)
    target = Path(path)
    if target.suffix != ".toml":
        raise InputError(f"{target}: ending found {target.suffix!r}, allowed .toml")
    with whole_file(target) as part:
        part.write_text(action_text(action, comment), encoding="utf-8", newline="\n")
