"""Units as recordings write them, compared with those a mapping states.

A unit that is not known here contradicts any other: kgf is not N, although both are forces.
"""

from __future__ import annotations

import re

SYNONYMS = {
    "n": "N", "newton": "N", "newtons": "N", "mn": "mN", "kn": "kN", "lbf": "lbf", "pound-force": "lbf",
    "v": "V", "volt": "V", "volts": "V", "mv": "mV", "mv/v": "mV/V", "kg": "kg", "g": "g", "lb": "lb", "lbs": "lb",
    "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radian": "rad", "radians": "rad",
    "rev": "rev", "count": "counts", "counts": "counts", "tick": "counts", "ticks": "counts",
    "s": "s", "sec": "s", "second": "s", "seconds": "s", "ms": "ms", "us": "us", "µs": "us", "μs": "us",
    "kgf": "kgf", "gf": "gf", "hz": "Hz", "°c": "°C", "a": "A", "mm": "mm", "m": "m",
}  # fmt: skip
SILENT = ("", "-", "1", "none", "default si unit")
"""Texts in the place of a unit that state none."""
_TAIL = re.compile(r"^(?P<name>.*\S)\s*[(\[](?P<unit>[^()\[\]]*)[)\]]$")


def known(text: str) -> str | None:
    """Return the unit a text states: ours for a known spelling, else the text itself; None where none is stated."""
    stated = text.strip()
    return None if stated.lower() in SILENT else SYNONYMS.get(stated.lower(), stated)


def of_name(name: str) -> str:
    """Return the known unit in brackets at the end of a channel's name, ``Force (N)``; empty where there is none."""
    found = _TAIL.match(name)
    unit = found["unit"].strip() if found else ""
    return unit if unit.lower() in SYNONYMS else ""


def is_units_row(cells: list[str]) -> bool:
    """Whether a row below the names states units: every cell a known unit or silent, one at least known."""
    bare = [cell.strip().strip("()[]").strip().lower() for cell in cells]
    return any(cell in SYNONYMS for cell in bare) and all(cell in SYNONYMS or cell in SILENT for cell in bare)
