"""Joints that give: directions in which the pivots of bodies move, and the numbers of their bushings.

A choice and an action in; rows of `model.kernels.layout.Tables.pin` and numbers out. Decision:
docs/decisions/0197-joints-that-give.md.
"""

from __future__ import annotations

from collections.abc import Sequence

from model.errors import InputError
from model.parameters.action import Action
from model.parameters.effects import PINS, RAIL
from model.scene.selection import SceneChoice

AXES = ("x", "y")


def pins_of(choice: SceneChoice, bodies: Sequence[str]) -> list[tuple[str, int]]:
    """Body and direction, 0 to the right and 1 up, of each give; a key on its balance rail gives to the side only."""
    out = []
    for effect, body in PINS.items():
        if effect not in choice.effects:
            continue
        if body not in bodies:
            raise InputError(f"scene: effects: {effect} needs the {body}; add {body} or leave out {effect}")
        out += [(body, axis) for axis in (0, 1) if not (body == "key" and axis == 1 and RAIL in choice.effects)]
    return out


def pin_numbers(action: Action, body: str, axis: int) -> list[float]:
    """Stiffness (N/m), damping (N s/m) and load (N) of a direction."""
    return [action[f"{body}_pin.{name}"] for name in ("stiffness", "damping", f"load.{AXES[axis]}")]
