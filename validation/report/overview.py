"""The first screen: the verdict in one sentence, and the events as a forest with their limits of relevance."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from validation.numbers import DASH, number
from validation.result import AGREES, ValidationResult
from validation.verdict.quantities import INDEX, QUANTITIES
from validation.verdict.verdict import (
    ANOTHER_FALL,
    NOT_TESTED,
    format_interval,
    reading_of,
    shown_interval,
    sort_by_importance,
    title_of,
)

WIDTH, EDGE = 240.0, 8.0
EVENTS_SHOWN = ("let_off_distance", "hammer_speed", "string_impact", "check_height", "drop", "key_release")
ERROR = "Model error"
NOTE = (
    "Line: 95 % interval; red dots: limit of relevance; filled square: an error that the test of all quantities "
    "together shows. Each event has its own scale."
)


def verdict_parts(result: ValidationResult) -> tuple[str, str]:
    """Two texts from the verdict's sentence: what leads a page, the model error with its interval (the outcome where it
    agrees or none is named), and the rest."""
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


@dataclass(frozen=True)
class ForestRow:
    """One line: name and cells, and in the drawing's own units the value, ends of its interval, and its limits."""

    cells: list[str]
    at: float
    low: float
    high: float
    limits: list[float]
    resolved: bool
    is_known: bool = True
    """Whether there is a value to draw."""


@dataclass(frozen=True)
class Forest:
    """A table with a drawn interval in each row, after its first column."""

    caption: str
    head: tuple[str, ...]
    rows: list[ForestRow]
    note: str


def make_forest(
    caption: str,
    head: tuple[str, ...],
    found: Sequence[tuple[list[str], float, float, float, float, bool]],
    note: str,
    scales: Sequence[str] = (),
) -> Forest:
    """Forest plot as data, one row for each of ``found``: cells of text, value, lower and upper end of its interval,
    limit on both sides (NaN without) and whether it is resolved; ``scales``: name of each row's scale, one for all if
    empty.

    ``head``: of the columns of cells; ``note``: below them.
    """
    names = list(scales) or [""] * len(found)
    reach: dict[str, float] = {}
    for name, (_, _, low, high, limit, _) in zip(names, found, strict=True):
        ends = [abs(x) for x in (low, high, limit) if math.isfinite(x)]
        reach[name] = max([reach.get(name, 0.0), *ends])

    def place(value: float, most: float) -> float:
        share = value / most if most > 0 and math.isfinite(value) else 0.0
        return round(WIDTH / 2 + (WIDTH / 2 - EDGE) * share, 2)

    rows = [
        ForestRow(
            cells,
            place(at, reach[name]),
            place(low, reach[name]),
            place(high, reach[name]),
            [place(x, reach[name]) for x in (-limit, limit)] if math.isfinite(limit) else [],
            resolved,
            math.isfinite(at),
        )
        for name, (cells, at, low, high, limit, resolved) in zip(names, found, strict=True)
    ]
    return Forest(caption, head, rows, note)


def forest(results: Sequence[ValidationResult]) -> Forest | None:
    """Forest plot of the model errors of a session's events with their 95 % intervals and limits, one row for each
    event, condition and model (``results``: one a model); None where none has an interval.

    Its numbers are those of `ValidationResult.quantities`.
    """
    several = len(results) > 1
    rows, scales = [], []
    for name in EVENTS_SHOWN:
        for result in results:
            for row in result.quantities.itertuples():
                is_other, has_interval = row.state == ANOTHER_FALL, math.isfinite(row.low)
                if row.quantity != name or not (has_interval or is_other) or reading_of(row) == NOT_TESTED:
                    continue
                q, known = QUANTITIES[INDEX[name]], math.isfinite(row.limit)
                cells = [
                    f"{title_of(row)} ({q.unit_shown})",
                    *([result.action_name] if several else []),
                    format_interval(*shown_interval(row), "") if has_interval else DASH,
                    f"± {number(q.factor * row.limit, 2)}" if known else DASH,
                    reading_of(row) if known or is_other else "for information",
                ]
                rows.append((cells, 0.5 * (row.low + row.high), row.low, row.high, row.limit, bool(row.resolved)))
                scales.append(name)
    head = ("event", "too small · 0 · too large", *(["model"] if several else []), "error, 95 %", "limit", "reading")
    caption = "Events: error of the model, model − trial, with its 95 % interval"
    return make_forest(caption, head, rows, NOTE, scales) if rows else None


def quantity_rows(result: ValidationResult) -> list[tuple[str, str, str, str]]:
    """Texts of each primary quantity with an interval, the most important first: name with unit, model error with its
    95 % interval, limit, reading; those not tested are left out."""
    if not len(result.quantities):
        return []
    rows = []
    for row in sort_by_importance(result.quantities).itertuples():
        if reading_of(row) == NOT_TESTED:
            continue
        q = QUANTITIES[INDEX[str(row.quantity)]]
        limit = f"± {number(q.factor * row.limit, 2)}"
        error = format_interval(*shown_interval(row), "")
        rows.append((f"{title_of(row)} ({q.unit_shown})", error, limit, reading_of(row)))
    return rows
