"""Effects a scene may add to an action: a key that can lift off its balance rail, a hammer shank that bends.

Each is a section of parameters (`effects.toml`: defaults with unit and source; paths like ``shank.frequency_hz``), one
more coordinate, and what follows from both for `build_scene`. An effect that a scene does not name is in none of its
tables. What they can and cannot claim: docs/decisions/0033-model-effects.md. Values that no action can have
raise ``InputError``.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from model.errors import InputError
from model.parameters.quantity import Quantity, read_quantity

if TYPE_CHECKING:
    from model.parameters.action import Action

FILE = Path(__file__).with_name("effects.toml")
EFFECTS = ("balance_rail", "shank", "motor_arm")
KEY_LIFT, SHANK, MOTOR = "key_lift", "shank", "motor"  # coordinates: m, rad, rad
RAIL = "balance_rail"
RAIL_RADIUS = 1e-3  # m; drops out of a force that is vertical and free of friction
LARGEST_LIFT = 0.02  # m, up to which bounds on gaps hold; a pin is not much longer
ON_THE_HEAD = ("contact04", "contact12", "contact13")  # back check, string, rest rail: beyond the shank's hinge


@cache
def effect_defaults() -> Mapping[str, Quantity]:
    """Quantities of all effects by path, from `effects.toml`."""
    from model.parameters.action import quantity_tables

    table = tomllib.loads(FILE.read_text(encoding="utf-8"))
    return {path: read_quantity(path, item, item["unit"], str(FILE)) for path, item in quantity_tables(table)}


def effect_of(path: str) -> str | None:
    """Name of the effect a parameter path belongs to."""
    section = path.split(".")[0]
    return section if section in EFFECTS else None


def column(coordinate: str, rate: bool = False) -> str:
    """Name of the output column of a coordinate, or of its rate."""
    unit = "m" if coordinate == KEY_LIFT else "rad"
    return f"{coordinate}_{unit}" + ("_per_s" if rate else "")


def sink_m(action: Action) -> float:
    """How deep the rail's felt is pressed in (m) when the key's pivot is where the set says."""
    a, b, c = (action[f"{RAIL}.normal.{k}"] for k in ("a", "b", "c"))
    load = action[f"{RAIL}.load_at_rest"]
    if c <= 0.0 or b < 0.0:
        raise InputError(
            f"{RAIL}.normal: found b {b:g}, c {c:g}; allowed c above 0 and b from 0 (the washer is always stiff)"
        )
    x = load / c  # from the right: the law is convex there
    for _ in range(100):
        step = (((a * x + b) * x + c) * x - load) / ((3.0 * a * x + 2.0 * b) * x + c)
        x -= step
        if abs(step) <= 1e-15 * abs(x):
            break
    return x


def rail_contact(action: Action) -> list[float]:
    """Numbers of the rail's contact, as of any other: a circle round the key's pivot on level felt of the ground."""
    x, y = action["key.pivot.x"], action["key.pivot.y"]
    law = [action[f"{RAIL}.normal.{k}"] for k in ("a", "b", "c", "D")]
    level = y - RAIL_RADIUS + sink_m(action)
    return [0.0, 0.0, RAIL_RADIUS, x, level, 0.0, 0.0, 1.0, 0.0, 0.0, *law, 0.0, 0.0, 0.0]


def parts_of_hammer(action: Action) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Mass, centre of mass (x, y) and inertia about it of butt and head; both together are the hammer as given.

    The head's centre of mass is in its own frame, which has its origin at the hinge.
    """
    mass, inertia = action["hammer.mass"], action["hammer.inertia"]
    cx, cy = action["hammer.center_of_mass.x"], action["hammer.center_of_mass.y"]
    m, i = action["shank.near.mass"], action["shank.near.inertia"]
    x, y = action["shank.near.center_of_mass.x"], action["shank.near.center_of_mass.y"]
    far = mass - m
    if not far > 0.0:
        raise InputError(f"shank.near.mass: found {m:g} kg, allowed below the hammer's {mass:g} kg")
    fx, fy = (mass * cx - m * x) / far, (mass * cy - m * y) / far
    about = inertia + mass * (cx * cx + cy * cy) - i - m * (x * x + y * y) - far * (fx * fx + fy * fy)
    if not about > 0.0:
        raise InputError(
            f"shank.near: leaves the head an inertia of {about:.3g} kg m^2, allowed above 0; "
            "bring its mass, inertia or centre of mass nearer to the pivot"
        )
    hx, hy = action["shank.hinge.x"], action["shank.hinge.y"]
    return (m, x, y, i), (far, fx - hx, fy - hy, about)


def bending(action: Action) -> tuple[float, float, float]:
    """Stiffness (N m/rad) and damping (N m s/rad) of the shank's hinge, frequency (Hz) with the butt held.

    In free flight about the pivot the head swings against the butt with the modal inertia J = M_ss - M_hs^2 / M_hh.
    """
    (m, x, y, i), (far, fx, fy, about) = parts_of_hammer(action)
    hx, hy = action["shank.hinge.x"], action["shank.hinge.y"]
    own = about + far * (fx * fx + fy * fy)
    shared = own + far * (fx * hx + fy * hy)
    whole = i + m * (x * x + y * y) + about + far * ((fx + hx) ** 2 + (fy + hy) ** 2)
    modal = own - shared * shared / whole
    turn = 2.0 * math.pi * action["shank.frequency_hz"]
    stiffness = modal * turn * turn
    return stiffness, 2.0 * action["shank.damping_ratio"] * modal * turn, math.sqrt(stiffness / own) / (2.0 * math.pi)
