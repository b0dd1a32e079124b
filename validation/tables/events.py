"""Table *events*: every event of every trial and of its prediction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from validation.events.definitions import EVENTS, Event
from validation.tables.comparison import Comparison
from validation.tables.table import OF_ROW, TRIAL, UNIT, Column, Page, Row, Table


def event_label(row: Row) -> str:
    """An event with the unit it is shown in."""
    return EVENTS[row["event"]].label


COLUMNS = (
    TRIAL,
    Column("source", "", "trial (measured) or model (predicted)", str, head="source"),
    Column("event", "", "Event, a key of event_definitions", str, head="event", text=event_label),
    Column("value", OF_ROW, "Time, height, speed or count; null when absent", head="value", u="u"),
    Column("u", OF_ROW, "Standard uncertainty"),
    UNIT,
    Column("status", "", "found, absent or ambiguous", str, head="status"),
    Column("note", "", "Why it is absent or ambiguous", str, head="note"),
)  # fmt: skip


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Events of the trials, then those of the predictions."""
    return list(event_rows(comparison.events.trial, comparison.events.model))


def event_rows(
    trial: Mapping[int, Mapping[str, Event]], model: Mapping[int, Mapping[str, Event]]
) -> Iterator[dict[str, Any]]:
    """Yield a row by column for each trial, source (``trial``, then ``model``) and event: value, u, unit, status and
    note; arguments: trial number → event name → event. The value of an event that did not happen is NaN."""
    for source, events in (("trial", trial), ("model", model)):
        for number, found in events.items():
            for e in found.values():
                yield {
                    "trial": number,
                    "source": source,
                    "event": e.name,
                    "value": e.value,
                    "u": e.u,
                    "unit": EVENTS[e.name].unit,
                    "status": e.status,
                    "note": e.note,
                }


TABLE = Table(
    "events",
    "trial, source and event",
    COLUMNS,
    rows,
    (Page("trials", "Every event of every trial", order=3),),
)
