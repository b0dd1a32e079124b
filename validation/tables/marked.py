"""Table *marked*: every stretch of a channel that was left out of the scores."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from validation.tables.comparison import Comparison
from validation.tables.table import CHANNEL, TRIAL, Column, Page, Table

COLUMNS = (
    TRIAL,
    CHANNEL,
    Column("start_s", "s", "Begin", head="from"),
    Column("end_s", "s", "End", head="to"),
    Column("largest_at_s", "s", "Time of the largest disagreement of the encoders"),
    Column("gap_m", "m", "Largest excess of the gap between key and whippen at the capstan, by their encoders",
           head="gap"),
    Column("lift_m", "m", "Lift of the key that would explain it", head="lift"),
    Column("rail_pull_n", "N", "Pull of the balance rail that the model would need at that time; null when not asked"),
    Column("reason", "", "Why it was marked", str, head="why"),
)  # fmt: skip


def rows(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """Intervals in which the key may lift off its rail, of the trials whose angles have a zero."""
    for number, found in comparison.events.lifts.items():
        if number not in comparison.findings.trials_without_rest:
            yield from ({"trial": number, "channel": "key", **asdict(lift)} for lift in found)


TABLE = Table(
    "marked",
    "stretch of a channel that was left out of the scores",
    COLUMNS,
    rows,
    (Page("trials", "Left out of the scores", order=4),),
)
