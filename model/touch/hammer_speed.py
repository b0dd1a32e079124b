"""Speed of the hammer at the string for a given force of the blow.

A blow is a force on the key that rises linearly in `RISE` and then is constant. The result is the speed of the hammer's
striking point towards the string (m/s) at first touch, NaN where it never touches.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.errors import InputError
from model.files.force_library import RATE_HZ
from model.force_driven import simulate
from model.parameters.action import ActionLike, as_action
from model.scene.selection import choice_of
from model.simulation.hand_set_rest import hand_set_rest
from model.simulation.run import State

Array = NDArray[np.float64]

FORCES = (1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0)  # N
RISE = 0.02  # s; in faster rises the back check meets the rising hammer from 30 N on (`check_load`)
LONGEST = 0.6  # s, time limit of the softest blow
SAMPLE = 1.0 / RATE_HZ
SHORTEST = 0.1  # s, of a blow: choice, so that the hardest has time to strike


def string_contact_starts(height_m: Array) -> NDArray[np.int64]:
    """Index of the last sample before each touch of the string, (k,)."""
    return np.flatnonzero((height_m[:-1] > 0.0) & (height_m[1:] <= 0.0))


def blow_length_s(force_n: float) -> float:
    """Time limit of a blow: a harder one takes less."""
    return min(LONGEST, max(SHORTEST, LONGEST * FORCES[0] / force_n))


def hammer_speeds(action: ActionLike, forces_n: ArrayLike = FORCES) -> Array:
    """Speed (k,), m/s, of the hammer at the string for blows whose force rises in 20 ms to each of ``forces_n`` (k,),
    N, and stays; NaN where it does not reach the string.

    Parameters
    ----------
    action : parameter set
    forces_n : (k,) forces that rise in 20 ms and then stay, N

    Returns
    -------
    ndarray
        Speeds (k,), m/s; NaN where the hammer does not reach the string.

    Raises
    ------
    InputError : a force that is not above 0; or the scene lacks a body or is not driven by a force
    StaticsError, IntegrationError : the action has no rest state or cannot be simulated

    Examples
    --------
    >>> import model
    >>> soft, loud = model.touch.hammer_speeds(model.load_action(), [5.0, 20.0])
    >>> print(f"{soft:.2f} and {loud:.2f} m/s")
    2.05 and 4.14 m/s
    """
    action = as_action(action)
    choice_of(action).need_played_key(action.name)
    forces = as_numbers(forces_n, "forces of the blows", 1)
    if not (forces > 0.0).all():
        raise InputError(f"forces of the blows: found {forces.min():g} N, allowed above 0")
    rest = hand_set_rest(action)
    times = np.arange(round(LONGEST / SAMPLE) + 1) * SAMPLE
    out = np.full(len(forces), math.nan)
    for i, force in enumerate(forces.tolist()):
        start = State(0.0, rest.copy(), np.zeros(len(rest)))
        end = blow_length_s(force)
        output = times[times <= end]
        blow = simulate(action, [0.0, RISE, end], [0.0, force, force], initial=start, output_time_s=output)
        first = string_contact_starts(blow.hammer_height_m)
        if len(first):  # the last sample before touch, in free flight; just after it the felt has slowed the hammer
            out[i] = blow.hammer_approach_m_per_s[first[0]]
    return out
