"""What changes in a blow when felt follows another law, or a string stands for the bar, everything else equal.

An action and a force table in; `Effect` rows out: let-off, strike, rebound, check, touch, each with the standard
uncertainty that the declared parameters of the law or the string give. The slow loading curve of every felt stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import IntegrationError, StaticsError
from model.files.force_table import check_force_table
from model.force_driven import output_times, simulate
from model.observables import hammer_height_m
from model.parameters.action import (
    BACK_CHECK,
    BODIES,
    CONTACTS,
    JACK_KNUCKLE,
    KEY_FRONT,
    LEVER_KNUCKLE,
    STRING,
    USUAL,
    Action,
)
from model.parameters.quantity import allowed_range
from model.scene.selection import SceneChoice, load_scene
from model.study.blow_measures import measure_blow
from model.touch.hammer_speed import approach_speed
from model.touch.weights import weigh

Array = NDArray[np.float64]

RATE_HZ = 20_000.0
TOLERANCE = 1e-6
LONGEST_CONTACT_S = 0.01
HAMMER = BODIES.index("hammer")
FELTS: Mapping[str, tuple[str, ...]] = {
    "hammer": (STRING,),
    "key front": (KEY_FRONT,),
    "back check": (BACK_CHECK,),
    "all felts": CONTACTS,
}
NUMBERS = {"stulov": ("stulov.epsilon", "stulov.tau"), "hysteresis": ("hysteresis.beta", "hysteresis.eta")}
OF_THE_STRING = ("length", "mass", "tension", "stiffness", "b1", "b2", "struck_at")


@dataclass(frozen=True)
class Effect:
    """What a blow and the touch are like with one law or string.

    Attributes
    ----------
    of, law : which felts, and their law; or "string" and "bar" or "modes"
    value, u : mark -> value and standard uncertainty from the declared parameters; NaN where something did not happen.
        free_flight_ms (knuckle's last touch to strike), strike_m_per_s, contact_ms, rebound (share of the strike's
        speed), check_mm (hammer below the string in the check), down_n, let_off_n
    held : caught by the back check
    """

    of: str
    law: str
    value: Mapping[str, float]
    u: Mapping[str, float]
    held: bool


def felt_law_effects(
    action: Action, time_s: ArrayLike, force_n: ArrayLike, felts: Mapping[str, Sequence[str]] = FELTS
) -> list[Effect]:
    """Change the law of some felts at a time: first the thesis's for all, then each group with each other law.

    Parameters
    ----------
    action : parameter set; its own laws are set aside
    time_s, force_n : (k,) force table
    felts : name of a group -> its contacts

    Returns
    -------
    list of Effect
        Uncertain by u of each law's own numbers, the same for all felts of a group.

    Raises
    ------
    InputError : a felt that a law with memory cannot have
    StaticsError, IntegrationError : the action cannot play this blow

    Examples
    --------
    >>> import model
    >>> blow = model.force_table("forte")
    >>> base, *others = model.study.felt_law_effects(
    ...     model.load_action("hirschkorn2004-regulated"), *blow, {"key front": ["contact02"]})
    >>> [effect.law for effect in others]
    ['stulov', 'hysteresis']
    """
    plain = action.with_laws(dict.fromkeys(CONTACTS, USUAL))
    blow = check_force_table(time_s, force_n)
    out = [effect_of("all felts", USUAL, [plain], lambda a: touch_and_blow(a, blow))]
    for name, contacts in felts.items():
        for law, numbers in NUMBERS.items():
            given = plain.with_laws(dict.fromkeys(contacts, law))
            paths = [[f"{contact}.{number}" for contact in contacts] for number in numbers]
            out.append(effect_of(name, law, [given, *varied_by_u(given, paths)], lambda a: touch_and_blow(a, blow)))
    return out


def string_effects(action: Action, time_s: ArrayLike, force_n: ArrayLike) -> list[Effect]:
    """The same blow on the bar and on a string of modes, inside the moving action.

    Parameters
    ----------
    action : parameter set with its section ``string``
    time_s, force_n : (k,) force table

    Returns
    -------
    list of Effect
        Bar, then string, uncertain by u of the string's numbers; the touch of a key does not reach it.

    Raises
    ------
    StaticsError, IntegrationError : the action cannot play this blow

    Examples
    --------
    >>> import model
    >>> bar, string = model.study.string_effects(model.load_action(), *model.force_table("forte"))
    >>> string.value["contact_ms"] > 2.0 * bar.value["contact_ms"]
    True
    """
    blow = check_force_table(time_s, force_n)
    strung, paths = load_scene("string"), [[f"string.{name}"] for name in OF_THE_STRING]
    return [
        effect_of("string", "bar", [action], lambda a: _blow_marks(a, blow, SceneChoice())),
        effect_of("string", "modes", [action, *varied_by_u(action, paths)], lambda a: _blow_marks(a, blow, strung)),
    ]


Marks = dict[str, float]


def varied_by_u(action: Action, paths: Sequence[Sequence[str]]) -> list[Action]:
    """For each group of paths the action with all of them down by u, then up, within what is allowed."""
    out = []
    for group in paths:
        low, high, _ = allowed_range(group[0])
        for sign in (-1.0, 1.0):
            values = {p: min(high, max(low, action[p] + sign * action.effects[p].u)) for p in group}
            out.append(action.with_effects(values))
    return out


def effect_of(of: str, law: str, actions: Sequence[Action], marks: Callable[[Action], Marks]) -> Effect:
    """Marks of the first action; half of what each pair of the others differ, added in squares."""
    found = [marks(action) for action in actions]
    value = {name: x for name, x in found[0].items() if name != "held"}
    pairs = list(zip(found[1::2], found[2::2], strict=True))
    u = {name: math.sqrt(sum((0.5 * (b[name] - a[name])) ** 2 for a, b in pairs)) for name in value}
    return Effect(of, law, value, u, bool(found[0]["held"]))


def touch_and_blow(action: Action, blow: tuple[Array, Array]) -> Marks:
    """Of the blow, and of a slow press."""
    out = _blow_marks(action, blow, SceneChoice())
    try:
        weights = weigh(action)
        return out | {"down_n": weights.down_n, "let_off_n": weights.let_off_n}
    except (IntegrationError, StaticsError):
        return out | {"down_n": math.nan, "let_off_n": math.nan}


def _blow_marks(action: Action, blow: tuple[Array, Array], choice: SceneChoice) -> Marks:
    times, forces = blow
    at = output_times(float(times[0]), float(times[-1]), RATE_HZ)
    solution = simulate(action, times, forces, scene=choice, tolerance=TOLERANCE, output_time_s=at, contact_forces=True)
    normal = solution.contact_normal_n
    assert normal is not None
    found = measure_blow(action, solution, np.interp(at, times, forces))
    knuckle, string = (
        normal[:, [solution.contacts.index(c) for c in names if c in solution.contacts]].max(axis=1, initial=0.0) > 0.0
        for names in ((JACK_KNUCKLE, LEVER_KNUCKLE), (STRING,))
    )
    out = dict.fromkeys(("free_flight_ms", "contact_ms", "rebound"), math.nan)
    if found.strikes:
        before = np.flatnonzero(knuckle & (at < found.strike_s))
        out["free_flight_ms"] = 1e3 * (found.strike_s - float(at[before[-1]])) if len(before) else math.nan
        near = np.flatnonzero(string & (at > found.strike_s - 1e-4) & (at < found.strike_s + LONGEST_CONTACT_S))
        if len(near) > 1:
            k = int(near[-1]) + 1
            leaving = solution.angle_rad[k : k + 1, HAMMER], solution.speed_rad_per_s[k : k + 1, HAMMER]
            speed = approach_speed(action, *leaving)
            out["contact_ms"] = 1e3 * float(at[near[-1]] - at[near[0]])
            out["rebound"] = -float(speed[0]) / found.strike_m_per_s
    height = float(hammer_height_m(action, solution.angle_rad[:1])[0])
    check = 1e3 * found.hold_m if found.hold_m < 0.9 * height else math.nan
    return out | {"strike_m_per_s": found.strike_m_per_s, "check_mm": check, "held": float(found.held)}
