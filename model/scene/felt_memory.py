"""What the felt of a scene's contacts remembers: its numbers, and the states it starts with.

An action's law for each contact in; rows of `model.kernels.layout.Tables.memory` and numbers out. Felt that is not
passive under its law is refused: it would give energy (docs/explanation/felt.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError
from model.kernels import layout as L
from model.parameters.action import CONTACTS, Action
from model.parameters.felt_laws import HUNT_CROSSLEY, HYSTERESIS, STULOV

MEMORIES = ("", "2", "3")
"""Ends of the names of the numbers of hysteresis, one for each memory."""


def memories_of(action: Action, contact: str) -> list[tuple[int, float, float]]:
    """Law, share and time or reach of each state that a contact's felt remembers; empty for the thesis's law."""
    law = action.law(contact) if contact in CONTACTS else HUNT_CROSSLEY
    if law == HUNT_CROSSLEY:
        return []
    a, b, c = (action[f"{contact}.normal.{k}"] for k in ("a", "b", "c"))
    if b < 0.0 and b * b > 3.0 * a * c * (1.0 + 1e-9):
        raise InputError(
            f"{contact}.law: found {law} on felt with normal.b {b:g}, allowed from {-math.sqrt(3.0 * a * c):.6g}: "
            "felt that softens as it is pressed would give energy"
        )
    if law == STULOV:
        return [(L.STULOV, action[f"{contact}.stulov.epsilon"], action[f"{contact}.stulov.tau"])]
    pairs = [(action[f"{contact}.{HYSTERESIS}.beta{k}"], action[f"{contact}.{HYSTERESIS}.eta{k}"]) for k in MEMORIES]
    out = [(L.HYSTERESIS, beta, eta) for beta, eta in pairs if beta > 0.0]
    if not out:
        raise InputError(f'{contact}.hysteresis.beta: found 0, allowed above 0; or {contact}.law = "{HUNT_CROSSLEY}"')
    if sum(beta for _, beta, _ in out) > 1.0:
        total = sum(beta for _, beta, _ in out)
        raise InputError(f"{contact}.hysteresis: sum of beta found {total:g}, allowed to 1: felt cannot pull")
    return out


def rested(tables: L.Tables, vector: NDArray[np.float64], depth_m: Sequence[float]) -> NDArray[np.float64]:
    """Memories (z,) of felt that came to these depths (c,) on the way in and has rested there."""
    out = np.empty(len(tables.memory))
    for m, (contact, law) in enumerate(tables.memory):
        o = tables.offset[1] + L.CONTACT_SIZE * contact
        x = max(0.0, float(depth_m[contact]))
        a, b, c = vector[o + L.K_A : o + L.K_C + 1]
        out[m] = ((a * x + b) * x + c) * x if law == L.STULOV else 1.0
    return out
