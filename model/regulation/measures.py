"""The seven quantities a technician regulates, measured on the model: at rest, in a slow press, in a medium blow.

Each as in thesis Section 2.3 and docs/explanation/regulation.md; NaN with the reason in ``remarks`` where it cannot be
measured.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError, did_you_mean
from model.force_driven import simulate
from model.motion_driven.slow_press import Press, slow_press
from model.observables import head_height_m, key_dip_m
from model.parameters.action import (
    BACK_CHECK,
    BODIES,
    JACK_KNUCKLE,
    JACK_LEVER,
    KEY_FRONT,
    LEVER_KNUCKLE,
    Action,
    ActionLike,
    as_action,
)
from model.parameters.effects import KEY_LIFT
from model.scene.build import build_scene
from model.scene.selection import choice_of
from model.simulation.hand_set_rest import hand_set_rest, slip_angle
from model.simulation.run import State
from model.simulation.statics import with_pins

Array = NDArray[np.float64]

# medium blow: the force grows with the square of time, then is constant
BLOW_N, BLOW_RISE, BLOW_READ = 5.0, 0.15, 0.5  # N, s, s
SLIPPED = math.radians(25.0)  # round the jack's edge: beyond friction, the hammer falls
CAUGHT_N, CAUGHT_RAD_PER_S = 0.2, 0.05  # least force of the back check, largest speed of the hammer


@dataclass(frozen=True)
class RegulationTarget:
    """A regulated quantity: name, description, required length (m) and the situation it is measured in."""

    name: str
    words: str
    wanted_m: float
    measured_in: str


TARGETS = (
    RegulationTarget("dip", "key dip to first touch", 10.0e-3, "rest"),
    RegulationTarget("hammer_height", "hammer height at rest", 48.0e-3, "rest"),
    RegulationTarget("jack", "jack's right side beyond knuckle's right edge", 0.0, "rest"),
    RegulationTarget("repetition", "repetition lever below jack", 0.0, "rest"),
    RegulationTarget("let_off", "let-off", 1.0e-3, "press"),
    RegulationTarget("drop", "drop", 3.0e-3, "press"),
    RegulationTarget("check", "check height, medium blow", 15.0e-3, "blow"),
)
ALLOWED_M = {
    "dip": (5e-3, 15e-3),
    "hammer_height": (30e-3, 60e-3),
    "jack": (-3e-3, 3e-3),
    "repetition": (-3e-3, 3e-3),
    "let_off": (0.2e-3, 20e-3),
    "drop": (0.5e-3, 30e-3),
    "check": (3e-3, 40e-3),
}
"""Lengths that may be asked for, m: beyond them a number is a slip, such as millimetres given as metres."""


def targets_at(wanted_m: Mapping[str, float] | None = None) -> tuple[RegulationTarget, ...]:
    """Targets ``dip``, ``hammer_height``, ``jack``, ``repetition``, ``let_off``, ``drop`` and ``check`` with the
    thesis's lengths, or those of ``wanted_m`` (name -> m); `InputError` for another name or range.

    Parameters
    ----------
    wanted_m : target name -> length wanted, m; by default as in the thesis

    Returns
    -------
    tuple of RegulationTarget
        In the order of `TARGETS`.

    Raises
    ------
    InputError : there is no such target, or its length is out of range

    Examples
    --------
    >>> from model.regulation import targets_at
    >>> [f"{t.name} {1e3 * t.wanted_m:g}" for t in targets_at({"let_off": 1.5e-3})][4:]
    ['let_off 1.5', 'drop 3', 'check 15']
    """
    wanted = dict(wanted_m or {})
    for name, length in wanted.items():
        if name not in ALLOWED_M:
            hint = did_you_mean(name, ALLOWED_M)
            raise InputError(f"regulation target {name!r}: unknown{hint}allowed {', '.join(ALLOWED_M)}")
        low, high = ALLOWED_M[name]
        if not low <= length <= high:
            allowed = f"{1e3 * low:g} to {1e3 * high:g} mm"
            raise InputError(f"regulation target {name}: found {1e3 * length:g} mm, allowed {allowed}")
    return tuple(replace(t, wanted_m=float(wanted.get(t.name, t.wanted_m))) for t in TARGETS)


def other_lengths(targets: Sequence[RegulationTarget]) -> str:
    """The targets that differ from the thesis's, as text ``", but let-off 1.5 mm"``; empty where none.

    Parameters
    ----------
    targets : what is wanted

    Returns
    -------
    str

    Examples
    --------
    >>> from model.regulation import other_lengths, targets_at
    >>> other_lengths(targets_at({"let_off": 1.5e-3}))
    ', but let-off 1.5 mm'
    """
    other = [f"{t.words} {1e3 * t.wanted_m:g} mm" for t in targets if t not in TARGETS]
    return f", but {', '.join(other)}" if other else ""


@dataclass(frozen=True)
class TargetValues:
    """Values (m) by target name, and remarks on those that could not be measured."""

    value_m: dict[str, float]
    remarks: dict[str, str] = field(default_factory=dict)


class ContactGeometry(NamedTuple):
    """Penetration (m, negative where open), normal from second to first surface, centre of the first circle (m)."""

    penetration_m: float
    normal: complex
    center: complex


def _vector(action: Action, path: str) -> complex:
    return complex(action[f"{path}.x"], action[f"{path}.y"])


def pivot_displacements(action: Action, rest_rad: Array) -> dict[str, complex]:
    """Displacements (m), x + iy by body, at rest of pivots that a compliant joint or a lifting key moves."""
    scene = build_scene(action)
    out = dict.fromkeys((body for body, _ in scene.pins), 0j)
    if scene.pins:
        way = with_pins(scene, rest_rad, 0.0)[scene.size :]
        for (body, axis), d in zip(scene.pins, way.tolist(), strict=True):
            out[body] += d if axis == "x" else 1j * d
    if KEY_LIFT in scene.bodies:
        out["key"] = out.get("key", 0j) + 1j * float(rest_rad[scene.bodies.index(KEY_LIFT)])
    return out


def contact_penetration(
    action: Action, contact: str, angle_rad: ArrayLike, displacements: Mapping[str, complex] | None = None
) -> ContactGeometry:
    """Penetration, m (negative: open), unit normal from second to first surface and centre of the first, x + iy in the
    world, of a contact at angles (n,), rad, the five bodies' first; ``displacements``: x + iy, m, of pivots by body.

    Geometry alone, stiff contact or not; x is right, y up.
    """
    frames = {"ground": (0j, 0.0)}  # pivot and angle of each body from ground
    for body, angle in zip(BODIES, np.asarray(angle_rad, dtype=float)[: len(BODIES)], strict=True):
        pivot, turned = frames[action.structure[f"{body}.parent"]]
        pivot += cmath.rect(1.0, turned) * _vector(action, f"{body}.pivot") + (displacements or {}).get(body, 0j)
        frames[body] = pivot, turned + float(angle)

    def place(side: str) -> tuple[complex, float]:
        pivot, turned = frames[action.structure[f"{contact}.{side}.body"]]
        return pivot + cmath.rect(1.0, turned) * _vector(action, f"{contact}.{side}"), turned

    (center, _), (base, turned) = place("first"), place("second")
    apart, radius = center - base, action[f"{contact}.first.radius"]

    def component(direction: complex) -> float:
        return (apart * direction.conjugate()).real

    shape = action.structure[f"{contact}.second.shape"]
    if shape == "line":
        normal = _vector(action, f"{contact}.second.normal")
        normal *= cmath.rect(1.0, turned) / abs(normal)
        return ContactGeometry(radius - component(normal), normal, center)
    radius += action[f"{contact}.second.radius"]
    if shape == "hybrid":  # an arc that goes on as its tangents
        start, end = (cmath.rect(1.0, turned + action[f"{contact}.second.arc_{k}"]) for k in ("start", "end"))
        beyond = [e for e, tangent in ((start, -1j * start), (end, 1j * end)) if component(tangent) > 0.0]
        if beyond:
            normal = max(beyond, key=component)
            return ContactGeometry(radius - component(normal), normal, center)
    return ContactGeometry(radius - abs(apart), apart / abs(apart), center)


def first_touch_angle(action: Action, key_rest_rad: float, pivot_displacement: complex = 0j) -> float:
    """Angle of the key (rad) at which it first touches the felt under its front, without pressing it.

    Its pivot is ``pivot_displacement`` (m) from its place in the set.
    """
    felt, line = f"{KEY_FRONT}.first", f"{KEY_FRONT}.second"
    nx, ny = action[f"{line}.normal.x"], action[f"{line}.normal.y"]
    length = math.hypot(nx, ny)
    nx, ny = nx / length, ny / length
    ax = action[f"{felt}.x"] - action["key.pivot.x"] - pivot_displacement.real
    ay = action[f"{felt}.y"] - action["key.pivot.y"] - pivot_displacement.imag
    # touch: (felt centre) . R(angle) normal = line's own distance + radius
    along, across = ax * nx + ay * ny, ay * nx - ax * ny
    reach = action[f"{line}.x"] * nx + action[f"{line}.y"] * ny + action[f"{felt}.radius"]
    size = math.hypot(along, across)
    if abs(reach) > size:
        raise InputError(f"{KEY_FRONT}: the key never touches the felt under its front; correct {felt}.y")
    middle, half = math.atan2(across, along), math.acos(reach / size)
    options = [(a - key_rest_rad + math.pi) % (2.0 * math.pi) - math.pi for a in (middle - half, middle + half)]
    return key_rest_rad + min(options, key=abs)


def measure_at_rest(action: Action, rest_rad: Array | None = None) -> dict[str, float]:
    """Lengths, m, by target: ``dip``, ``hammer_height``, ``jack``, ``repetition`` (the gap under the knuckle), of an
    action at rest at ``rest_rad`` (n,), rad; None: as a hand sets it up."""
    q = hand_set_rest(action) if rest_rad is None else rest_rad
    moved, touch = pivot_displacements(action, q), q.copy()
    touch[BODIES.index("key")] = first_touch_angle(action, float(q[BODIES.index("key")]), moved.get("key", 0j))
    hammer = moved.get("hammer", 0j)
    # the jack's right side is the line of its contact with the lever; the knuckle's right edge is measured square to it
    line, knuckle = (
        contact_penetration(action, JACK_LEVER, q, moved),
        contact_penetration(action, JACK_KNUCKLE, q, moved),
    )
    side = _component(line.center, line.normal) - action[f"{JACK_LEVER}.first.radius"] + line.penetration_m
    edge = _component(knuckle.center, line.normal) + action[f"{JACK_KNUCKLE}.first.radius"]
    under_knuckle = contact_penetration(action, LEVER_KNUCKLE, q, moved).penetration_m
    names = (*build_scene(action).bodies, "hammer_pin_x", "hammer_pin_y")
    return {
        "dip": float(key_dip_m(action, touch[None, :], q)[0]),
        "hammer_height": float(head_height_m(action, names, [*q, hammer.real, hammer.imag])),
        "jack": side - edge,
        # gap under the knuckle; where the lever carries the hammer, how far it holds the knuckle off the jack
        "repetition": min(0.0, knuckle.penetration_m) - under_knuckle,
    }


def _component(point: complex, direction: complex) -> float:
    return (point * direction.conjugate()).real


def measure_press(action: Action, rest_rad: Array, dip_m: float) -> tuple[dict[str, float], dict[str, str], Press]:
    """Slow press from ``rest_rad`` (n,), rad, to ``dip_m``: lengths, m, of ``let_off`` and ``drop`` by name, NaN where
    the jack does not let go; remarks by name that say so; and the press itself.

    Let-off is the hammer's smallest distance from the string before the knuckle slips off the jack's edge, drop its
    distance when it then rests on the repetition lever with the key down.
    """
    press = slow_press(action, rest_rad, [dip_m])
    slipped = np.flatnonzero(slip_angle(action, press.angle_rad) > SLIPPED)
    height = press.hammer_height_m
    if not len(slipped):
        remarks = {
            "let_off": "the jack does not let go before the key is down",
            "drop": "without let-off the hammer does not drop",
        }
        return {"let_off": math.nan, "drop": math.nan}, remarks, press
    return {"let_off": float(height[: slipped[0] + 1].min()), "drop": float(height[-1])}, {}, press


def medium_blow() -> tuple[Array, Array]:
    rise = np.linspace(0.0, BLOW_RISE, 61)  # straight pieces of 2.5 ms
    return np.append(rise, BLOW_READ), np.append(BLOW_N * (rise / BLOW_RISE) ** 2, BLOW_N)


def measure_blow(action: Action, rest_rad: Array) -> tuple[dict[str, float], dict[str, str]]:
    """Blow of medium force from ``rest_rad`` (n,), rad: the hammer's distance, m, from the string where the back check
    holds it, as ``check``, NaN where it does not; and a remark by name that says why."""
    times, force = medium_blow()
    start = State(float(times[0]), np.array(rest_rad, dtype=float), np.zeros(len(rest_rad)))
    end = simulate(action, times, force, initial=start, output_time_s=times[-1:], contact_forces=True)
    height = float(end.hammer_height_m[0])
    if end.contact_normal_n is None or BACK_CHECK not in end.contacts:
        return {"check": math.nan}, {"check": "there is no back check"}
    push = float(end.contact_normal_n[0, end.contacts.index(BACK_CHECK)])
    if push < CAUGHT_N or abs(float(end.speed_rad_per_s[0, BODIES.index("hammer")])) > CAUGHT_RAD_PER_S:
        return {"check": math.nan}, {"check": f"the hammer is not caught (at {1e3 * height:.1f} mm after the blow)"}
    return {"check": height}, {}


def measure(action: ActionLike, progress: Callable[[str], None] | None = None) -> TargetValues:
    """Measure the seven regulation targets of an action, m, at rest, in a slow press and in a medium blow; NaN with a
    remark where one cannot be; ``progress`` is called with a short text at each step.

    Parameters
    ----------
    action : parameter set
    progress : called with a short text at each step

    Returns
    -------
    TargetValues
        Lengths, m, by target; NaN with a remark where one cannot be measured.

    Raises
    ------
    StaticsError, IntegrationError, InputError : the action has no rest state or cannot be pressed; or its scene lacks a
        body or is not driven by a force

    Examples
    --------
    >>> import model
    >>> found = model.regulation.measure(model.load_action("hirschkorn2004"))
    >>> print(f"let-off {1e3 * found.value_m['let_off']:.1f} mm")
    let-off 12.1 mm
    """
    action = as_action(action)
    say = progress or (lambda _: None)
    choice_of(action).need_played_key(action.name)
    say("at rest")
    rest = hand_set_rest(action)
    values = measure_at_rest(action, rest)
    say("slow press")
    if values["dip"] > 0.0:
        pressed, press_remarks, _ = measure_press(action, rest, values["dip"])
    else:
        pressed = {"let_off": math.nan, "drop": math.nan}
        press_remarks = {"dip": "the key rests on the felt under its front"}
    say("medium blow")
    blow, blow_remarks = measure_blow(action, rest)
    return TargetValues(values | pressed | blow, press_remarks | blow_remarks)
