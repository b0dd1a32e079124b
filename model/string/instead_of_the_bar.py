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
from model.errors import InputError
from model.files.force_table import check_force_table
from model.force_driven import output_times, simulate
from model.observables import head_approach_m_per_s
from model.parameters.action import STRING, USUAL, Action
from model.scene.build import build_scene
from model.scene.selection import choice_of
from model.string.blow import Hammer, String, strike

LOUDEST_HZ = 5000.0
RATE_HZ = 5000.0  # at which the blow is looked at, however coarse its table

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
    InputError : the hammer does not reach the string, its felt follows another law, its shank or its joint gives; or a
        scene that lacks a body or the string, or is not driven by a force

    Examples
    --------
    >>> import model
    >>> hammer, speed = model.string.hammer_at_the_string(model.load_action(), *model.force_table("forte"))
    >>> 0.005 < hammer.mass_kg < 0.012
    True
    """
    choice = choice_of(action)
    choice.need_played_key(action.name)
    found: list[str] = [name for name in ("shank", "hammer_pin") if name in choice.effects]
    found += [action.law(STRING)] if action.law(STRING) != USUAL else []
    if found:
        raise InputError(
            f"hammer at the string: found {', '.join(found)}, allowed a stiff hammer on a rigid pin whose felt "
            f"({STRING}.law) is {USUAL}; take another scene or law, or simulate the scene string"
        )
    if STRING not in build_scene(action).contacts:
        raise InputError(f"string: found a scene without {STRING}, allowed one in which the hammer meets it")
    times, forces = check_force_table(time_s, force_n)
    blow = simulate(action, times, forces, output_time_s=output_times(times[0], times[-1], RATE_HZ))
    met = np.flatnonzero(blow.hammer_height_m(action) < 0.0)
    if not len(met):
        raise InputError("string: the hammer does not reach it under this force; allowed a blow that strikes")
    turning = (np.array(blow.bodies) == "hammer").astype(float)
    lever = float(head_approach_m_per_s(action, blow.bodies, blow.angle_rad[met[0]], turning))
    before = blow.speed_rad_per_s[max(met[0] - 1, 0)] @ turning
    x, y = action["hammer.center_of_mass.x"], action["hammer.center_of_mass.y"]
    inertia = action["hammer.inertia"] + action["hammer.mass"] * (x * x + y * y)
    law = [action[f"{STRING}.normal.{name}"] for name in ("a", "b", "c", "D")]
    return Hammer(inertia / lever**2, *law), lever * float(before)


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
