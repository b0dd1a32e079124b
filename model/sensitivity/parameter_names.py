"""Parameters by name as ``--set`` and ``--scale`` take them, and the scene numbers that each changes.

A path (``hammer.mass``) stands for its value in SI units; a law, group or pattern (``friction``, ``contact02``) for a
factor on all its values, which is 1. What a parameter changes is found by building the scene twice; a parameter that
changes nothing is refused by name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError
from model.kernels import layout as L
from model.parameters.action import Action, ActionLike, as_action
from model.parameters.scaling import named_paths
from model.scene.build import Scene, build_scene
from model.scene.key_motion import KeyMotion
from model.scene.pressing import Command, command_of
from model.scene.selection import SceneChoice, choice_of

Array = NDArray[np.float64]

FELT = "felt:"  # felt:contact02 is contact02, the stiffness of that felt
LENGTH_STEP = 1e-8  # m or rad, of a difference: felt is pressed in by 1e-6 m and more
SHARE_STEP = 1e-6  # of any other value
_OF_ALL = {"gravity.g": L.GRAVITY, "friction_threshold.v_t": L.V_T, "friction_threshold.omega_t": L.OMEGA_T}


@dataclass(frozen=True)
class Parameter:
    """What a name stands for.

    Attributes
    ----------
    name : as it was given
    value, unit : SI; a factor's value is 1 and its unit "1"
    paths : path -> change of its value per unit of the parameter
    step : of a difference, in the parameter's unit
    scale : a size of the parameter that counts, in its unit: its value, or its uncertainty where that is zero
    """

    name: str
    value: float
    unit: str
    paths: dict[str, float]
    step: float
    scale: float


def find_parameters(action: ActionLike, names: Sequence[str]) -> list[Parameter]:
    """Parameters by name (path, law, felt or group), in order; `InputError` for a name that is unknown or given twice.

    Parameters
    ----------
    action : parameter set
    names : paths as ``--set`` takes them; laws, groups and patterns as ``--scale`` does, which stand for a factor

    Returns
    -------
    list of Parameter
        In the order of the names.

    Raises
    ------
    InputError : no name is given, one is unknown, or one is given twice; unknown ones are listed with near names

    Examples
    --------
    >>> import model
    >>> mass, friction = model.sensitivity.find_parameters(model.load_action(), ["hammer.mass", "joint_friction"])
    >>> mass.unit, friction.value, len(friction.paths)
    ('kg', 1.0, 5)
    """
    action = as_action(action)
    if isinstance(names, str):
        raise InputError(f"parameters: found the text {names!r}, allowed a list of names")
    if not names:
        raise InputError("parameters: found none, allowed one or more names")
    twice = [name for i, name in enumerate(names) if name in names[:i]]
    if twice:
        raise InputError(f"parameters: {', '.join(dict.fromkeys(twice))} found twice, allowed each once")
    return [_find_parameter(action, name) for name in names]


def _find_parameter(action: Action, name: str) -> Parameter:
    """Parameter of a path, law, felt or group; `InputError` where it is unknown or fixed by the geometry."""
    quantities = {**action.quantities, **action.effects}
    if name in quantities:
        quantity = quantities[name]
        step = _difference_step(quantity.unit, quantity.value, quantity.u)
        scale = abs(quantity.value) or quantity.u or step
        return Parameter(name, quantity.value, quantity.unit, {name: 1.0}, step, scale)
    if name in action.structure:
        raise InputError(
            f"parameter {name}: is fixed by the geometry (it says {action.structure[name]!r}, which is no number); "
            "leave it out"
        )
    paths = named_paths(action, name.removeprefix(FELT), "parameter")
    steps = [
        _difference_step(quantities[path].unit, quantities[path].value, quantities[path].u)
        / abs(quantities[path].value)
        for path in paths
        if quantities[path].value
    ]
    if not steps:
        raise InputError(f"parameter {name}: all its values are 0, a factor on them changes nothing; name a path")
    return Parameter(name, 1.0, "1", {path: quantities[path].value for path in paths}, min(steps), 1.0)


def _difference_step(unit: str, value: float, u: float) -> float:
    if unit in ("m", "rad"):
        return LENGTH_STEP
    return SHARE_STEP * (abs(value) or u or 1.0)


def describe_parameters(action: Action, parameters: Sequence[Parameter]) -> dict[str, Any]:
    return {
        "parameters": tuple(p.name for p in parameters),
        "values": np.array([p.value for p in parameters]),
        "units": tuple(p.unit for p in parameters),
        "uncertainties": np.array([stated_uncertainty(action, p.name) for p in parameters]),
    }


def refuse_idle(idle: Sequence[str], allowed: bool, what: str) -> None:
    """Refuse parameters that do nothing in a blow, or under the motion of a stroke, unless they are allowed."""
    if idle and not allowed:
        raise InputError(
            f"parameter {', '.join(idle)}: does nothing in this {what} (its element stays out of touch or still); "
            f"leave it out or choose another {what}"
        )


def stated_uncertainty(action: Action, name: str) -> float:
    """Standard uncertainty of a parameter in its unit; NaN of a group."""
    quantity = action.quantities.get(name) or action.effects.get(name)
    return quantity.u if quantity is not None else float("nan")


@dataclass(frozen=True)
class Directions:
    """How parameters of an action change a scene."""

    # parameters, action, scene: which, and of what
    parameters: tuple[Parameter, ...]
    action: Action
    scene: Scene
    slope: Array  # (P, k) of the scene's parameter vector per unit of each
    # (k, m) changes of a run's input at the times of its table, and (m,) of the input at rest; the last m of the
    # parameters stand for them
    inputs: tuple[Array, Array] = (np.empty((0, 0)), np.empty(0))

    def with_inputs(self, table: Array, rest: Array) -> Directions:
        """Copy followed by directions along which the input of a run changes, per unit of each."""
        count = len(rest)
        more = tuple(Parameter(f"input {i + 1}", 0.0, "1", {}, 1.0, 1.0) for i in range(count))
        slope = np.vstack([self.slope, np.zeros((count, self.slope.shape[1]))])
        return replace(self, parameters=(*self.parameters, *more), slope=slope, inputs=(table, rest))


T = TypeVar("T", bound=Action)


class _UncheckedAction(Action):
    """An action with other values, unchecked: a difference may step over the edge of what is allowed."""

    def __getitem__(self, path: str) -> float:
        value: float | None = self.__dict__["shifted"].get(path)
        return super().__getitem__(path) if value is None else value


def as_action_type(kind: type[T], action: Action) -> T:
    return kind(**{f.name: getattr(action, f.name) for f in fields(Action)} | {"changed": {}})


def _values(action: Action) -> dict[str, float]:
    """Fresh dict of all values by path, from a cached read of the action."""
    kept: dict[str, float] | None = action.__dict__.get("shifted") or action.__dict__.get("values_by_path")
    if kept is None:
        quantities = (*action.quantities.items(), *action.effects.items())
        kept = action.__dict__["values_by_path"] = {path: quantity.value for path, quantity in quantities}
    return dict(kept)


def shift_parameter(action: Action, parameter: Parameter, by: float) -> Action:
    """Copy of an action with one parameter changed ``by`` a step, in its unit; ranges are not checked."""
    return shift_parameters(action, (parameter,), (by,))


def shift_parameters(action: Action, parameters: Sequence[Parameter], amounts: Iterable[float]) -> Action:
    """Copy of an action with each parameter changed by its amount, in its unit; ranges are not checked."""
    values = _values(action)
    for parameter, change in zip(parameters, amounts, strict=True):
        for path, weight in parameter.paths.items():
            values[path] += float(change) * weight
    out = as_action_type(_UncheckedAction, action)
    object.__setattr__(out, "shifted", values)
    return out


def directions(
    action: Action, choice: SceneChoice, parameters: Sequence[Parameter], key_motion: KeyMotion | None = None
) -> Directions:
    """Derivatives of a scene's parameter vector by each parameter, by central differences; `InputError` for those that
    have no effect."""
    choice.check(action)
    scene = build_scene(action, choice, key_motion)
    build = partial(build_scene, choice=choice, key_motion=key_motion)
    slope = np.zeros((len(parameters), len(scene.vector)))
    switching = {
        j
        for group in _group_parameters(scene, parameters)
        for j in _fill_group(slope, group, parameters, (action, build), scene)
    }
    found = Directions(tuple(parameters), action, scene, slope)
    still = [j for j in range(len(parameters)) if j not in switching and not np.any(slope[j])]
    idle = [parameters[j].name for j in still if not any(end != scene.command for end in shifted_commands(found, j))]
    if idle:
        raise InputError(
            f"parameter {', '.join(idle)}: no effect in this scene; leave it out or choose a scene with its element"
        )
    if switching:
        names = ", ".join(parameters[j].name for j in sorted(switching))
        raise InputError(
            f"parameter {names}: its element is switched off (all its values are 0), where a derivative "
            "does not exist; give it a value or leave it out"
        )
    return found


def shifted_commands(directions: Directions, j: int) -> list[Command]:
    """What turns the input of a run into the kernels', with parameter ``j`` a step more, and a step less; or none."""
    parameter, bodies = directions.parameters[j], list(directions.scene.bodies)
    ends = [command_of(shift_parameter(directions.action, parameter, s * parameter.step), bodies) for s in (1.0, -1.0)]
    return [end for end in ends if end is not None]


def _element_numbers(scene: Scene, parameter: Parameter) -> slice | None:
    """Slice of the scene's vector that a parameter's contact, body or constant fills; None where it is none."""
    if parameter.name in _OF_ALL:
        first = _OF_ALL[parameter.name]
        return slice(first, first + 1)
    names = {path.partition(".")[0] for path in parameter.paths}
    name = names.pop() if len(names) == 1 else ""
    if name in scene.contacts:
        first, size = int(scene.tables.offset[1]) + L.CONTACT_SIZE * scene.contacts.index(name), L.CONTACT_SIZE
    elif name in scene.bodies:
        first, size = L.GLOBALS + L.BODY_SIZE * scene.bodies.index(name), L.BODY_SIZE
    else:
        return None
    return slice(first, first + size)


def _group_parameters(scene: Scene, parameters: Sequence[Parameter]) -> list[list[int]]:
    """Group parameters, as lists of indices, so that one scene build separates their effects: one of each contact or
    body."""
    groups: dict[object, list[int]] = {}
    seen: Counter[int] = Counter()
    for j, parameter in enumerate(parameters):
        own = _element_numbers(scene, parameter)
        groups.setdefault(("alone", j) if own is None else seen[own.start], []).append(j)
        if own is not None:
            seen[own.start] += 1
    return list(groups.values())


def _fill_group(
    slope: Array,
    group: list[int],
    parameters: Sequence[Parameter],
    action_and_builder: tuple[Action, Callable[[Action], Scene]],
    scene: Scene,
) -> list[int]:
    """Fill the rows of ``slope`` for a ``group`` of parameters (indices); return those whose change switches something
    on or off."""
    chosen = [parameters[j] for j in group]
    ends = [
        action_and_builder[1](shift_parameters(action_and_builder[0], chosen, [s * p.step for p in chosen]))
        for s in (1.0, -1.0)
    ]
    alike = all(_has_same_structure(scene, end) for end in ends)
    if len(group) == 1:
        if not alike:
            return group
        row = (ends[0].vector - ends[1].vector) / (2.0 * chosen[0].step)
        row[_gap_bound_places(scene)] = 0.0
        slope[group[0]] = row
        return []
    if alike:
        difference = ends[0].vector - ends[1].vector
        difference[_gap_bound_places(scene)] = 0.0
        for j, parameter in zip(group, chosen, strict=True):
            own = _element_numbers(scene, parameter)
            assert own is not None, "only such parameters share a build"
            slope[j, own] = difference[own] / (2.0 * parameter.step)
            difference[own] = 0.0
        if not np.any(difference):
            return []
    # something is switched, or a parameter changes more than its contact or body: one at a time
    slope[group] = 0.0
    return [j for one in group for j in _fill_group(slope, [one], parameters, action_and_builder, scene)]


def effective_paths(action: ActionLike, choice: SceneChoice | None = None) -> list[str]:
    """Paths of all parameters that have a derivative in a scene (None: the action's own): those that change something
    and are not switched off.

    Parameters
    ----------
    action : parameter set
    choice : the scene; by default what the action says

    Returns
    -------
    list of str
        In the order of the action's file; effects' parameters last.

    Examples
    --------
    >>> import model
    >>> paths = model.sensitivity.effective_paths(model.load_action(), model.load_scene("key"))
    >>> "key.mass" in paths, "hammer.mass" in paths
    (True, False)
    """
    action = as_action(action)
    choice = choice_of(action) if choice is None else choice
    out = []
    for path in (*action.quantities, *action.effects):
        try:
            directions(action, choice, find_parameters(action, [path]))
        except InputError:
            continue
        out.append(path)
    return out


def _has_same_structure(scene: Scene, other: Scene) -> bool:
    return all(
        a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in zip(scene.tables, other.tables, strict=True)
    )


def _gap_bound_places(scene: Scene) -> NDArray[np.int64]:
    """Indices of parameters that bound gaps: they decide what is skipped, never a force."""
    start, end = int(scene.tables.offset[1]), int(scene.tables.offset[2])
    rows = np.arange(start, end, L.CONTACT_SIZE)[:, None] + np.arange(L.REACH, L.CONTACT_SIZE)
    return rows.ravel()
