"""The first screen's tables: the error of the model by channel and phase, and the events of the claim as a forest."""

from __future__ import annotations

import math
from typing import Any

from validation.curves.display_signs import TITLE
from validation.result import ValidationResult
from validation.side_by_side import SideBySide
from validation.tables.numbers import DASH, number
from validation.verdict.quantities import PHASES, QUANTITIES
from validation.verdict.verdict import format_interval, reading_of, shown_interval, title_of

WIDTH, HEIGHT, EDGE = 240.0, 22.0, 8.0


def forest(side: SideBySide) -> list[dict[str, Any]]:
    """Rows of the primary events of all results, resolved ones first, then by how far the interval reaches.

    Of each the quantity, session and model, texts, and the places ``at``, ``low``, ``high`` in the drawing's units.

    Its numbers are those of `ValidationResult.quantities`; each quantity has one scale for all its rows.
    """
    found = [
        (result, row)
        for result in side.results
        for row in result.quantities.itertuples()
        if row.primary and not row.channel and math.isfinite(row.low)
    ]
    reach: dict[str, float] = {}
    for _, row in found:
        reach[row.quantity] = max(reach.get(row.quantity, 0.0), abs(row.low), abs(row.high), row.limit)

    def place(value: float, most: float) -> float:
        share = value / most if most > 0 and math.isfinite(value) else 0.0
        return round(WIDTH / 2 + (WIDTH / 2 - EDGE) * share, 2)

    def first(pair: tuple[ValidationResult, Any]) -> tuple[bool, float]:
        row = pair[1]
        return not row.resolved, -max(abs(row.low), abs(row.high)) / row.limit

    out = []
    for result, row in sorted(found, key=first):
        q, most = QUANTITY[row.quantity], reach[row.quantity]
        out.append(
            {
                "quantity": f"{title_of(row)} ({q.unit_shown})",
                "session": result.session_name,
                "model": result.action_name,
                "difference": format_interval(*shown_interval(row), ""),
                "interval": f"{number(q.factor * row.low, 3)} to {number(q.factor * row.high, 3)}",
                "reading": reading_of(row),
                "resolved": bool(row.resolved),
                "at": place(0.5 * (row.low + row.high), most),
                "low": place(row.low, most),
                "high": place(row.high, most),
                "limits": [place(-row.limit, most), place(row.limit, most)],
            }
        )
    return out


STEPS = ((0.5, "h0"), (1.0, "h1"), (2.0, "h2"), (4.0, "h3"), (math.inf, "h4"))
"""Upper end of each class of colour, in multiples of what a right model reaches."""
QUANTITY = {q.name: q for q in QUANTITIES}


def heat_map(side: SideBySide) -> list[dict[str, Any]]:
    """One group per result: its session and model, and by measured channel the cells of the phases.

    A cell has the interval of the model error as ``text``, class of colour as ``level``, and the whole in ``words``.

    Its numbers are those of `ValidationResult.quantities`; a colour only repeats what the numbers say.
    """
    groups = []
    for result in side.results:
        rows = []
        angles = result.quantities[result.quantities["channel"] != ""]
        for (channel, trials), part in angles.groupby(["channel", "trials"], sort=False):
            by_phase = {str(row.phase): row for row in part.itertuples()}
            title = f"{TITLE[str(channel)]}, {trials}" if trials else TITLE[str(channel)]
            rows.append((title, [_cell(by_phase[phase]) for phase in PHASES]))
        judged = bool(result.judgement.get("judged", False))
        groups.append({"session": result.session_name, "model": result.action_name, "judged": judged, "rows": rows})
    return groups


def _cell(row: Any) -> dict[str, str]:
    if not math.isfinite(row.low):
        return {"text": DASH, "level": "na", "words": row.state or "not estimated"}
    level = next(name for most, name in STEPS if row.ratio <= most * row.ratio_limit)
    plain = format_interval(*shown_interval(row, ("plain_low", "plain_high")), "°")
    words = f"{reading_of(row)}; plain difference {plain}; limit {number(math.degrees(row.limit), 2)}°"
    return {"text": format_interval(*shown_interval(row), "°"), "level": level, "words": words}
