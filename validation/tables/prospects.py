"""Table *prospects*: what could be recorded next, or known better, and how far it would shrink the uncertainties."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from validation.tables.table import Column, Page, Table

MOST = 12  # shown

COLUMNS = (
    Column("what", "", "Trials of a stroke, more of a session, or a sensor known twice as well", str, head="what"),
    Column("mean", "1", "Uncertainty after, over that of now, geometric mean of the asked parameters",
           head="mean uncertainty left", shown=("%", 100.0), digits=2),
    Column("most", "", "Parameter that it shrinks most", str, head="most of"),
    Column("most_left", "1", "Its uncertainty after, over that of now", head="there", shown=("%", 100.0), digits=2),
)  # fmt: skip


def rows(ranked: Any) -> Iterator[dict[str, object]]:
    """One row of each prospect, in their order."""
    for one in ranked:
        most = min(one.shrink, key=one.shrink.get)
        yield {"what": one.words, "mean": one.mean, "most": most, "most_left": one.shrink[most]}


NOTES = (
    "As the Fisher information at the identified values predicts; where the model lacks something, shrinks that were "
    "realised on the virtual bench were off by up to a factor of two.",
)
TABLE = Table(
    "prospects",
    "thing that could be done next",
    COLUMNS,
    rows,
    (Page("next", "What to record next, or know better", NOTES, where=lambda table: table[:MOST]),),
    of="identification",
)
