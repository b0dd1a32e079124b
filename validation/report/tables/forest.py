"""The forest plot: hammer speed, check height and release of every session and model, resolved differences first.

Its numbers are those of `ValidationResult.budget`; each quantity has one scale for all its rows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from validation.events.definitions import EVENTS
from validation.report.tables.formatting import number, with_u
from validation.result import NOT_JUDGED
from validation.side_by_side import SideBySide

QUANTITIES = ("hammer_speed", "check_height", "key_release")
WIDTH, HEIGHT, EDGE = 240.0, 22.0, 8.0


@dataclass(frozen=True)
class ForestRow:
    """One quantity of one session and model; places are of the drawing, in its own units."""

    quantity: str
    session: str
    model: str
    difference: str
    interval: str
    reading: str
    resolved: bool
    at: float
    low: float
    high: float


def forest(side: SideBySide) -> list[ForestRow]:
    """Rows of all results, those whose difference is resolved first, then by |difference| / u."""
    found: list[tuple[Any, Any]] = [
        (result, row) for result in side.results for row in result.budget.itertuples() if row.event in QUANTITIES
    ]
    reach: dict[str, float] = {}
    for _, row in found:
        reach[row.event] = max(reach.get(row.event, 0.0), *(abs(x) for x in _ends(row) if math.isfinite(x)), 0.0)
    order = sorted(found, key=lambda pair: (not _resolved(*pair), -_ratio(pair[1])))
    return [_row(result, row, reach[row.event]) for result, row in order]


def _ends(row: Any) -> tuple[float, float]:
    return row.difference - 2 * row.u_val, row.difference + 2 * row.u_val


def _ratio(row: Any) -> float:
    return float(row.ratio) if math.isfinite(row.ratio) else -1.0


def _resolved(result: Any, row: Any) -> bool:
    return bool(row.resolved) and result.outcome != NOT_JUDGED


def _row(result: Any, row: Any, reach: float) -> ForestRow:
    kind = EVENTS[row.event]
    k = kind.display_factor
    half = WIDTH / 2 - EDGE

    def place(value: float) -> float:
        return round(WIDTH / 2 + half * (value / reach if reach > 0 and math.isfinite(value) else 0.0), 2)

    low, high = _ends(row)
    if result.outcome == NOT_JUDGED:
        reading = "not judged"
    else:
        reading = "model error" if row.resolved else "not resolved"
    return ForestRow(
        kind.label,
        result.session_name,
        result.action_name,
        with_u(k * row.difference, k * row.u_val),
        f"{number(k * low, 3)} to {number(k * high, 3)}",
        reading,
        _resolved(result, row),
        place(row.difference),
        place(low),
        place(high),
    )
