"""Table *event_repeatability*: scatter of every event over the trials."""

from __future__ import annotations

import pandas as pd

from validation.numbers import between, number
from validation.statistics.repeatability import event_repeatability
from validation.tables.comparison import Comparison
from validation.tables.events import event_label
from validation.tables.table import OF_ROW, UNIT, UNIT_SHOWN, Column, Page, Row, Table


def _count_words(row: Row) -> str:
    return f"{row['n_found']} found" + (f", {row['n_ambiguous']} ambiguous" if row["n_ambiguous"] else "")


def _interval(row: Row) -> str:
    factor = UNIT_SHOWN.get(row["unit"], ("", 1.0))[1]
    return between(number(factor * row["s_low"], 2), number(factor * row["s_high"], 2))


COLUMNS = (
    Column("event", "", "Event, a key of event_definitions", str, head="event", text=event_label),
    UNIT,
    Column("n_found", "1", "Trials in which it was found", int, head="trials", text=_count_words),
    Column("n_ambiguous", "1", "Trials in which it is ambiguous, not counted", int),
    Column("n_absent", "1", "Trials in which it is absent", int),
    Column("mean", OF_ROW, "Mean over trials", head="mean ± s", u="s"),
    Column("s", OF_ROW, "Standard deviation over trials"),
    Column("s_low", OF_ROW, "Lower end of its 95 % interval", head="95 % interval of s", text=_interval),
    Column("s_high", OF_ROW, "Upper end of it"),
    Column("limit", OF_ROW, "Repeatability limit (ISO 5725, with the factor for few trials)", head="limit"),
    Column("range", OF_ROW, "Largest − smallest", head="range"),
)  # fmt: skip


def rows(comparison: Comparison) -> pd.DataFrame:
    """One row an event, of the trials that count."""
    return event_repeatability(comparison.counting, comparison.findings.conditions)


TABLE = Table(
    "event_repeatability",
    "event: scatter over trials (the model enters by its geometry at rest only)",
    COLUMNS,
    rows,
    (
        Page(
            "repeatability",
            "Repeatability of the events",
            order=1,
            where=lambda table: table[table["n_found"] + table["n_ambiguous"] > 0],
        ),
    ),
    of_model=False,
)
