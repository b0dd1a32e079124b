"""The hammer of an action on a string instead of the bar that the model has there: everything else equal.

The action is simulated under a blow up to the string; mass along the way and speed at first touch, and the felt of
contact 12, then meet the bar (rigid, as in the model) and a string. Only the blow itself is compared: what the other
rebound does to the check is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from model.arrays import as_numbers
from model.derived.columns import DEPTH
from model.derived.observe import contacts_at
from model.errors import InputError
from model.force_driven import simulate
from model.parameters.action import BODIES, USUAL, Action
from model.scene.build import build_scene
from model.scene.selection import choice_of
from model.string.blow import Hammer, String, strike

STRING_CONTACT = "contact12"
LOUDEST_HZ = 5000.0
_NUDGE = 1e-6  # rad, for the lever of the contact

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StringBlow:
    """One blow on bar or string.

    Attributes
    ----------
    against : bar, string or choir
    speed_m_per_s : of the hammer before
    contact_s, peak_n, rebound : time touched, largest force, speed after over before
    n_contacts, n_modes : touches of the string; modes used, 0 for the bar
    slope_db_per_octave : of the partials up to 5 kHz; NaN for the bar
    """

    against: str
    speed_m_per_s: float
    contact_s: float
    peak_n: float
    rebound: float
    n_contacts: int
    n_modes: int
    slope_db_per_octave: float


def hammer_at_the_string(action: Action, time_s: ArrayLike, force_n: ArrayLike) -> tuple[Hammer, float]:
    """Hammer with the felt of contact 12, and its speed, m/s, at first touch of the bar under a force (n,).

    Parameters
    ----------
    action : whose hammer strikes
    time_s, force_n : (n,) s and N, on the key

    Returns
    -------
    tuple
        The hammer, and its speed.

    Raises
    ------
    InputError : the hammer does not reach the string, its felt follows another law, its shank or its joint gives

    Examples
    --------
    >>> import model
    >>> hammer, speed = model.string.hammer_at_the_string(model.load_action(), *model.force_table("forte"))
    >>> 0.005 < hammer.mass_kg < 0.012
    True
    """
    effects = choice_of(action).effects
    found: list[str] = [name for name in ("shank", "hammer_pin") if name in effects]
    found += [action.law(STRING_CONTACT)] if action.law(STRING_CONTACT) != USUAL else []
    if found:
        raise InputError(
            f"hammer at the string: found {', '.join(found)}, allowed a stiff hammer on a rigid pin whose felt "
            f"({STRING_CONTACT}.law) is {USUAL}; take another scene or law, or simulate the scene string"
        )
    blow = simulate(action, time_s, force_n)
    scene = build_scene(action)
    at = scene.contacts.index(STRING_CONTACT)

    def depth(q: Array) -> Array:
        return contacts_at(scene.static_tables, scene.vector, q, np.zeros_like(q))[:, at, DEPTH]

    pressed = depth(blow.angle_rad) > 0.0
    if not pressed.any():
        raise InputError("string: the hammer does not reach it under this force; allowed a blow that strikes")
    k, hammer = int(np.argmax(pressed)), BODIES.index("hammer")
    here = np.repeat(blow.angle_rad[k : k + 1], 2, axis=0)
    here[1, hammer] += _NUDGE
    lever = abs(float(np.diff(depth(here))[0])) / _NUDGE
    x, y = action["hammer.center_of_mass.x"], action["hammer.center_of_mass.y"]
    inertia = action["hammer.inertia"] + action["hammer.mass"] * (x * x + y * y)
    law = [action[f"{STRING_CONTACT}.normal.{name}"] for name in ("a", "b", "c", "D")]
    return Hammer(inertia / lever**2, *law), lever * abs(float(blow.speed_rad_per_s[k - 1, hammer]))


def strike_bar(hammer: Hammer, speed_m_per_s: float) -> StringBlow:
    """The same blow on a bar that does not give."""

    def force(x: float, v: float) -> float:
        fit = ((hammer.a * x + hammer.b) * x + hammer.c) * x + hammer.k * max(x, 0.0) ** hammer.p
        return max(fit, 0.0) * max(1.0 + hammer.d * v, 0.0)

    def rate(_: float, y: Array) -> list[float]:
        return [y[1], -force(y[0], y[1]) / hammer.mass_kg]

    def parted(_: float, y: Array) -> float:
        return float(y[0]) + 1e-12

    parted.terminal, parted.direction = True, -1.0  # type: ignore[attr-defined]
    seen = solve_ivp(rate, (0.0, 0.1), [0.0, speed_m_per_s], events=parted, rtol=1e-9, atol=1e-13, max_step=2e-5)
    peak = max(force(x, v) for x, v in seen.y.T)
    rebound = -float(seen.y[1, -1]) / speed_m_per_s
    return StringBlow("bar", speed_m_per_s, float(seen.t[-1]), float(peak), rebound, 1, 0, float("nan"))


def compare_with_bar(
    hammer: Hammer, speeds_m_per_s: ArrayLike, string: String, mistuning_cents: ArrayLike = (-0.5, 0.0, 0.5)
) -> list[StringBlow]:
    """Bar, one string and a choir under the same hammer at several speeds.

    Parameters
    ----------
    hammer : mass and felt
    speeds_m_per_s : of the hammer before the blow
    string : struck
    mistuning_cents : of the choir's strings

    Returns
    -------
    list of StringBlow
        Three for each speed.

    Raises
    ------
    InputError : a speed that is not above 0

    Examples
    --------
    >>> from model import string
    >>> bar, one, choir = string.compare_with_bar(string.C4_HAMMER, [2.0], string.C4)
    >>> bar.contact_s < choir.contact_s < one.contact_s
    True
    """
    out: list[StringBlow] = []
    choir = as_numbers(mistuning_cents, "mistuning", 1)
    for speed in as_numbers(speeds_m_per_s, "speeds of the hammer", 1).tolist():
        if not (math.isfinite(speed) and speed > 0.0):
            raise InputError(f"speeds of the hammer: found {speed:g} m/s, allowed above 0")
        out.append(strike_bar(hammer, speed))
        for name, cents in (("string", (0.0,)), ("choir", choir)):
            blow = strike(string, hammer, speed, cents, tolerance=1e-3, seconds=0.02)
            slope = blow.slope_db_per_octave(LOUDEST_HZ)
            counts = len(blow.contacts), blow.n_modes
            out.append(StringBlow(name, speed, float(blow.contact_time_s), blow.peak_n, blow.rebound, *counts, slope))
    return out
