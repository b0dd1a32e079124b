"""Numbers as a reader sees them: significant digits, degrees, per cent, a dash for what does not exist.

Also tables that the page shows as ``results.schema.json`` describes them, with no code of their own. An entry of
``tables`` there may have ``page``: its section (id and title), caption and notes, which may name columns of the first
row in braces; and a column of it ``head``, with it a ``factor`` to the unit shown, ``digits`` (3), and the column ``u``
of its standard uncertainty. Columns without a head are not shown, nor are tables without rows.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

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


DASH = "–"


@dataclass(frozen=True)
class PageTable:
    """A table of text: caption, column heads, rows; the first cell of a row is its head; ``source``: the CSV table that
    has its numbers in full."""

    key: str
    caption: str
    head: list[str]
    rows: list[list[str]]
    notes: list[str] = field(default_factory=list)
    source: str = ""


def cells(rows: Iterable[Any], columns: Mapping[str, Callable[[Any], str]]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of a table: what stands below a head is what its function says of each row."""
    return list(columns), [[say(row) for say in columns.values()] for row in rows]


def number(value: object, digits: int = 3) -> str:
    """A number with so many significant digits, or a dash."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return DASH
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{min(decimals, 9)}f}".replace("-", "−")


def with_u(value: float, u: float) -> str:
    """A value rounded to two digits of its uncertainty, or four significant digits when none is known."""
    if not math.isfinite(value):
        return DASH
    if not (math.isfinite(u) and u > 0):
        return number(value, 4)
    decimals = min(max(0, 1 - math.floor(math.log10(u))), 6)
    return f"{value:.{decimals}f} ± {u:.{decimals}f}".replace("-", "−")


def degrees(value: object) -> str:
    """Radians shown in degrees with four decimals, a quarter of a count of the encoders."""
    if not isinstance(value, float) or not math.isfinite(value):
        return DASH
    return f"{math.degrees(value):.4f}".replace("-", "−").replace("−0.0000", "0.0000")


def percent(value: object) -> str:
    """A ratio in per cent."""
    return number(100 * value, 2) + " %" if isinstance(value, float) and math.isfinite(value) else DASH


def between(low: str, high: str) -> str:
    """Two ends of an interval."""
    return DASH if DASH in (low, high) else f"{low} to {high}"


def rms(values: pd.Series) -> float:
    """Root mean square of what exists."""
    return float((values.dropna() ** 2).mean() ** 0.5) if values.notna().any() else math.nan
