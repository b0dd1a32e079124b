"""Scaling of parameters, singly, by law or by group: ``{"damping": 0.1}``, ``{"contact04.friction": 0.5}``.

A name is a path, a pattern (``*.mass``, ``contact*.normal.D``) or one of these:

    damping             D of every contact but the string's, which is fitted to the rebound (thesis 2.2.3, 4.4)
    friction            coefficient A of every contact
    joint_friction      torque A of every joint
    contact04           stiffness of that felt: a, b, c (contact04.normal likewise)
    contact04.friction  its coefficient A (key.joint_friction likewise)
    jack_spring         its torque and stiffness

An unknown name is refused with the nearest one that exists. A group leaves out felts whose law has no D, and says so.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from fnmatch import fnmatchcase

from model.errors import InputError, did_you_mean
from model.parameters.action import CONTACTS, STRING, Action, ActionLike, as_action

GROUPS = ("damping", "friction", "joint_friction")


def _names(action: Action) -> dict[str, list[str]]:
    kept: dict[str, list[str]] | None = action.__dict__.get("paths_by_name")
    if kept is None:
        kept = action.__dict__["paths_by_name"] = _all_names(action)
    return kept


def _all_names(action: Action) -> dict[str, list[str]]:
    """Parameter paths by every name that stands for some: paths, owners of laws, contacts and groups."""
    paths = [*action.quantities, *action.effects]
    names = {path: [path] for path in paths}
    for path in paths:
        owner, _, last = path.rpartition(".")
        if last == "A" or owner.endswith("_spring") and last in ("torque", "stiffness"):
            names.setdefault(owner, []).append(path)
        elif owner.endswith(".normal") and last in ("a", "b", "c"):
            names.setdefault(owner, []).append(path)
            names.setdefault(owner.removesuffix(".normal"), []).append(path)
    names["damping"] = [f"{name}.normal.D" for name in CONTACTS if name != STRING]
    names["friction"] = [f"{name}.friction.A" for name in CONTACTS]
    names["joint_friction"] = [path for path in action.quantities if path.endswith(".joint_friction.A")]
    return names


def named_paths(action: Action, name: str, where: str) -> list[str]:
    """Parameter paths that a name stands for: a path, a pattern, a law or a group; `InputError` where there are
    none."""
    names = _names(action)
    # a pattern means single parameters; a law or group is named in full
    paths = names.get(name) or [path for path in action.quantities if fnmatchcase(path, name)]
    if not paths:
        hint = did_you_mean(name, names, 3)
        raise InputError(f"{where} {name}: no such parameter, law or group{hint}groups: {', '.join(GROUPS)}")
    return paths


def scale_parameters(action: ActionLike, factors: Mapping[str, float]) -> Action:
    """Copy of ``action`` with parameters multiplied by ``factors`` (path, pattern, law or group -> factor), in the
    order given; those that a felt's law does not have are left out, with a warning.

    Parameters
    ----------
    action : parameter set; not changed
    factors : name, path or pattern -> factor

    Returns
    -------
    Action

    Raises
    ------
    InputError : nothing has that name, the factor is not finite, or a value leaves its allowed range

    Examples
    --------
    >>> import model
    >>> light = model.scale_parameters(model.load_action("hirschkorn2004"), {"hammer.mass": 0.5})
    >>> light["hammer.mass"] / model.load_action("hirschkorn2004")["hammer.mass"]
    0.5
    """
    action = as_action(action)
    for name, factor in factors.items():
        if not math.isfinite(factor):
            raise InputError(f"`factors` {name}: factor found {factor}, allowed a finite number")
        named = named_paths(action, name, "`factors`")
        paths = [path for path in named if len(named) == 1 or action.felt_has(path)]
        idle = ", ".join(f"{path} (law {action.law(path.partition('.')[0])})" for path in named if path not in paths)
        if not paths:
            raise InputError(f"`factors` {name}: would change nothing, found {idle}; choose another or leave it out")
        if idle:
            warnings.warn(f"`factors` {name}: leaves out what its felt's law does not have: {idle}", stacklevel=2)
        action = action.with_values({path: factor * action[path] for path in paths}, f"`factors` {name}={factor:g}")
    return action
