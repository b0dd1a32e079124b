"""A string in place of the rigid bar: the modes that a hammer at its place moves, as numbers for the kernels.

An action's section ``string`` in; numbers of `model.kernels.layout` (`STRING_HEAD`) out. Derivation, and what is left
out: docs/decisions/0192-string-in-the-action.md.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError
from model.kernels.layout import STRING_STATES
from model.kernels.workspace import MOST_MODES
from model.parameters.action import STRING as CONTACT
from model.parameters.action import Action
from model.parameters.felt_laws import HUNT_CROSSLEY
from model.parameters.string import String

LEFT_OUT = 20_000  # modes up to which those left out are summed as a spring
NODE = 1e-6  # height of a mode at the hammer below which it is not moved

Array = NDArray[np.float64]


def string_of(action: Action) -> String:
    """The string of an action's section ``string``."""
    names = "length", "mass", "tension", "stiffness", "b1", "b2", "struck_at"
    return String(*(action[f"string.{name}"] for name in names))


def moved_modes(action: Action) -> Array:
    """Numbers (k,) of the modes that take part: the first that are not at rest at the hammer's place and that swing."""
    count = round(action["string.modes"])
    if not 1 <= count <= MOST_MODES:
        raise InputError(f"string.modes: found {count}, allowed 1 to {MOST_MODES}")
    string, n = string_of(action), np.arange(1.0, LEFT_OUT)
    moved = (np.abs(string.shape(n)) > NODE) & (string.decay(n) < 0.99 * string.omega(n))
    return n[moved][:count]


def string_numbers(action: Action) -> list[float]:
    """How many modes, what those left out give way, then gains, stiffnesses and dampings of the modes."""
    if action.law(CONTACT) != HUNT_CROSSLEY:
        raise InputError(f"string: found {CONTACT}.law {action.law(CONTACT)}, allowed {HUNT_CROSSLEY} under a string")
    if action[f"{CONTACT}.friction.A"] != 0.0:
        raise InputError(f"string: found {CONTACT}.friction.A above 0, allowed 0: the string has one polarisation")
    string, n = string_of(action), moved_modes(action)
    rest = np.setdiff1d(np.arange(1.0, LEFT_OUT), n)
    gain, stiffness = string.shape(n) ** 2 / string.modal_mass_kg, string.omega(n) ** 2
    give = float(np.sum(string.shape(rest) ** 2 / (string.modal_mass_kg * string.omega(rest) ** 2)))
    return [float(len(n)), give, *gain.tolist(), *stiffness.tolist(), *(2.0 * string.decay(n)).tolist()]


def at_rest(numbers: Array, time_s: float) -> Array:
    """States of a string that was at rest at ``time_s``."""
    out = np.zeros(STRING_STATES + 2 * round(float(numbers[0])))
    out[0] = time_s
    return out
