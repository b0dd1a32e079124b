"""A scene: which bodies, contacts, springs, drives and effects take part in a run.

What a scene leaves out is not in its tables and costs nothing. Where the motion of key, arm or finger is prescribed,
the others are solved for and the input is the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.elements.laws.known import LAWS, USUAL
from model.elements.structure import solved_contacts
from model.errors import InputError
from model.kernels import layout as L
from model.kernels import workspace as W
from model.parameters.action import CONTACTS, STRING, Action, ActionLike, as_action
from model.parameters.effects import (
    ARM,
    FINGER,
    KEY_LIFT,
    MOTOR,
    MOTOR_DRIVE,
    PINS,
    RAIL,
    SHANK,
    STRING_EFFECT,
    WINDING,
)
from model.parameters.side_drawing import PRINTED_REST
from model.scene import pressing
from model.scene.contacts import SHAPES, chain_of, law_of_contact, reach_of, read_contact
from model.scene.effect_terms import bending, parts_of_hammer
from model.scene.key_motion import KeyMotion
from model.scene.selection import SceneChoice, check_prescribed, choice_of
from model.scene.string_terms import string_numbers
from model.tabular import Tabular, axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AXES = ("x", "y")  # in which a joint gives: to the right and up
MOST = 256
"""Scenes kept, some 4 kB each: more than runs are carried out at one time."""


@dataclass(frozen=True, repr=False)
class Scene(Tabular, ArrayRecord):
    """Structure (``tables``) and numbers (``vector``) of one run.

    ``bodies`` names the coordinates in order; the first ``size`` are unknowns, the rest follow a prescribed motion.
    """

    bodies: tuple[str, ...]
    contacts: tuple[str, ...]
    tables: L.Tables
    vector: NDArray[np.float64]
    start: NDArray[np.float64]  # (size,) rad, where the search for the rest state begins
    command: pressing.Command | None = None  # how the input of a run reaches the kernels; None as it is

    def __repr__(self) -> str:
        led = self.bodies[self.size :]
        motion = f"; moved as prescribed: {', '.join(led)}" if led else ""
        return f"<Scene of {', '.join(self.bodies)}: {len(self.contacts)} contacts{motion}>"

    def columns(self) -> dict[str, Any]:
        """Columns with one row for each contact: ``contact``, ``first`` and ``second`` (bodies that touch, or
        ``ground``), ``shape`` of the second's surface and ``law`` of felt."""
        parts, laws = (*self.bodies, "ground"), {law.number: name for name, law in LAWS.items()}
        shapes = {number: name for name, number in SHAPES.items()}
        first, second, shape, _, law, _ = self.tables.contact.T
        return {
            "contact": list(self.contacts),
            "first": [parts[i] for i in first],
            "second": [parts[i] for i in second],
            "shape": [shapes[i] for i in shape],
            "law": [laws[i] for i in law],
        }

    def plot(self, *contacts: str, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw which part touches which: a line for each contact, by default for all, into ``ax`` or a new figure."""
        drawn, parts, columns = axes_or_new(ax), (*self.bodies, "ground"), self.columns()
        shown = [k for k, name in enumerate(self.contacts) if not contacts or name in contacts]
        for at, k in enumerate(shown):
            ends = [parts.index(columns[side][k]) for side in ("first", "second")]
            drawn.plot([at, at], ends, **{"color": "black", "marker": "o", "linewidth": 1.0, **style})
        drawn.set_xticks(range(len(shown)), [self.contacts[k] for k in shown], rotation=60, ha="right")
        drawn.set_yticks(range(len(parts)), parts)
        return drawn

    @cached_property
    def size(self) -> int:
        """Number of unknown coordinates."""
        return len(self.bodies) - int(self.tables.prescribed.sum())

    def check_whole(self, angle_rad: ArrayLike, what: str) -> None:
        """Refuse states (..., k) that do not hold all coordinates, including a prescribed key."""
        found = as_numbers(angle_rad, what).shape[-1:]
        if found != (len(self.bodies),):
            raise InputError(
                f"{what}: found states of {found[0] if found else 0} coordinates, allowed all {len(self.bodies)}: "
                f"{', '.join(self.bodies)}"
            )

    @cached_property
    def static_tables(self) -> L.Tables:
        """Tables of the scene at rest, where hereditary and hysteretic felt follows its slow loading curve."""
        nothing, contact = np.zeros(0, dtype=np.int64), self.tables.contact.copy()
        contact[:, 4:] = LAWS[USUAL].number, 0
        return self.tables._replace(contact=contact, memory=nothing, string=nothing)

    @property
    def what_remembers(self) -> tuple[str, ...]:
        """Contacts whose felt has a law with memory; then the string, where there is one."""
        felts = dict.fromkeys(self.contacts[c] for c in self.tables.memory)
        return (*felts, *(("string",) if len(self.tables.string) else ()))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of all coordinates: bodies and those of effects, then compliant joint directions."""
        return (*self.bodies, *(f"{body}_pin_{axis}" for body, axis in self.pins))

    @property
    def presser(self) -> str:
        """Effect whose tip presses the key, as a name among contacts; empty where a force on the key drives it."""
        return FINGER if FINGER in self.bodies else ARM if MOTOR in self.bodies else ""

    @cached_property
    def wound(self) -> tuple[int, ...]:
        """Coordinate of the winding's charge, which has no equilibrium; none for most scenes."""
        return (self.bodies.index(WINDING),) if WINDING in self.bodies else ()

    @property
    def remembers(self) -> bool:
        """Whether the scene has internal variables: of felt, a string or compliant joints."""
        return len(self.tables.memory) + len(self.tables.string) + len(self.tables.pin) > 0

    @cached_property
    def pins(self) -> tuple[tuple[str, str], ...]:
        """Body and direction, x or y, of each compliant joint direction."""
        return tuple((self.bodies[body], AXES[axis]) for body, axis in self.tables.pin.tolist())

    @cached_property
    def solved_contacts(self) -> int:
        """Number of contacts that act on an unknown coordinate; the others are evaluated for outputs only."""
        return len(solved_contacts(self.tables))


def _coordinates(choice: SceneChoice, motion: KeyMotion | None) -> list[str]:
    """Names of the coordinates in order: bodies, then what effects add; what a ``motion`` prescribes comes last;
    `InputError` for more than the kernels can take."""
    out = [*choice.bodies]
    effects = ((ARM, MOTOR), (MOTOR_DRIVE, WINDING), (FINGER, FINGER), (RAIL, KEY_LIFT), ("shank", SHANK))
    for effect, coordinate in effects:  # the winding follows the motor that it turns
        if effect in choice.effects and (coordinate != WINDING or motion is None):  # what turns a led arm is not asked
            out.append(coordinate)
    if len(out) > W.WIDTH:
        raise InputError(
            f"scene: found {len(out)} coordinates ({', '.join(out)}), allowed {W.WIDTH}; leave an effect out"
        )
    if motion is None:
        return out
    check_prescribed(choice)
    return [b for b in out if b != choice.prescribed_coordinate] + [
        choice.prescribed_coordinate
    ]  # carries no other body, so it may come last


def _parent_index(action: Action, bodies: list[str], body: str) -> int:
    """Index of the body that carries a body, `L.GROUND` for the ground, `L.GUIDED` for the key's lift."""
    if body == KEY_LIFT:
        return L.GUIDED
    name = {"key": KEY_LIFT, SHANK: "hammer", MOTOR: "ground", WINDING: "ground", FINGER: "ground"}.get(body)
    if body == "key" and KEY_LIFT not in bodies:
        name = None
    name = action.structure[f"{body}.parent"] if name is None else name
    return bodies.index(name) if name in bodies else L.GROUND


def _body_numbers(action: Action, bodies: list[str], body: str) -> list[float]:
    """Nine numbers of a coordinate's ``body``: pivot x, y, centre of mass x, y, mass, inertia (of a winding:
    inductance), A, B1, B2 of joint friction, SI. ``bodies``: all of the scene; a shank's part leaves the hammer, a
    guide carries the key."""
    if body == KEY_LIFT:
        friction = action[f"{RAIL}.guide_friction.A"]
        return [action["key.pivot.x"], action["key.pivot.y"], 0.0, 0.0, 0.0, 0.0, friction, 0.0, 0.0]
    if body in (MOTOR, FINGER):
        return pressing.presser_numbers(action, body, PRINTED_REST["key"]).body
    if body == WINDING:  # the charge that has passed: its inertia is the inductance
        return [0.0, 0.0, 0.0, 0.0, 0.0, action[f"{MOTOR_DRIVE}.inductance"], 0.0, 0.0, 0.0]
    if body == SHANK:
        mass, x, y, inertia = parts_of_hammer(action)[1]
        return [action["shank.hinge.x"], action["shank.hinge.y"], x, y, mass, inertia, 0.0, 0.0, 0.0]
    numbers = [action[f"{body}.{k}"] for k in ("pivot.x", "pivot.y", "center_of_mass.x", "center_of_mass.y")]
    numbers += [action[f"{body}.mass"], action[f"{body}.inertia"]]
    numbers += [action[f"{body}.joint_friction.{k}"] for k in ("A", "B1", "B2")]
    if body == "hammer" and SHANK in bodies:
        mass, x, y, inertia = parts_of_hammer(action)[0]
        numbers[2:6] = [x, y, mass, inertia]
    if body == "key" and KEY_LIFT in bodies:
        numbers[:2] = [0.0, 0.0]  # carried by the guide, which is at the pivot
    return numbers


def _springs(action: Action, choice: SceneChoice, bodies: list[str]) -> list[tuple[int, list[float]]]:
    """Coordinate (index) with torque (N m), stiffness (N m/rad) and angle (rad) of each spring: of jack and repetition
    lever where they have torque, of motor arm, finger and shank."""
    out = []
    for b in (b for b in ("jack", "repetition") if b in bodies and f"{b}_spring" not in choice.without):
        numbers = [action[f"{b}_spring.{k}"] for k in ("torque", "stiffness", "angle")]
        if numbers[0] != 0.0 or numbers[1] != 0.0:
            out.append((bodies.index(b), numbers))
    presser = pressing.presser_of(bodies)
    if presser is not None:
        spring = pressing.presser_numbers(action, presser, PRINTED_REST["key"]).spring
        out.append((bodies.index(presser), spring))
    if SHANK in bodies:
        out.append((bodies.index(SHANK), [0.0, bending(action)[0], 0.0]))
    return out


def _front(action: Action, choice: SceneChoice) -> tuple[float, float] | None:
    """Front of a key whose pivot may rise while a motion prescribes where that is; None of other scenes."""
    rises = choice.prescribed_coordinate == "key" and (RAIL in choice.effects or "key_pin" in choice.effects)
    return (action["drive.point.x"], action["drive.point.y"]) if rises else None


def _table(rows: list, width: int) -> NDArray[np.int64]:
    return np.array(rows, dtype=np.int64).reshape(len(rows), width)


def _pins(action: Action, choice: SceneChoice, bodies: Sequence[str]) -> tuple[list[list[int]], list[float]]:
    """Index of the body and direction (0 right, 1 up) of each compliant joint direction, and in a row stiffness (N/m),
    damping (N s/m) and load (N) of each.

    A key on its balance rail gives to the side only.
    """
    pins: list[list[int]] = []
    numbers: list[float] = []
    for effect, body in PINS.items():
        if effect not in choice.effects:
            continue
        if body not in bodies:
            raise InputError(f"scene: effects: {effect} needs the {body}; add {body} or leave out {effect}")
        for axis, name in enumerate(AXES):
            if not (body == "key" and name == "y" and RAIL in choice.effects):
                pins.append([bodies.index(body), axis])
                numbers += [action[f"{effect}.{k}"] for k in ("stiffness", "damping", f"load.{name}")]
    return pins, numbers


def build_scene(action: ActionLike, choice: SceneChoice | None = None, key_motion: KeyMotion | None = None) -> Scene:
    """Tables of numbers for the kernels, of the bodies, contacts and effects of ``choice`` (None: what the action
    says), driven by force on the key or what presses it, or by ``key_motion`` instead.

    Parameters
    ----------
    action : parameter set
    choice : bodies, contacts and effects that take part; by default those that the action says
    key_motion : prescribed motion of the key, of its front where it lifts or its joint gives, or of the motor's arm or
        the finger where one presses (`SceneChoice.prescribed_coordinate`); in place of a force

    Returns
    -------
    Scene
        Tables of numbers that the kernels read.

    Raises
    ------
    InputError : a body, contact or effect that the action has not

    Examples
    --------
    >>> import model
    >>> model.build_scene(model.load_action(), model.load_scene("key-whippen")).bodies
    ('key', 'whippen')
    """
    action = as_action(action)
    choice = choice_of(action) if choice is None else choice
    if key_motion is not None:
        return _assemble_scene(action, choice, key_motion)
    return _cached_scene(
        action, choice, tuple(law.number for law in LAWS.values())
    )  # a law that was added again is another


@lru_cache(maxsize=MOST)
def _cached_scene(action: Action, choice: SceneChoice, laws: tuple[int, ...]) -> Scene:
    return _assemble_scene(action, choice, None)


def _assemble_scene(action: Action, choice: SceneChoice, key_motion: KeyMotion | None) -> Scene:
    """Check the choice and assemble its scene: tables of the structure, the parameter vector, and the start of the
    search for rest."""
    choice.check(action)
    bodies = _coordinates(choice, key_motion)
    parent = [_parent_index(action, bodies, b) for b in bodies]
    n, key, presser = len(bodies), bodies.index("key"), pressing.presser_of(bodies)
    vector: list[float] = [action["gravity.g"], action["friction_threshold.v_t"], action["friction_threshold.omega_t"]]
    for b in bodies:
        vector += _body_numbers(action, bodies, b)
    pivot = [complex(*vector[o : o + 2]) for o in range(L.GLOBALS, len(vector), L.BODY_SIZE)]
    offsets = [len(vector)]
    springs = _springs(action, choice, bodies)
    vector += [number for _, numbers in springs for number in numbers]
    offsets.append(len(vector))
    names, contacts, chains = list[str](), list[list[int]](), list[list[int]]()
    memories: list[int] = []
    of_laws: list[float] = []
    for name in (*CONTACTS, *((RAIL,) if KEY_LIFT in bodies else ())):
        contact = read_contact(action, name, SHANK in bodies)
        numbers, between = list(contact.numbers), {contact.first, contact.second}
        if not any(numbers[L.K_A : L.K_C + 1]) or name in choice.without or between - {*bodies, "ground"}:
            continue
        first, second = (bodies.index(b) if b in bodies else L.GROUND for b in (contact.first, contact.second))
        chain = chain_of(parent, first, second)
        point = complex(numbers[L.A_X], numbers[L.A_Y])
        pad = L.MAX_CHAIN - len(chain)
        count, packed = law_of_contact(action, name, numbers)
        memories += [len(names)] * count
        of_laws += packed
        names.append(name)
        contacts.append([first, second, contact.shape, len(chain), LAWS[action.law(name)].number, len(packed)])
        chains.append(chain + [0] * pad)
        vector += [*numbers, *(reach_of(parent, pivot, first, point, b) for b in chain), *[0.0] * pad]
    offsets.append(len(vector))
    drive, numbers = pressing.drive_numbers(action, bodies)
    vector += numbers
    offsets.append(len(vector))
    probes: list[list[int]] = []
    dampers = [(bodies.index(SHANK), bending(action)[1])] if SHANK in bodies else []
    if presser is not None:
        found = pressing.presser_numbers(action, presser, PRINTED_REST["key"])
        probes = [[bodies.index(presser), key]]
        vector += found.tip
        dampers += [(bodies.index(presser), found.damping)] if presser == FINGER else []
    offsets.append(len(vector))
    vector += [damping for _, damping in dampers]
    pins_at = len(vector)
    pins, given = _pins(action, choice, bodies)
    vector += given
    offsets.append(len(vector))
    vector += of_laws
    offsets += [len(vector), pins_at]
    strung = STRING_EFFECT in choice.effects
    vector += string_numbers(action) if strung else []
    offsets.insert(4, 0 if key_motion is None else len(vector))
    prescribed = np.zeros(n, dtype=np.int64)
    if key_motion is not None:  # last: where anything else stands hangs on no number of pieces, and no kernel does
        prescribed[-1], vector = 1, [*vector, *key_motion.pack_numbers(_front(action, choice))]
    tables = L.Tables(
        parent=np.array(parent, dtype=np.int64),
        spring=np.array([i for i, _ in springs], dtype=np.int64),
        contact=_table(contacts, 6),
        chain=_table(chains, L.MAX_CHAIN),
        drive=_table([drive], 2),
        probe=_table(probes, 2),
        offset=np.array(offsets, dtype=np.int64),
        prescribed=prescribed,
        damper=np.array([i for i, _ in dampers], dtype=np.int64),
        rail=np.array([names.index(RAIL)] if RAIL in names else [], dtype=np.int64),
        string=np.array([names.index(STRING)] if strung else [], dtype=np.int64),
        memory=np.array(memories, dtype=np.int64),
        pin=_table(pins, 2),
    )
    start = np.array([PRINTED_REST.get(b, 0.0) for b in bodies[: n - int(prescribed.sum())]])
    command = pressing.command_of(action, bodies) if key_motion is None else None
    return Scene(tuple(bodies), tuple(names), tables, np.array(vector), start, command)
