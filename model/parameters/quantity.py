"""One number of a parameter file: value, unit, standard uncertainty, basis of that uncertainty, source.

Ranges are wide physical bounds that catch slips (wrong unit, wrong sign, missing power of ten), not judgements about
an action.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, get_args

from model.elements.laws.known import LAWS
from model.errors import InputError

Basis = Literal["measured", "printed digits", "assumed"]

# last part of a path (or last two) -> smallest and largest value allowed, and whether the smallest is excluded
RANGES: dict[str, tuple[float, float, bool]] = {
    "gravity.g": (0.0, 100.0, False),
    "friction_threshold.v_t": (0.0, 1.0, True),
    "friction_threshold.omega_t": (0.0, 100.0, True),
    "mass": (0.0, 100.0, True),
    "inertia": (0.0, 10.0, True),
    "x": (-2.0, 2.0, False),
    "y": (-2.0, 2.0, False),
    # a component may be as large as the length of a normal, 0.9 to 1.1 (`model.parameters.action`)
    "normal.x": (-1.1, 1.1, False),
    "normal.y": (-1.1, 1.1, False),
    "radius": (0.0, 1.0, True),
    "arc_start": (-2.0 * math.pi, 2.0 * math.pi, False),
    "arc_end": (-2.0 * math.pi, 2.0 * math.pi, False),
    "normal.a": (0.0, 1e15, False),
    "normal.b": (-1e12, 1e12, False),
    "normal.c": (0.0, 1e9, False),
    "normal.D": (0.0, 1e3, False),
    "A": (0.0, 10.0, False),
    "B1": (0.0, 100.0, False),
    "B2": (0.0, 100.0, False),
    "torque": (-10.0, 10.0, False),
    "stiffness": (0.0, 1e3, False),
    "angle": (-2.0 * math.pi, 2.0 * math.pi, False),
    "load_at_rest": (0.0, 1e3, False),
    "frequency_hz": (1.0, 1e6, False),
    "damping_ratio": (0.0, 10.0, False),
    "length": (0.0, 2.0, True),
    "joint_friction": (0.0, 10.0, False),
    "spring_stiffness": (0.0, 1e3, False),
    "preload_n": (0.0, 1e3, False),
    "contact_a": (0.0, 1e15, False),
    "contact_b": (0.0, 1e12, False),
    "contact_c": (0.0, 1e9, False),
    "contact_damping": (0.0, 1e3, False),
    "motor_drive.resistance": (0.0, 1e4, False),
    "motor_drive.inductance": (0.0, 10.0, True),
    "motor_drive.torque_constant": (0.0, 100.0, False),
    "motor_drive.current_gain": (-1e3, 1e3, False),
    "motor_drive.loop_gain": (0.0, 1e6, False),
    "motor_drive.voltage_gain": (-1e3, 1e3, False),
    "motor_drive.supply": (0.0, 1e6, True),
    "motor_drive.current_limit": (0.0, 1e4, True),
    "motor_drive.limit_gain": (0.0, 1e6, False),
    "motor_drive.limit_softness": (1e-3, 0.5, False),
    "finger.stiffness": (0.0, 1e9, False),
    "finger.damping": (0.0, 1e6, False),
    "finger.pad_a": (0.0, 1e15, False),
    "finger.pad_b": (0.0, 1e12, False),
    "finger.pad_c": (0.0, 1e9, False),
    "finger.pad_damping": (0.0, 1e3, False),
    "string.length": (0.01, 3.0, False),
    "string.mass": (1e-5, 1.0, False),
    "string.tension": (1.0, 1e4, False),
    "string.stiffness": (0.0, 0.01, False),
    "string.b1": (0.0, 100.0, False),
    "string.b2": (0.0, 0.1, False),
    "string.struck_at": (1e-3, 0.999, False),
    "string.modes": (0.0, 100.0, False),
    "string.unisons": (1.0, 3.0, False),
    **{
        f"{body}_pin.{name}": allowed
        for body in ("key", "whippen", "jack", "repetition", "hammer")
        for name, allowed in (("stiffness", (1e3, 1e9, False)), ("damping", (0.0, 1e5, False)))
    },
    "load.x": (-1e3, 1e3, False),
    "load.y": (-1e3, 1e3, False),
}


@dataclass(frozen=True)
class Quantity:
    """A value with its unit and standard uncertainty ``u`` (same unit), the basis of ``u``, and the source."""

    value: float
    unit: str
    u: float
    basis: Basis
    source: str


def allowed_range(path: str) -> tuple[float, float, bool]:
    """Smallest and largest allowed value of a parameter path, and whether the smallest is excluded."""
    parts = path.split(".")
    if len(parts) > 1 and parts[-2] in LAWS and parts[-1] in LAWS[parts[-2]].numbers:
        of_law = LAWS[parts[-2]].numbers[parts[-1]]
        return of_law.low, of_law.high, False
    return _listed_range(path)


@lru_cache(maxsize=1024)
def _listed_range(path: str) -> tuple[float, float, bool]:
    parts = path.split(".")
    return RANGES.get(".".join(parts[-2:]), RANGES.get(parts[-1], (-math.inf, math.inf, False)))


def describe_range(path: str) -> str:
    low, high, open_low = allowed_range(path)
    return f"{'above' if open_low else 'from'} {low:g} to {high:g}"


def check_value(path: str, value: Any, where: str) -> float:
    """Return ``value`` as a float; raise ``InputError`` naming key, value and allowed range."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{where}: {path}: found {value!r}, allowed a number {describe_range(path)}")
    low, high, open_low = allowed_range(path)
    if not math.isfinite(value) or value > high or value < low or (open_low and value <= low):
        raise InputError(
            f"{where}: {path}: found {value:g}, allowed {describe_range(path)}; correct the value or its unit"
        )
    return float(value)


def read_quantity(path: str, table: Any, unit: str, where: str) -> Quantity:
    """Quantity from its table in a file, which must have value, unit, u, basis and source; `InputError` where one is
    missing or wrong, or the unit is not ``unit`` (nothing is converted)."""
    if not isinstance(table, dict):
        raise InputError(
            f'{where}: {path}: found {table!r}, allowed a table {{ value, unit = "{unit}", u, basis, source }}'
        )
    wanted = {"value", "unit", "u", "basis", "source"}
    for key in wanted - table.keys():
        raise InputError(f"{where}: {path}.{key}: missing; a quantity needs value, unit, u, basis and source")
    for key in table.keys() - wanted:
        raise InputError(f"{where}: {path}.{key}: unknown key; allowed value, unit, u, basis and source")
    if table["unit"] != unit:
        raise InputError(f'{where}: {path}.unit: found "{table["unit"]}", allowed "{unit}"; convert the value')
    value = check_value(path, table["value"], where)
    u = table["u"]
    if isinstance(u, bool) or not isinstance(u, (int, float)) or not math.isfinite(u) or u < 0.0:
        raise InputError(f"{where}: {path}.u: found {u!r}, allowed a standard uncertainty from 0 in {unit}")
    if table["basis"] not in get_args(Basis):
        raise InputError(f"{where}: {path}.basis: found {table['basis']!r}, allowed {', '.join(get_args(Basis))}")
    if not isinstance(table["source"], str) or not table["source"].strip():
        raise InputError(f"{where}: {path}.source: found {table['source']!r}, allowed a text that names the source")
    return Quantity(value, unit, float(u), table["basis"], table["source"])


def quantity_tables(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Paths of a parsed file with their content: a quantity's table or a text."""
    for key, item in table.items():
        path = f"{prefix}{key}"
        if isinstance(item, dict) and not {"value", "unit"} & item.keys():
            yield from quantity_tables(item, f"{path}.")
        else:
            yield path, item
