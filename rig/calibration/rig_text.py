"""Values changed in the text of a rig file; comments and everything else stay as they are."""

from __future__ import annotations

import re
from collections.abc import Mapping

from rig.errors import RigInputError

Value = str | float | int | tuple[float, float]


def changed(text: str, table: str, values: Mapping[str, Value], *, named: str | None = None) -> str:
    """Return a rig file's text with values of one table set.

    Parameters
    ----------
    table : str
        ``force`` for ``[force]``, ``encoders`` for ``[[encoders]]``.
    named : str, optional
        ``name`` of the table where there are several.

    Raises
    ------
    RigInputError
        When there is no such table.
    """
    heads = list(re.finditer(r"(?m)^\[\[?[^\[\]]+\]\]?[^\n]*$", text))
    for head, following in zip(heads, [*heads[1:], None], strict=True):
        end = len(text) if following is None else following.start()
        body = text[head.end() : end]
        if head.group(0).split("]")[0].strip("[ ") != table:
            continue
        if named is not None and not re.search(rf'(?m)^\s*name\s*=\s*"{re.escape(named)}"', body):
            continue
        for key, value in values.items():
            body = _set(body, key, _written(value))
        return text[: head.end()] + body + text[end:]
    raise RigInputError(f"rig file: has no table [{table}]" + (f" named {named}" if named else ""))


def _written(value: Value) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, tuple):
        return "[" + ", ".join(repr(float(one)) for one in value) + "]"
    return repr(value)


def _set(body: str, key: str, value: str) -> str:
    """Replace a value up to its comment, or add the line below the table's head."""
    line = re.compile(
        rf'(?m)^({re.escape(key)}\s*=\s*)("(?:[^"\\\n]|\\.)*"|\[[^\]\n]*\]|\{{[^}}\n]*\}}|[^#\n]*?)(\s*(?:#.*)?)$'
    )
    if line.search(body):
        return line.sub(lambda match: match[1] + value + match[3], body, count=1)
    return f"\n{key} = {value}{body}"
