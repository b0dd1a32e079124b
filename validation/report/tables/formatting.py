"""Numbers as a reader sees them: significant digits, degrees, per cent, a dash for what does not exist."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pandas as pd

DASH = "–"


@dataclass(frozen=True)
class PageTable:
    """A table of text: caption, column heads, rows; the first cell of a row is its head; ``source``: the CSV table that
    has its numbers in full."""

    key: str
    caption: str
    head: list[str]
    rows: list[list[str]]
    notes: list[str] = field(default_factory=list)
    source: str = ""


def number(value: object, digits: int = 3) -> str:
    """A number with so many significant digits, or a dash."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return DASH
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{min(decimals, 9)}f}".replace("-", "−")


def with_u(value: float, u: float) -> str:
    """A value rounded to two digits of its uncertainty, or four significant digits when none is known."""
    if not math.isfinite(value):
        return DASH
    if not (math.isfinite(u) and u > 0):
        return number(value, 4)
    decimals = min(max(0, 1 - math.floor(math.log10(u))), 6)
    return f"{value:.{decimals}f} ± {u:.{decimals}f}".replace("-", "−")


def degrees(value: object) -> str:
    """Radians shown in degrees with four decimals, a quarter of a count of the encoders."""
    if not isinstance(value, float) or not math.isfinite(value):
        return DASH
    return f"{math.degrees(value):.4f}".replace("-", "−").replace("−0.0000", "0.0000")


def percent(value: object) -> str:
    """A ratio in per cent."""
    return number(100 * value, 2) + " %" if isinstance(value, float) and math.isfinite(value) else DASH


def between(low: str, high: str) -> str:
    """Two ends of an interval."""
    return DASH if DASH in (low, high) else f"{low} to {high}"


def rms(values: pd.Series) -> float:
    """Root mean square of what exists."""
    return float((values.dropna() ** 2).mean() ** 0.5) if values.notna().any() else math.nan
