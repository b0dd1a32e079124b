"""Table *correlations*: pairs of parameters that an identification cannot tell apart."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

from validation.part_names import name_parts
from validation.tables.table import Column, Page, Table

SHOWN = 0.5  # absolute: half of either variance is more than a quarter known from the other

COLUMNS = (
    Column("first", "", "Parameter", str, head="parameter"),
    Column("second", "", "Another one", str, head="and"),
    Column(
        "correlation", "1", "Correlation of their errors, all else fitted beside them", head="correlation", digits=2
    ),
)


def rows(found: Any) -> Iterator[dict[str, object]]:
    """Every pair of asked parameters, the strongest correlation first."""
    names = [name_parts(e.name, found.action) for e in found.estimates]
    pairs = sorted(combinations(range(len(names)), 2), key=lambda pair: -abs(found.correlation[pair]))
    for i, j in pairs:
        yield {"first": names[i], "second": names[j], "correlation": float(found.correlation[i, j])}


TABLE = Table(
    "correlations",
    "pair of asked parameters",
    COLUMNS,
    rows,
    (
        Page(
            "values",
            f"Parameters whose errors go together (correlation beyond ±{SHOWN:g})",
            order=2,
            where=lambda table: table[table["correlation"].abs() > SHOWN],
        ),
    ),
    of="identification",
)
