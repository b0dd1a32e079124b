"""Numbers as a reader sees them: significant digits, degrees, per cent, a dash for what does not exist."""

from __future__ import annotations

import math

DASH = "–"
MOST_DECIMALS = 9  # of a text: more than any measurement has
SMALLEST = 10.0**-MOST_DECIMALS  # in the unit shown: below it a number is rounding, and shown as 0


def number(value: object, digits: int = 3) -> str:
    """Text of a number with ``digits`` significant digits; a dash for NaN."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return DASH
    if abs(value) < SMALLEST:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{min(decimals, MOST_DECIMALS)}f}".replace("-", "−")


def with_named_u(value: float, u: float, unit: str = "") -> str:
    """As `with_u`, and the uncertainty is called by its name: ``1.82 mm (standard uncertainty 0.11 mm)``."""
    size, _, uncertainty = with_u(value, u).partition(" ± ")
    unit = f" {unit}" if unit else ""
    return f"{size}{unit} (standard uncertainty {uncertainty}{unit})" if uncertainty else f"{size}{unit}"


def with_u(value: float, u: float) -> str:
    """Text ``value ± u``, rounded to two digits of the uncertainty; the value alone, to four significant digits, when
    none is known."""
    if not math.isfinite(value):
        return DASH
    if not (math.isfinite(u) and u > 0):
        return number(value, 4)
    decimals = min(max(0, 1 - math.floor(math.log10(u))), MOST_DECIMALS)
    rounded = round(value, decimals) + 0.0  # no minus before zero
    return f"{rounded:.{decimals}f} ± {u:.{decimals}f}".replace("-", "−")


def degrees(value: object) -> str:
    """Radians shown in degrees with three significant digits."""
    return number(math.degrees(value), 3) if isinstance(value, float) else DASH


def between(low: str, high: str) -> str:
    """Two ends of an interval."""
    return DASH if DASH in (low, high) else f"{low} to {high}"
