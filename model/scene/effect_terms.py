"""Terms that the effects of a scene add to the equations of motion: the rail's contact, the two parts of the hammer.

Derivations and limits: docs/explanation/effects.md.
"""

from __future__ import annotations

import math

from model.errors import InputError
from model.parameters.action import Action
from model.parameters.effects import RAIL

RAIL_RADIUS = 1e-3  # m; drops out of a force that is vertical and free of friction
LARGEST_LIFT = 0.02  # m, up to which bounds on gaps are valid; a pin is not much longer
ON_THE_HEAD = ("contact04", "contact12", "contact13")  # back check, string, rest rail: beyond the shank's hinge


def rail_compression_m(action: Action) -> float:
    """Static compression (m) of the rail's felt with the key's pivot at its nominal position."""
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
    level = y - RAIL_RADIUS + rail_compression_m(action)
    return [0.0, 0.0, RAIL_RADIUS, x, level, 0.0, 0.0, 1.0, 0.0, 0.0, *law, 0.0, 0.0, 0.0]


def parts_of_hammer(action: Action) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Mass (kg), centre of mass (x, y; m), inertia about it (kg m^2): of butt (hammer frame), of head (frame at hinge).

    Both together are the hammer of the action.
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
