"""Values of a rig file changed in its text, which otherwise stays as it was written."""

from __future__ import annotations

import re
from collections.abc import Mapping

from rig.configuration.rig_file import Rig, parse_rig
from rig.configuration.toml_file import toml_value
from rig.errors import RigInputError

Value = str | float | int | tuple[float, float]


def change_table(text: str, table: str, values: Mapping[str, Value], *, named: str | None = None) -> str:
    """Return a rig file's text with values, by key, set in the first table ``[table]``, or the ``[[table]]`` whose name
    is ``named``; all else stays as written. RigInputError where there is none."""
    heads = list(re.finditer(r"(?m)^\[\[?[^\[\]]+\]\]?[^\n]*$", text))
    for head, following in zip(heads, [*heads[1:], None], strict=True):
        end = len(text) if following is None else following.start()
        body = text[head.end() : end]
        if head.group(0).split("]")[0].strip("[ ") != table:
            continue
        if named is not None and not re.search(rf'(?m)^\s*name\s*=\s*"{re.escape(named)}"', body):
            continue
        for key, value in values.items():
            body = _set_value(body, key, toml_value(value))
        return text[: head.end()] + body + text[end:]
    raise RigInputError(f"rig file: has no table [{table}]" + (f" named {named}" if named else ""))


def rewrite_table(rig: Rig, table: str, values: Mapping[str, Value], *, named: str | None = None) -> str:
    """Return the text of a rig file with values set as `change_table` does; nothing is written. RigInputError where the
    text would be no valid rig file.

    With values that are there already it tells, before anything is read, whether what is read can be written.
    """
    text = change_table(rig.text, table, values, named=named)
    try:
        parse_rig(text, f"{rig.source} as calibrated")
    except RigInputError as error:
        raise RigInputError(f"{error}; write the keys of [{table}] as  key = value") from None
    return text


def _set_value(body: str, key: str, value: str) -> str:
    """Return the text of one table with ``key`` set to ``value``, which is TOML text, and the comment of its line kept;
    a key that is not there becomes the first."""
    line = re.compile(
        rf'(?m)^([ \t]*{re.escape(key)}\s*=\s*)("(?:[^"\\\n]|\\.)*"|\[[^\]]*\]|\{{[^}}\n]*\}}|[^#\n]*?)(\s*(?:#.*)?)$'
    )
    if line.search(body):
        return line.sub(lambda match: match[1] + value + match[3], body, count=1)
    return f"\n{key} = {value}{body}"
