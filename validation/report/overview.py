"""The first screen: the verdict in one sentence, and the events as a forest with their limits of relevance."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from validation.result import AGREES, ValidationResult
from validation.tables.numbers import DASH, number
from validation.verdict.quantities import INDEX, QUANTITIES
from validation.verdict.verdict import format_interval, most_important, reading_of, shown_interval, title_of

WIDTH, EDGE = 240.0, 8.0
EVENTS_SHOWN = ("let_off_distance", "hammer_speed", "string_impact", "check_height", "drop", "key_release")
ERROR = "Model error"


def verdict_parts(result: ValidationResult) -> tuple[str, str]:
    """The sentence of the verdict that leads a page, the error of the model with its interval, and the rest."""
    parts = re.split(r"(?<=[.)]) (?=[A-Z0-9])", result.sentence)
    lead = next((part for part in parts if part.startswith(ERROR)), parts[0])
    if result.outcome == AGREES:
        lead = parts[0]
    rest = [
        part.removeprefix(f"{result.outcome}: ")
        for part in parts
        if part is not lead and part.rstrip(".") != result.outcome.split(",")[0]
    ]
    return lead[:1].upper() + lead[1:], " ".join(part[:1].upper() + part[1:] for part in rest)


def forest(results: Sequence[ValidationResult]) -> list[dict[str, Any]]:
    """Rows of the events of a session: texts, and the places ``at``, ``low``, ``high``, ``limits`` in the drawing.

    Its numbers are those of `ValidationResult.quantities`; each quantity has one scale for all its rows. Where nothing
    was drawn the plain difference stands for the error.
    """
    found = [
        (result, row)
        for name in EVENTS_SHOWN
        for result in results
        for row in result.quantities.itertuples()
        if row.quantity == name and math.isfinite(row.low)
    ]
    reach: dict[str, float] = {}
    for _, row in found:
        ends = [abs(row.low), abs(row.high), *([row.limit] if math.isfinite(row.limit) else [])]
        reach[row.quantity] = max(reach.get(row.quantity, 0.0), *ends)

    def place(value: float, most: float) -> float:
        share = value / most if most > 0 and math.isfinite(value) else 0.0
        return round(WIDTH / 2 + (WIDTH / 2 - EDGE) * share, 2)

    out = []
    for result, row in found:
        q, most = QUANTITIES[INDEX[row.quantity]], reach[row.quantity]
        known = math.isfinite(row.limit)
        out.append(
            {
                "quantity": f"{title_of(row)} ({q.unit_shown})",
                "model": result.action_name,
                "difference": format_interval(*shown_interval(row), ""),
                "limit": f"± {number(q.factor * row.limit, 2)}" if known else DASH,
                "reading": reading_of(row) if known else "for information",
                "resolved": bool(row.resolved),
                "at": place(0.5 * (row.low + row.high), most),
                "low": place(row.low, most),
                "high": place(row.high, most),
                "limits": [place(-row.limit, most), place(row.limit, most)] if known else [],
            }
        )
    return out


def quantity_rows(result: ValidationResult) -> list[tuple[str, str, str, str]]:
    """The primary quantities, the most important first: name, error with its interval, limit, reading."""
    if not len(result.quantities):
        return []
    rows = []
    for row in most_important(result.quantities).itertuples():
        q = QUANTITIES[INDEX[str(row.quantity)]]
        limit = f"± {number(q.factor * row.limit, 2)}"
        error = format_interval(*shown_interval(row), "")
        rows.append((f"{title_of(row)} ({q.unit_shown})", error, limit, reading_of(row)))
    return rows
