"""A scene: which bodies, contacts, springs and drives take part in a run.

Turns an `Action` (numbers by path) into what kernels read: integer tables of structure and one float64
vector. What a scene leaves out is not in its tables and costs nothing: a contact without stiffness, a spring
without torque. The motor arm of the bench is one more body with its own spring, drive and one-sided
contact with the key; with it the input is the motor's torque, without it the force on the key. Where the motion of
the key is prescribed the key is no unknown: the others are solved for, and the input is the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .choice import SceneChoice
from .errors import InputError
from .kernels import layout as L
from .kernels.structure import solved_contacts
from .motion import KeyMotion
from .parameters import CONTACTS, Action

# where the printed action rests, to two digits: the solver needs only a start on the right side of each contact
PRINTED_REST = {"key": 0.029, "whippen": 0.025, "jack": 0.32, "repetition": 0.35, "hammer": 0.295}

_SHAPES = {"circle": L.CIRCLE, "line": L.LINE, "hybrid": L.HYBRID}


@dataclass(frozen=True)
class MotorArm:
    """Rotor and arm of the bench motor; the arm points left from its pivot and presses with its tip.

    Positive torque presses down. The tip touches the key's force point from above: force c x + b x^2 + a x^3,
    times (1 + D dx/dt), never negative. ``preload_n`` is the force of a light return spring at rest.
    """

    inertia: float = 1.0e-4  # kg m^2, rotor and arm about the shaft
    length: float = 0.100  # m
    joint_friction: float = 1.0e-4  # N m
    spring_stiffness: float = 0.02  # N m/rad
    preload_n: float = 0.05  # N at the tip
    contact_a: float = 0.0  # N/m^3
    contact_b: float = 0.0  # N/m^2
    contact_c: float = 2.0e5  # N/m
    contact_damping: float = 0.5  # s/m


@dataclass(frozen=True)
class Scene:
    """Structure (``tables``) and numbers (``vector``) of one run.

    ``bodies`` names the coordinates in order; the first ``size`` are solved for, the rest follow a prescribed motion.
    """

    bodies: tuple[str, ...]
    contacts: tuple[str, ...]
    tables: L.Tables
    vector: NDArray[np.float64]
    start: NDArray[np.float64]  # (size,) rad, where the search for the rest state begins

    @property
    def size(self) -> int:
        """Number of coordinates that are solved for."""
        return len(self.bodies) - int(self.tables.prescribed.sum())

    @property
    def solved_contacts(self) -> int:
        """Number of contacts that can push one of them; the others are computed with the outputs only."""
        return len(solved_contacts(self.tables))


def _surface(action: Action, path: str) -> list[float]:
    return [action[f"{path}.x"], action[f"{path}.y"]]


def _contact_numbers(action: Action, name: str) -> list[float]:
    first, second = f"{name}.first", f"{name}.second"
    shape = action.structure[f"{second}.shape"]
    numbers = [*_surface(action, first), action[f"{first}.radius"], *_surface(action, second)]
    if shape == "line":
        nx, ny = action[f"{second}.normal.x"], action[f"{second}.normal.y"]
        length = math.hypot(nx, ny)  # printed with three digits: back to unit length
        numbers += [0.0, nx / length, ny / length, 0.0, 0.0]
    elif shape == "hybrid":
        start, end = action[f"{second}.arc_start"], action[f"{second}.arc_end"]
        numbers += [action[f"{second}.radius"], math.cos(start), math.sin(start), math.cos(end), math.sin(end)]
    else:
        numbers += [action[f"{second}.radius"], 0.0, 0.0, 0.0, 0.0]
    numbers += [action[f"{name}.normal.{k}"] for k in ("a", "b", "c", "D")]
    numbers += [action[f"{name}.friction.{k}"] for k in ("A", "B1", "B2")]
    return numbers


def _way_up(parent: list[int], body: int) -> list[int]:
    out = []
    while body >= 0:
        out.append(body)
        body = parent[body]
    return out


def _chain(parent: list[int], a: int, b: int) -> list[tuple[int, int]]:
    """Coordinates that move body ``a`` against ``b``, with their side; joints common to both drop out."""
    on_a, on_b = _way_up(parent, a), _way_up(parent, b)
    return [(i, 1) for i in on_a if i not in on_b] + [(i, -1) for i in on_b if i not in on_a]


def _reach(parent: list[int], pivot: list[complex], a: int, point: complex, b: int) -> float:
    """Largest distance (m) the point of body ``a`` can have from the pivot of ``b``, at any angles.

    A gap is a distance between a point carried by A and a surface carried by B, so it changes by no more than
    this per radian of joint ``b``.
    """
    up_a, up_b = _way_up(parent, a), _way_up(parent, b)
    on_a = [i for i in up_a if i not in up_b]
    on_b = [i for i in up_b if i not in up_a]
    if b in up_a:
        return abs(point) + sum(abs(pivot[i]) for i in up_a[: up_a.index(b)])
    # both ways end in the frame of the nearest common body: its fixed points are compared there
    here, length = point, 0.0
    for i in on_a:
        length += abs(here)
        here = pivot[i]
    there = pivot[on_b[-1]]
    return length + abs(here - there) + sum(abs(pivot[i]) for i in on_b[:-1])


def _index(bodies: list[str], name: str) -> int:
    """Coordinate of a body, -1 for ground."""
    return bodies.index(name) if name in bodies else -1


def build_scene(
    action: Action,
    motor_arm: MotorArm | None = None,
    choice: SceneChoice | None = None,
    key_motion: KeyMotion | None = None,
) -> Scene:
    """Scene of the whole action or of what ``choice`` leaves of it.

    Driven by a force on the key, by the motor when an arm is given, or by the motion of the key.
    """
    choice = SceneChoice() if choice is None else choice
    if key_motion is not None and motor_arm is not None:
        raise InputError("scene: found a motor arm and a prescribed key, allowed one of them")
    bodies = list(choice.bodies)
    if key_motion is not None:
        if len(bodies) == 1:
            raise InputError("scene: found nothing but the prescribed key, allowed scenes with another body")
        bodies = [b for b in bodies if b != "key"] + ["key"]  # carries no other body, so it may come last
    parent = [_index(bodies, action.structure[f"{b}.parent"]) for b in bodies]
    vector: list[float] = [action["gravity.g"], action["friction_threshold.v_t"], action["friction_threshold.omega_t"]]
    for b in bodies:
        vector += [action[f"{b}.{k}"] for k in ("pivot.x", "pivot.y", "center_of_mass.x", "center_of_mass.y")]
        vector += [action[f"{b}.mass"], action[f"{b}.inertia"]]
        vector += [action[f"{b}.joint_friction.{k}"] for k in ("A", "B1", "B2")]
    start = [PRINTED_REST[b] for b in bodies]
    key = bodies.index("key")
    px, py = action["drive.point.x"], action["drive.point.y"]
    if motor_arm is not None:
        tip_x = math.cos(start[key]) * px - math.sin(start[key]) * py
        tip_y = math.sin(start[key]) * px + math.cos(start[key]) * py
        bodies.append("motor")
        parent.append(-1)
        start.append(0.0)
        vector += [tip_x + motor_arm.length, tip_y, 0.0, 0.0, 0.0, motor_arm.inertia]
        vector += [motor_arm.joint_friction, 0.0, 0.0]
    n = len(bodies)
    pivot = [complex(*vector[o : o + 2]) for o in range(L.GLOBALS, len(vector), L.BODY_SIZE)]
    offsets = [len(vector)]
    springs = []
    for b in (b for b in ("jack", "repetition") if b in bodies and f"{b}_spring" not in choice.without):
        numbers = [action[f"{b}_spring.{k}"] for k in ("torque", "stiffness", "angle")]
        if numbers[0] != 0.0 or numbers[1] != 0.0:
            springs.append(bodies.index(b))
            vector += numbers
    if motor_arm is not None:
        springs.append(n - 1)
        vector += [motor_arm.preload_n * motor_arm.length, motor_arm.spring_stiffness, 0.0]
    offsets.append(len(vector))
    names, contacts, chains, sides = [], [], [], []
    for name in CONTACTS:
        numbers = _contact_numbers(action, name)
        between = {action.structure[f"{name}.{side}.body"] for side in ("first", "second")}
        if not any(numbers[L.K_A : L.K_C + 1]) or name in choice.without or between - {*bodies, "ground"}:
            continue
        first = _index(bodies, action.structure[f"{name}.first.body"])
        second = _index(bodies, action.structure[f"{name}.second.body"])
        chain = _chain(parent, first, second)
        point = complex(numbers[L.A_X], numbers[L.A_Y])
        reach = [_reach(parent, pivot, first, point, b) for b, _ in chain]
        numbers += reach + [0.0] * (L.MAX_CHAIN - len(chain))
        pad = [(0, 0)] * (L.MAX_CHAIN - len(chain))
        names.append(name)
        contacts.append([first, second, _SHAPES[action.structure[f"{name}.second.shape"]], len(chain)])
        chains.append([i for i, _ in chain + pad])
        sides.append([s for _, s in chain + pad])
        vector += numbers
    offsets.append(len(vector))
    if motor_arm is None:
        drives = [[L.FORCE_DOWN, key]]
        vector += [px, py]
    else:
        drives = [[L.JOINT_TORQUE, n - 1]]
        vector += [0.0, 0.0]
    offsets.append(len(vector))
    prescribed = np.zeros(n, dtype=np.int64)
    probes: list[list[int]] = []
    if motor_arm is not None:
        probes = [[n - 1, key]]
        m = motor_arm
        vector += [-m.length, 0.0, px, py, m.contact_a, m.contact_b, m.contact_c, m.contact_damping]
    offsets.append(len(vector))
    if key_motion is not None:
        prescribed[key] = 1
        vector += key_motion.packed()
    ancestor = np.zeros((n, n), dtype=np.int64)
    for i, w in enumerate(parent):
        if w >= 0:
            ancestor[i, w] = 1

    def table(rows: list, width: int) -> NDArray[np.int64]:
        return np.array(rows, dtype=np.int64).reshape(len(rows), width)

    tables = L.Tables(
        parent=np.array(parent, dtype=np.int64),
        ancestor=ancestor,
        spring=np.array(springs, dtype=np.int64),
        contact=table(contacts, 4),
        chain=table(chains, L.MAX_CHAIN),
        side=table(sides, L.MAX_CHAIN),
        drive=table(drives, 2),
        probe=table(probes, 2),
        offset=np.array(offsets, dtype=np.int64),
        prescribed=prescribed,
    )
    free = n - int(prescribed.sum())
    return Scene(tuple(bodies), tuple(names), tables, np.array(vector), np.array(start[:free]))
