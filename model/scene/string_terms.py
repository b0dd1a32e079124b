"""A string in place of the rigid bar: the modes that a hammer at its place moves, as numbers for the kernels.

Derivation, and what is left out: docs/explanation/string_and_motor.md.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError
from model.kernels.workspace import MOST_MODES
from model.parameters.action import STRING as CONTACT
from model.parameters.action import USUAL, Action
from model.parameters.effects import STRING_EFFECT
from model.parameters.string import String
from model.tolerance import DEFAULT_TOLERANCE

LEFT_OUT = 20_000  # modes up to which those left out are summed as a spring
NODE = 1e-4  # height of a mode at the hammer below which it is not moved, whatever a difference by place does to it
# error of an angle (rad) that leaving out all modes beyond the n-th makes, times n squared: 0.02 of a piano, 0.055 of a
# forte, 0.14 of a fortissimo (tests/model/simulation/test_modes_by_tolerance.py)
LEFT_OUT_ERROR = 0.055
FEWEST = 8  # modes of a string

Array = NDArray[np.float64]


def string_of(action: Action) -> String:
    """The string of an action's section ``string``; unisons in tune are one string of all their mass and tension."""
    names = "length", "mass", "tension", "stiffness", "b1", "b2", "struck_at"
    count = round(action["string.unisons"])
    return String(*(action[f"string.{name}"] * (count if name in ("mass", "tension") else 1) for name in names))


def modes_asked(action: Action, tolerance: float = DEFAULT_TOLERANCE) -> int:
    asked = round(action["string.modes"])
    if asked == 0:
        return min(MOST_MODES, max(FEWEST, math.ceil(math.sqrt(LEFT_OUT_ERROR / tolerance))))
    if not 1 <= asked <= MOST_MODES:
        raise InputError(f"string.modes: found {asked}, allowed 0 (as many as the tolerance asks) to {MOST_MODES}")
    return asked


def with_modes(action: Action, tolerance: float, share: float = 1.0) -> Action:
    """Copy with the string modes that ``tolerance`` (rad) needs, or a share of them, unless their count is stated."""
    if STRING_EFFECT not in action.scene.get("effects", ()) or round(action["string.modes"]) != 0:
        return action
    return action.with_effects({"string.modes": max(1.0, float(round(share * modes_asked(action, tolerance))))})


def moved_modes(action: Action) -> Array:
    """Indices (k,), from 1, of the modes simulated: the first that move at the hammer's point and oscillate."""
    count = modes_asked(action)
    string, n = string_of(action), np.arange(1.0, LEFT_OUT)
    moved = (np.abs(string.shape(n)) > NODE) & (string.decay(n) < 0.99 * string.omega(n))  # swings
    return n[moved][:count]


def string_numbers(action: Action) -> list[float]:
    """Number of modes, compliance (m/N) of those left out, then of each mode gain (1/kg), stiffness (1/s^2) and damping
    (1/s); `InputError` for a felt with friction or another law under a string."""
    if action.law(CONTACT) != USUAL:
        raise InputError(f"string: found {CONTACT}.law {action.law(CONTACT)}, allowed {USUAL} under a string")
    if action[f"{CONTACT}.friction.A"] != 0.0:
        raise InputError(f"string: found {CONTACT}.friction.A above 0, allowed 0: the string has one polarisation")
    string, n = string_of(action), moved_modes(action)
    rest = np.setdiff1d(np.arange(1.0, LEFT_OUT), n)
    gain, stiffness = string.shape(n) ** 2 / string.modal_mass_kg, string.omega(n) ** 2
    give = float(np.sum(string.shape(rest) ** 2 / (string.modal_mass_kg * string.omega(rest) ** 2)))
    return [float(len(n)), give, *gain.tolist(), *stiffness.tolist(), *(2.0 * string.decay(n)).tolist()]
