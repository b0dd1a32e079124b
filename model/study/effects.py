"""Compare one blow under other laws of felt, and with compliant joints.

Everything else stays equal: the slow loading curve of every felt, and at rest the place of every pin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.errors import IntegrationError, StaticsError
from model.files.force_table import check_force_table
from model.force_driven import output_times, simulate
from model.observables import hammer_height_m
from model.parameters.action import (
    BACK_CHECK,
    CONTACTS,
    JACK_KNUCKLE,
    KEY_FRONT,
    LEVER_KNUCKLE,
    STRING,
    USUAL,
    Action,
    ActionLike,
    as_action,
)
from model.parameters.effects import KEY_LIFT, PINS, RAIL
from model.parameters.quantity import allowed_range
from model.scene.selection import SceneChoice, choice_of, load_scene
from model.study.blow_measures import measure_blow
from model.touch.weights import weigh

Array = NDArray[np.float64]
Blow = tuple[Array, Array]
Marks = dict[str, float]

RATE_HZ = 20_000.0
TOLERANCE = 1e-6
LONGEST_CONTACT_S = 0.01  # s, of hammer and string
FELTS: Mapping[str, tuple[str, ...]] = {
    "hammer": (STRING,),
    "key front": (KEY_FRONT,),
    "back check": (BACK_CHECK,),
    "all felts": CONTACTS,
}
NUMBERS = {"stulov": ("stulov.epsilon", "stulov.tau"), "hysteresis": ("hysteresis.beta", "hysteresis.eta")}
OF_JOINTS = ("strike_ms", "bottom_ms", "give_mm")  # marks that a law of felt leaves out
RIGID = {"stiffness": 1e8, "damping": 500.0}
"""N/m, N s/m of joints that give no more: a thousandth of what cloth does, in the same scene, which compiles once."""
FACTORS = (0.2, 0.5, 1.0, 2.0, 5.0, 20.0, 100.0)
PLAIN, ALL, WITH_RAIL = (SceneChoice(effects=effects) for effects in ((), tuple(PINS), (RAIL, *PINS)))


@dataclass(frozen=True)
class Effect:
    """What a blow and the touch are like with one law or joint.

    Attributes
    ----------
    of, law : which felts, and their law; which joint, and "rigid" or "gives"
    value, u : mark -> value and standard uncertainty from the declared parameters; NaN where something did not happen.
        free_flight_ms (knuckle's last touch to strike), strike_m_per_s, contact_ms, rebound (share of the strike's
        speed), check_mm (hammer below the string in the check), down_n, let_off_n; of joints also strike_ms, bottom_ms
        (the key meets its front felt), give_mm (farthest that any joint gives, or the key lifts, after the start)
    held : caught by the back check
    """

    of: str
    law: str
    value: Mapping[str, float]
    u: Mapping[str, float]
    held: bool


def felt_law_effects(
    action: ActionLike, time_s: ArrayLike, force_n: ArrayLike, felts: Mapping[str, Sequence[str]] = FELTS
) -> list[Effect]:
    """Change the law of some felts at a time: first the thesis's for all, then each group with each other law.

    Parameters
    ----------
    action : parameter set; its own laws and scene are set aside
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
    action = as_action(action)
    plain = with_usual_felts(action)
    blow = check_force_table(time_s, force_n)
    out = [estimate_effect("all felts", USUAL, [plain], lambda a: touch_and_blow_marks(a, blow))]
    for name, contacts in felts.items():
        for law, numbers in NUMBERS.items():
            given = plain.with_laws(dict.fromkeys(contacts, law))
            paths = [[f"{contact}.{number}" for contact in contacts] for number in numbers]
            out.append(
                estimate_effect(
                    name, law, [given, *vary_by_uncertainty(given, paths)], lambda a: touch_and_blow_marks(a, blow)
                )
            )
    return out


def joint_effects(action: ActionLike, time_s: ArrayLike, force_n: ArrayLike) -> list[Effect]:
    """The blow with rigid joints, with one joint that gives, with all, with the key on its rail, with both.

    Parameters
    ----------
    action : parameter set with its sections ``key_pin`` and so on
    time_s, force_n : (k,) force table

    Returns
    -------
    list of Effect
        Uncertain by stiffness and damping of each bushing by itself.

    Raises
    ------
    StaticsError, IntegrationError : the action cannot play this blow

    Examples
    --------
    >>> import model
    >>> blow = model.force_table("forte")
    >>> effects = model.study.joint_effects(model.load_action("hirschkorn2004-regulated"), *blow)
    >>> [effect.of for effect in effects][:2]
    ['none', 'key_pin']
    """
    action = as_action(action)
    action = preload_joints(action)
    blow = check_force_table(time_s, force_n)
    out = [estimate_effect("none", "rigid", [action], lambda a: blow_marks(a, blow, PLAIN))]

    def add(name: str, given: Action, effects: Sequence[str], choice: SceneChoice) -> None:
        numbers = ("normal.c", "normal.D") if effects == [RAIL] else ("stiffness", "damping")
        actions = [given, *vary_by_uncertainty(given, [[f"{effect}.{k}"] for effect in effects for k in numbers])]
        out.append(estimate_effect(name, "gives", actions, lambda a: blow_marks(a, blow, choice)))

    for pin in PINS:
        add(pin, action.with_effects({f"{o}.{k}": x for o in PINS if o != pin for k, x in RIGID.items()}), [pin], ALL)
    add("all five", action, list(PINS), ALL)
    add(RAIL, action, [RAIL], load_scene("lifting-key"))
    add("all, rail", action, list(PINS), WITH_RAIL)
    return out


def joint_sweep(
    action: ActionLike, time_s: ArrayLike, force_n: ArrayLike, factors: ArrayLike = FACTORS
) -> dict[float, dict[str, float]]:
    """Marks of the blow, as in `joint_effects`, with all stiffnesses of joints times a factor, dampings times its root.

    Parameters
    ----------
    action : parameter set
    time_s, force_n : (k,) force table
    factors : of the declared stiffnesses

    Returns
    -------
    dict
        Factor -> marks; at a factor of 0 those of rigid joints.

    Raises
    ------
    StaticsError, IntegrationError : the action cannot play this blow

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> found = model.study.joint_sweep(action, *model.force_table("forte"), [10.0])
    >>> abs(found[10.0]["strike_m_per_s"] / found[0.0]["strike_m_per_s"] - 1.0) < 0.02
    True
    """
    action = as_action(action)
    action = preload_joints(action)
    blow = check_force_table(time_s, force_n)
    out = {0.0: blow_marks(action, blow, PLAIN)}
    for factor in as_numbers(factors, "factors", 1).tolist():
        shares = {"stiffness": factor, "damping": math.sqrt(factor)}
        values = {f"{pin}.{k}": share * action[f"{pin}.{k}"] for pin in PINS for k, share in shares.items()}
        out[factor] = blow_marks(action.with_effects(values), blow, ALL)
    return out


def with_usual_felts(action: Action) -> Action:
    """The action by itself, without effects, with the thesis's law for every felt."""
    return PLAIN.apply_to(_with_inactive_values(action)).with_laws(dict.fromkeys(CONTACTS, USUAL))


def _with_inactive_values(action: Action) -> Action:
    """The action whose own values of effects and laws wait where a scene of the study has none of these."""
    return replace(action, changed={})


def preload_joints(action: Action) -> Action:
    """The action with the loads of its joints, and of its rail, at which it rests as it does on rigid joints."""
    action = _with_inactive_values(action)
    still = simulate(action, np.array([0.0, 1e-3]), np.zeros(2), scene=PLAIN, inside=True).inside
    assert still is not None
    loads = {
        f"{pin}.load.{axis}": float(still.joint_n[0, still.bodies.index(body), k])
        for pin, body in PINS.items()
        for k, axis in enumerate("xy")
    }
    return action.with_effects({**loads, f"{RAIL}.load_at_rest": loads["key_pin.load.y"]})


def vary_by_uncertainty(action: Action, paths: Sequence[Sequence[str]]) -> list[Action]:
    """For each group of paths the action with all of them down by u, then up, within what is allowed."""
    out = []
    for group in paths:
        low, high, _ = allowed_range(group[0])
        for sign in (-1.0, 1.0):
            values = {p: min(high, max(low, action[p] + sign * action.effects[p].u)) for p in group}
            out.append(action.with_effects(values))
    return out


def estimate_effect(of: str, law: str, actions: Sequence[Action], marks: Callable[[Action], Marks]) -> Effect:
    """Marks of the first action; half of what each pair of the others differ, added in squares."""
    found = [marks(action) for action in actions]
    value = {name: x for name, x in found[0].items() if name != "held"}
    pairs = list(zip(found[1::2], found[2::2], strict=True))
    u = {name: math.sqrt(sum((0.5 * (b[name] - a[name])) ** 2 for a, b in pairs)) for name in value}
    return Effect(of, law, value, u, bool(found[0]["held"]))


def touch_and_blow_marks(action: Action, blow: Blow) -> Marks:
    marks = blow_marks(action, blow, choice_of(action))
    out = {name: x for name, x in marks.items() if name not in OF_JOINTS}
    try:
        weights = weigh(action)
        return out | {"down_n": weights.down_n, "let_off_n": weights.let_off_n}
    except (IntegrationError, StaticsError):
        return out | {"down_n": math.nan, "let_off_n": math.nan}


def blow_marks(action: Action, blow: Blow, choice: SceneChoice) -> Marks:
    times, forces = blow
    at = output_times(float(times[0]), float(times[-1]), RATE_HZ)
    moved = simulate(action, times, forces, scene=choice, tolerance=TOLERANCE, output_time_s=at, contact_forces=True)
    normal = moved.contact_normal_n
    assert normal is not None
    found = measure_blow(action, moved, np.interp(at, times, forces))
    knuckle, bottom, string = (
        normal[:, [moved.contacts.index(c) for c in names if c in moved.contacts]].max(axis=1, initial=0.0) > 0.0
        for names in ((JACK_KNUCKLE, LEVER_KNUCKLE), (KEY_FRONT,), (STRING,))
    )
    out = dict.fromkeys(("free_flight_ms", "contact_ms", "rebound"), math.nan)
    if found.strikes:
        before = np.flatnonzero(knuckle & (at < found.strike_s))
        out["free_flight_ms"] = 1e3 * (found.strike_s - float(at[before[-1]])) if len(before) else math.nan
        near = np.flatnonzero(string & (at > found.strike_s - 5e-4) & (at < found.strike_s + LONGEST_CONTACT_S))
        if len(near) > 1 and (k := int(near[-1]) + 1) < len(at):  # else the table ends while it is on the string
            speed = float(moved.hammer_approach_m_per_s(action)[k])
            out["contact_ms"] = 1e3 * float(at[near[-1]] - at[near[0]])
            out["rebound"] = -speed / found.strike_m_per_s
    height = float(hammer_height_m(action, moved.angle_rad[:1])[0])
    ways = [moved.give.way_m] if moved.give is not None else []
    ways += [moved.angle_rad[:, [moved.bodies.index(KEY_LIFT)]]] if KEY_LIFT in moved.bodies else []
    return out | {
        "strike_ms": 1e3 * found.strike_s,
        "bottom_ms": 1e3 * float(at[int(np.argmax(bottom))]) if np.any(bottom) else math.nan,
        "strike_m_per_s": found.strike_m_per_s,
        "check_mm": 1e3 * found.hold_m if found.hold_m < 0.9 * height else math.nan,
        "give_mm": 1e3 * max((float(np.max(np.abs(way - way[0]))) for way in ways), default=0.0),
        "held": float(found.held),
    }
