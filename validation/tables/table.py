"""What a table is: its columns with unit and meaning, how its rows are made, and how a page shows it.

Conventions: values in SI and rad; a page shows degrees, millimetres, milliseconds and millijoules (`UNIT_SHOWN`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from validation.numbers import DASH, number, with_u

if TYPE_CHECKING:
    from validation.result import ValidationResult

UNIT_SHOWN = {
    "rad": ("°", 180.0 / math.pi),
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "J": ("mJ", 1e3),
    "N": ("N", 1.0),
    "Hz": ("Hz", 1.0),
    "m/s": ("m/s", 1.0),
}
"""Unit of a value → unit and factor on a page; others as they are."""
OF_ROW = "unit of the row"
SECTIONS = {
    "values": "Values before and after",
    "prediction": "Fit and prediction",
    "next": "What to record next",
    "models": "Models side by side",
    "differing": "Trials that differ",
    "trials": "Trial by trial",
    "causes": "Causes",
    "repeatability": "Repeatability",
    "inside": "Inside the action",
    "scores": "Scores",
    "provenance": "Provenance",
}
"""Sections of a page, in their order: id and title; the first three are an identification's."""

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    unit: str
    """SI, ``rad``, ``1``, `OF_ROW`, or empty for what is no number."""
    meaning: str
    kind: type = float
    """``float``, ``int``, ``str`` or ``bool``."""
    optional: bool = False
    """Whether a text, truth or count may be missing; a number always may."""
    values: tuple[str, ...] = ()
    """All values that a text may have; any where empty."""
    head: str = ""
    """Heading on a page, without its unit; not shown where empty."""
    digits: int = 3
    """Significant digits on a page, where no uncertainty is known."""
    u: str = ""
    """The column of its standard uncertainty."""
    shown: tuple[str, float] | None = None
    """Unit and factor on a page, where not those of `UNIT_SHOWN`."""
    text: Callable[[Row], str] | None = None
    """Cell of a page from the whole row, where the value alone does not say it."""

    @property
    def heading(self) -> str:
        """Heading with the unit shown."""
        unit = (self.shown or UNIT_SHOWN.get(self.unit, ("", 1.0)))[0]
        return f"{self.head} ({unit})" if unit and self.text is None else self.head

    def cell(self, row: Row) -> str:
        """Text of this column's cell of a row (by column name), in the unit shown, with its uncertainty where the
        column has one; a dash where the value is missing."""
        if self.text is not None:
            return self.text(row)
        value = row[self.name]
        if isinstance(value, str | bool | np.bool_):
            return value if isinstance(value, str) else ("yes" if value else "no")
        if not isinstance(value, int | float | np.number) or not math.isfinite(value):
            return DASH
        if self.kind is int:
            return str(round(float(value)))
        factor = (self.shown or UNIT_SHOWN.get(row["unit"] if self.unit == OF_ROW else self.unit, ("", 1.0)))[1]
        if self.u and row[self.u] > 0:
            return with_u(factor * value, factor * row[self.u])
        return number(factor * float(value), self.digits)

    @property
    def schema(self) -> dict[str, Any]:
        """The column in JSON Schema."""
        name = {float: "number", int: "integer", str: "string", bool: "boolean"}[self.kind]
        kind = [name, "null"] if self.optional or self.kind is float else name
        enum = {"enum": list(self.values)} if self.values else {}
        return {"type": kind, **enum, "description": self.meaning, **({"unit": self.unit} if self.unit else {})}


@dataclass(frozen=True)
class Page:
    """How a page shows a table."""

    section: str
    caption: str
    """May name columns of the first row in braces; so may notes."""
    notes: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    """Names of the columns shown; all that have a heading where empty."""
    order: int = 0
    """Place in its section."""
    where: Callable[[pd.DataFrame], pd.DataFrame] | None = None
    """The rows shown; all where left out."""


@dataclass(frozen=True)
class PageTable:
    """A table of text: the first cell of a row is its head; ``source``: the CSV table that has its numbers in full."""

    key: str
    caption: str
    head: list[str]
    rows: list[list[str]]
    notes: list[str] = field(default_factory=list)
    source: str = ""


@dataclass(frozen=True)
class Table:
    """One table: what a row is of, its columns, how its rows are made, and how pages show it."""

    name: str
    row: str
    """What one row is of, besides session and model."""
    columns: tuple[Column, ...]
    rows: Callable[[Any], pd.DataFrame | Iterable[Row]]
    """Of a `validation.tables.comparison.Comparison`, or of several results where ``of`` says so."""
    pages: tuple[Page, ...] = ()
    of: Literal["comparison", "report", "results", "identification"] = "comparison"
    """What the rows are of: one comparison; the same, made where a report is written; all results together; or an
    identification, whose tables are on its page only."""
    of_model: bool = True
    """Whether it depends on the model."""

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [column.name for column in self.columns]

    def make(self, source: Any) -> pd.DataFrame:
        """Data frame of the rows made from ``source`` (a comparison, or what the field `of` names), with all columns of
        the table in their order; raises ValueError where a data frame of rows has other columns."""
        rows = self.rows(source)
        if isinstance(rows, pd.DataFrame):
            if set(rows.columns) != set(self.names):
                differing = sorted(set(rows.columns) ^ set(self.names))
                raise ValueError(f"table {self.name}: {', '.join(differing)} found or described, not both")
            return rows[self.names]
        return pd.DataFrame(list(rows), columns=self.names)

    @property
    def described(self) -> list[Column]:
        """Columns of the file and of ``results.json``: session and model first, unless the table has them."""
        return [*(() if self.of == "results" else LEAD), *self.columns]

    @property
    def schema(self) -> dict[str, Any]:
        """The table in JSON Schema."""
        columns = {column.name: column.schema for column in self.described}
        items = {"type": "object", "additionalProperties": False, "required": list(columns), "properties": columns}
        lead = "" if self.of == "results" else "session, model and "
        return {"type": "array", "description": f"One row per {lead}{self.row}", "items": items}


LEAD = (
    Column("session", "", "Name of the session", str),
    Column("model", "", "Name of the model: of its parameter set", str),
)
TRIAL = Column("trial", "", "Number of the trial in its session", int, head="trial")
CHANNEL = Column(
    "channel", "", "Rotation: key, whippen, hammer (encoders), jack, repetition (film, relative to the whippen)", str,
    head="channel",
)  # fmt: skip
UNIT = Column("unit", "", "Unit of the row's values", str)


def page_table(table: Table, page: Page, results: Sequence[ValidationResult], prefix: str = "") -> PageTable | None:
    """A table of a session as text, of all its models (``results``: one each) below each other, its id led by
    ``prefix``; None where it has no rows."""
    chosen = results if table.of_model else results[:1]
    parts = [(r.action_name, shown_rows(page, r.tables.get(table.name, pd.DataFrame()))) for r in chosen]
    return make_page_table(table, page, [(name, row) for name, rows in parts for row in rows], len(chosen) > 1, prefix)


def make_page_table(
    table: Table, page: Page, rows: Sequence[tuple[str, Row]], named: bool = False, prefix: str = ""
) -> PageTable | None:
    """Table of text from ``rows``, pairs of model name and row, less columns without any value; the model's name stands
    first where ``named``, ``prefix`` leads the table's id. None without rows."""
    if not rows:
        return None
    columns = [c for c in table.columns if (c.name in page.columns if page.columns else c.head)]
    cells = {c.name: [c.cell(row) for _, row in rows] for c in columns}
    columns = [c for c in columns if c is columns[0] or set(cells[c.name]) - {DASH, ""}]
    first = rows[0][1]
    return PageTable(
        f"{prefix}{page.section}-{table.name}",
        page.caption.format(**first),
        [*(["model"] if named else []), *(c.heading for c in columns)],
        [[*([name] if named else []), *(cells[c.name][i] for c in columns)] for i, (name, _) in enumerate(rows)],
        [note.format(**first) for note in page.notes],
        table.name,
    )


def shown_rows(page: Page, frame: pd.DataFrame) -> list[dict[str, Any]]:
    return list((frame if page.where is None or frame.empty else page.where(frame)).to_dict("records"))
