"""What changes in a blow when joints give, everything else equal: one joint at a time, all, with the key on its rail.

An action and a force table in; `Effect` rows out: events, strike, rebound, check, each with the standard uncertainty
that the declared stiffness and damping of the bushings give, and how far joints give. Loads at rest are those at which
pins are where the set says, so that rest and regulation at rest stay. The thesis names the rigid joints among its
simplifications, and the key's motion on its balance rail as a cause of discrepancy (4.1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.files.force_table import check_force_table
from model.force_driven import output_times, simulate
from model.observables import hammer_height_m
from model.parameters.action import JACK_KNUCKLE, KEY_FRONT, LEVER_KNUCKLE, STRING, Action
from model.parameters.effects import KEY_LIFT, PINS, RAIL
from model.scene.selection import SceneChoice, load_scene
from model.study.blow_measures import measure_blow
from model.study.felt_and_string import LONGEST_CONTACT_S, Effect, effect_of, varied_by_u

Array = NDArray[np.float64]

RATE_HZ = 20_000.0
TOLERANCE = 1e-6
RIGID = 1e8
"""N/m, of joints that are to give no more: a thousandth of what cloth does, in the same scene, which compiles once."""
RIGID_DAMPING = 500.0  # N s/m, that goes with it
FACTORS = (0.2, 0.5, 1.0, 2.0, 5.0, 20.0, 100.0)
ALL, WITH_RAIL = SceneChoice(effects=tuple(PINS)), SceneChoice(effects=(RAIL, *PINS))


def joint_effects(action: Action, time_s: ArrayLike, force_n: ArrayLike) -> list[Effect]:
    """The blow with rigid joints, with one joint that gives, with all, with the key on its rail, with both.

    Parameters
    ----------
    action : parameter set with its sections ``key_pin`` and so on
    time_s, force_n : (k,) force table

    Returns
    -------
    list of Effect
        Marks: strike_ms, free_flight_ms (knuckle's last touch to strike), bottom_ms (the key meets its front felt),
        strike_m_per_s, contact_ms, rebound, check_mm,
        give_mm (farthest that any joint gives, or the key lifts, after the start).

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
    action = loaded_as_at_rest(action)
    blow = check_force_table(time_s, force_n)
    out = [effect_of("none", "rigid", [action], lambda a: _marks(a, blow, SceneChoice()))]
    for effect in PINS:
        others = {f"{o}.{k}": x for o in PINS if o != effect for k, x in _rigid().items()}
        alone = action.with_effects(others)
        out.append(_gives(effect, alone, [effect], blow, ALL))
    out.append(_gives("all five", action, list(PINS), blow, ALL))
    rail = load_scene("lifting-key")
    paths = [[f"{RAIL}.normal.c"], [f"{RAIL}.normal.D"]]
    lifting = [action, *varied_by_u(action, paths)]
    out.append(effect_of(RAIL, "gives", lifting, lambda a: _marks(a, blow, rail)))
    return [*out, _gives("all, rail", action, list(PINS), blow, WITH_RAIL)]


def joint_sweep(
    action: Action, time_s: ArrayLike, force_n: ArrayLike, factors: ArrayLike = FACTORS
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
    action = loaded_as_at_rest(action)
    blow = check_force_table(time_s, force_n)
    out = {0.0: _marks(action, blow, SceneChoice())}
    for factor in as_numbers(factors, "factors", 1).tolist():
        values = {
            f"{effect}.{k}": share * action[f"{effect}.{k}"]
            for effect in PINS
            for k, share in (("stiffness", factor), ("damping", math.sqrt(factor)))
        }
        out[factor] = _marks(action.with_effects(values), blow, ALL)
    return out


def loaded_as_at_rest(action: Action) -> Action:
    """The action with the loads of its joints, and of its rail, at which it rests as it does on rigid joints."""
    still = simulate(action, np.array([0.0, 1e-3]), np.zeros(2), inside=True).inside
    assert still is not None
    loads = {
        f"{effect}.load.{axis}": float(still.joint_n[0, still.bodies.index(body), k])
        for effect, body in PINS.items()
        for k, axis in enumerate("xy")
    }
    return action.with_effects({**loads, f"{RAIL}.load_at_rest": loads["key_pin.load.y"]})


def _rigid() -> dict[str, float]:
    return {"stiffness": RIGID, "damping": RIGID_DAMPING}


def _gives(name: str, action: Action, effects: Sequence[str], blow: tuple[Array, Array], choice: SceneChoice) -> Effect:
    """Of one joint or several, uncertain by their stiffness and damping, each joint by itself."""
    paths = [[f"{effect}.{k}"] for effect in effects for k in ("stiffness", "damping")]
    actions = [action, *varied_by_u(action, paths)]
    return effect_of(name, "gives", actions, lambda a: _marks(a, blow, choice))


def _marks(action: Action, blow: tuple[Array, Array], choice: SceneChoice) -> dict[str, float]:
    times, forces = blow
    at = output_times(float(times[0]), float(times[-1]), RATE_HZ)
    moved = simulate(action, times, forces, scene=choice, tolerance=TOLERANCE, output_time_s=at, contact_forces=True)
    normal = moved.contact_normal_n
    assert normal is not None
    found = measure_blow(action, moved, np.interp(at, times, forces))
    knuckle, bottom, string = (
        normal[:, [moved.contacts.index(c) for c in names]].max(axis=1) > 0.0
        for names in ((JACK_KNUCKLE, LEVER_KNUCKLE), (KEY_FRONT,), (STRING,))
    )
    out = dict.fromkeys(("free_flight_ms", "contact_ms", "rebound"), math.nan)
    if found.strikes:
        before = np.flatnonzero(knuckle & (at < found.strike_s))
        near = np.flatnonzero(string & (at > found.strike_s - 5e-4) & (at < found.strike_s + LONGEST_CONTACT_S))
        out["free_flight_ms"] = 1e3 * (found.strike_s - float(at[before[-1]])) if len(before) else math.nan
        if len(near) > 1:
            k = int(near[-1]) + 1
            out["contact_ms"] = 1e3 * float(at[near[-1]] - at[near[0]])
            give = None if moved.give is None else moved.give.of("hammer")[0]
            way = hammer_height_m(action, moved.angle_rad, give_m=give)
            out["rebound"] = float((way[k + 2] - way[k]) / (at[k + 2] - at[k])) / found.strike_m_per_s
    height = float(hammer_height_m(action, moved.angle_rad[:1])[0])
    ways = [moved.give.way_m] if moved.give is not None else []
    ways += [moved.angle_rad[:, [moved.bodies.index(KEY_LIFT)]]] if KEY_LIFT in moved.bodies else []
    farthest = max((float(np.max(np.abs(way - way[0]))) for way in ways), default=0.0)
    return out | {
        "strike_ms": 1e3 * found.strike_s,
        "bottom_ms": 1e3 * float(at[int(np.argmax(bottom))]) if np.any(bottom) else math.nan,
        "strike_m_per_s": found.strike_m_per_s,
        "check_mm": 1e3 * found.hold_m if found.hold_m < 0.9 * height else math.nan,
        "give_mm": 1e3 * farthest,
        "held": float(found.held),
    }
