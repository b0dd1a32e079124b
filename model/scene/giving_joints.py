"""Joints that give: directions in which the pivots of bodies move, and the numbers of their bushings.

A choice and an action in; rows of `model.kernels.layout.Tables.pin` and numbers out. Decision:
docs/explanation/effects.md.
"""

from __future__ import annotations

from collections.abc import Sequence

from model.errors import InputError
from model.parameters.action import Action
from model.parameters.effects import PINS, RAIL
from model.scene.selection import SceneChoice

AXES = ("x", "y")


def pins_and_numbers(
    action: Action, choice: SceneChoice, bodies: Sequence[str], prescribed: bool
) -> tuple[list[list[int]], list[float]]:
    """Body and direction, 0 to the right and 1 up, of each way in which a joint gives; their numbers in p.

    A key on its balance rail gives to the side only. Where the key's motion is ``prescribed``, joints are rigid.
    """
    pins: list[list[int]] = []
    numbers: list[float] = []
    for effect, body in PINS.items():
        if effect not in choice.effects:
            continue
        if prescribed:
            raise InputError(f"scene: found a prescribed key and the effect {effect}, allowed one of them")
        if body not in bodies:
            raise InputError(f"scene: effects: {effect} needs the {body}; add {body} or leave out {effect}")
        for axis, name in enumerate(AXES):
            if not (body == "key" and name == "y" and RAIL in choice.effects):
                pins.append([bodies.index(body), axis])
                numbers += [action[f"{effect}.{k}"] for k in ("stiffness", "damping", f"load.{name}")]
    return pins, numbers
