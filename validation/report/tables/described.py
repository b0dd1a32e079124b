"""Tables that the page shows as ``results.schema.json`` describes them: no code of their own.

An entry of ``tables`` there may have ``page``: its section (id and title), caption and notes, which may name columns of
the first row in braces; and a column of it ``head``, with it a ``factor`` to the unit shown, ``digits`` (3), and the
column ``u`` of its standard uncertainty. Columns without a head are not shown, nor are tables without rows.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from validation.report.tables.formatting import PageTable, number, with_u
from validation.result import ValidationResult

FILE = Path(__file__).parents[1] / "results.schema.json"


@cache
def _described() -> dict[str, Any]:
    tables = json.loads(FILE.read_text(encoding="utf-8"))["properties"]["tables"]["properties"]
    return {name: table for name, table in tables.items() if "page" in table}


def described_sections(result: ValidationResult) -> dict[tuple[str, str], list[str]]:
    """Names of the tables of a result by the section (id, title) that the page shows them in."""
    sections: dict[tuple[str, str], list[str]] = {}
    for name, table in _described().items():
        if len(result.tables.get(name, ())):
            key, title = table["page"]["section"]
            sections.setdefault((key, title), []).append(name)
    return sections


def described_table(name: str, result: ValidationResult) -> PageTable:
    """One of `described_sections` as text."""
    table, rows = _described()[name], result.tables[name].to_dict("records")
    page, columns = table["page"], table["items"]["properties"]
    shown = {column: about for column, about in columns.items() if "head" in about}
    return PageTable(
        name,
        page["caption"].format(**rows[0]),
        [about["head"] for about in shown.values()],
        [[_cell(row, column, about) for column, about in shown.items()] for row in rows],
        [note.format(**rows[0]) for note in page["notes"]],
        name,
    )


def _cell(row: dict[str, Any], column: str, about: dict[str, Any]) -> str:
    value, factor = row[column], about.get("factor", 1)
    if isinstance(value, str):
        return value
    if about.get("u") and row[about["u"]] > 0:
        return with_u(factor * value, factor * row[about["u"]])
    return number(factor * value, about.get("digits", 3))
