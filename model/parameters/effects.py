"""Effects a scene may add: a lifting key, a shank that bends, motor arm and drive, finger, string, joints that give.

Defaults with unit and source: ``effects.toml``. What they can and cannot claim: docs/explanation/effects.md.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from model.parameters.quantity import Quantity, quantity_tables, read_quantity

FILE = Path(__file__).with_name("effects.toml")
PINS = {f"{body}_pin": body for body in ("key", "whippen", "jack", "repetition", "hammer")}
"""Effects that let the joint of a body give."""
EFFECTS = ("balance_rail", "shank", "motor_arm", "string", "motor_drive", "finger", *PINS)
KEY_LIFT, SHANK, MOTOR = "key_lift", "shank", "motor"  # coordinates: m, rad, rad
WINDING, FINGER = "winding", "finger"  # the charge that has passed, C; rad
ARM, MOTOR_DRIVE = "motor_arm", "motor_drive"
RAIL = "balance_rail"
STRING_EFFECT = "string"


@cache
def effect_defaults() -> Mapping[str, Quantity]:
    table = tomllib.loads(FILE.read_text(encoding="utf-8"))
    return {path: read_quantity(path, item, item["unit"], str(FILE)) for path, item in quantity_tables(table)}


def effect_of(path: str) -> str | None:
    section = path.split(".")[0]
    return section if section in EFFECTS else None


def column(coordinate: str, rate: bool = False) -> str:
    """Name of the output column of a coordinate, or of its rate."""
    if coordinate == WINDING:
        return "current_a" if rate else "charge_c"
    unit = "m" if coordinate == KEY_LIFT else "rad"
    return f"{coordinate}_{unit}" + ("_per_s" if rate else "")
