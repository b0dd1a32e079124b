"""The heat map: the judged difference of every session and model by channel and phase, in units of its uncertainty.

Its numbers are those of `ValidationResult.phases`; a colour only repeats what the number says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from validation.curves.signs import SIGN, TITLE
from validation.report.tables.formatting import DASH, number
from validation.result import ValidationResult
from validation.side_by_side import SideBySide
from validation.tables.phases import PHASES

STEPS = ((0.5, "h0"), (1.0, "h1"), (2.0, "h2"), (4.0, "h3"), (math.inf, "h4"))
"""Upper end of each class of colour, in multiples of what a right model reaches."""


@dataclass(frozen=True)
class HeatCell:
    """One phase of one channel: number, class of colour, and the whole in words."""

    text: str
    level: str
    words: str


@dataclass(frozen=True)
class HeatGroup:
    """One session and model: its name, and by channel the cells of the phases."""

    session: str
    model: str
    limit: str
    rows: list[tuple[str, list[HeatCell]]]


def heat_map(side: SideBySide) -> list[HeatGroup]:
    """One group per result that has a measured channel."""
    return [_group(result) for result in side.results]


def _group(result: ValidationResult) -> HeatGroup:
    rows = []
    for channel, part in result.phases.groupby("channel", sort=False):
        if (part["state"] == "not filmed").all():
            continue
        by_phase = {str(row.phase): row for row in part.itertuples()}
        rows.append((TITLE[str(channel)], [_cell(by_phase[phase]) for phase in PHASES]))
    limits = result.phases["ratio_limit"].dropna()
    limit = _ratio(float(limits.iloc[0])) if len(limits) else ""
    return HeatGroup(result.session_name, result.action_name, limit, rows)


def _cell(row: Any) -> HeatCell:
    if not math.isfinite(row.ratio):
        return HeatCell(DASH, "na", row.state or "not judged")
    level = next(name for most, name in STEPS if row.ratio <= most * row.ratio_limit)
    degrees = SIGN[row.channel] * math.degrees(row.difference_rad)
    words = f"model − trial {number(degrees, 2)}° at {row.at_s:.3f} s, {_ratio(row.ratio)} u: {row.outcome}"
    return HeatCell(_ratio(row.ratio), level, words)


def _ratio(value: float) -> str:
    return f"{value:.1f}" if value < 9.95 else f"{value:.0f}"
