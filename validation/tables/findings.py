"""Table *findings*: what was seen in the session that its trials, or trial and prediction, should not show."""

from __future__ import annotations

import re
from dataclasses import asdict
from typing import Any

from validation.numbers import DASH
from validation.tables.comparison import Comparison
from validation.tables.table import Column, Page, Table

COLUMNS = (
    Column("kind", "", "Kind of fault, see validation.findings.finding.KINDS", str, head="finding"),
    Column("trial", "", "Trial; null for the whole session", head="trial",
           text=lambda row: DASH if row["trial"] != row["trial"] else str(int(row["trial"]))),
    Column("channel", "", "Channel or parameter; may be empty", str, head="channel"),
    Column("value", "", "What was found, in the unit the text gives"),
    Column("limit", "", "Limit of the rule, same unit"),
    Column("text", "", "The fault in words, and what to do", str, head="what was seen",
           text=lambda row: re.sub(r"^trial \d+: ", "", row["text"])),
)  # fmt: skip


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """The findings of `validation.findings`, the most urgent first."""
    return [asdict(finding) for finding in comparison.findings.faults]


TABLE = Table(
    "findings",
    "fault of a session that was recognised",
    COLUMNS,
    rows,
    (Page("differing", "Findings"),),
)
