"""Names of what can be identified: single parameters, the stiffness of a felt, and groups of them.

A name is one of those of ``--set`` and ``--scale``, or ``felt:contact02``: stiffness and damping of that felt. A group
stands for its members, each free by itself:

    friction            coefficient A of every contact that has one
    joint_friction      torque A of every joint
    damping             D of every contact
    stiffness           stiffness of every contact: a, b, c by one factor
    springs             torque or stiffness of the two springs
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase

import model
from validation.errors import ValidationInputError

FELT = "felt:"
STIFFNESS = ("a", "b", "c")
PARAMETERS = "--parameters"
NORMAL = (".second.normal.x", ".second.normal.y")
BELONGS: Mapping[str, Callable[[str, Sequence[str]], bool]] = {
    "friction": lambda name, paths: name.endswith(".friction.A"),
    "joint_friction": lambda name, paths: name.endswith(".joint_friction.A"),
    "damping": lambda name, paths: name.endswith(".normal.D"),
    "stiffness": lambda name, paths: len(paths) > 1,
    "springs": lambda name, paths: (
        name.split(".")[0].endswith("_spring") and name.split(".")[-1] in ("torque", "stiffness")
    ),
}
"""Whether a single name with its paths belongs to a group."""
GROUPS = tuple(BELONGS)


def single_names(action: model.Action) -> dict[str, tuple[str, ...]]:
    """Every single thing that can be free, name -> paths that move together; values of zero are left out."""
    values = {path: q.value for path, q in action.quantities.items()}
    names: dict[str, tuple[str, ...]] = {}
    for path, value in values.items():
        owner, _, last = path.rpartition(".")
        if owner.endswith(".normal") and last in STIFFNESS:
            name = owner.removesuffix(".normal")
            names[name] = (*names.get(name, ()), path)
        elif value != 0.0:
            names[path] = (path,)
    return names


def group_members(action: model.Action, group: str) -> list[str]:
    """Single names of a group; empty where it is none."""
    if group not in BELONGS:
        return []
    return [name for name, paths in single_names(action).items() if BELONGS[group](name, paths)]


def expand(action: model.Action, asked: Sequence[str], option: str = PARAMETERS) -> list[str]:
    """Single names of what was asked for, in that order, each once.

    Parameters
    ----------
    action : model.Action
    asked : sequence of str
        Names, groups or patterns.
    option : str
        For messages.

    Raises
    ------
    ValidationInputError
        Nothing has that name, the value is zero, so that nothing says how large it might be, or it is to be identified
        and fixed by the geometry.
    """
    names = single_names(action)
    found: dict[str, None] = {}
    for text in (part.strip() for part in asked):
        members = group_members(action, text)
        if text.startswith(FELT):
            felt = text.removeprefix(FELT)
            members = [n for n in (felt, f"{felt}.normal.D") if n in names]
        elif text in names:
            members = [text]
        elif f"{text}.A" in names:  # a law by its name, as in --scale
            members = [f"{text}.A"]
        elif not members:
            members = [n for n in names if fnmatchcase(n, text)] if "*" in text else []
            members = members or [n for n in names if n.rpartition(".")[0] == text and text.endswith("_spring")]
        if option == PARAMETERS:
            members = _free(action, text, members)
        if not members:
            raise ValidationInputError(_unknown(action, text, option))
        found |= dict.fromkeys(members)
    if not found:
        raise ValidationInputError(f"{option}: no parameter given; allowed names of --set, or {', '.join(GROUPS)}")
    return list(found)


def _free(action: model.Action, text: str, members: list[str]) -> list[str]:
    """Those that can be identified: no component of a unit normal, which the other one and the length fix."""
    if text in action.structure:
        raise ValidationInputError(
            f"{PARAMETERS} {text}: is fixed by the geometry (it says {action.structure[text]!r}, which is no number); "
            "leave it out"
        )
    if text.endswith(NORMAL) and text in action.quantities:
        raise ValidationInputError(
            f"{PARAMETERS} {text}: is fixed by the geometry, as one component of a direction of length 1; leave it "
            "out, or identify a position of the same contact"
        )
    return [name for name in members if not name.endswith(NORMAL)]


def _unknown(action: model.Action, text: str, option: str) -> str:
    for path in (text, f"{text}.A"):
        if path in action.quantities:
            return (
                f"{option} {path}: its value is {action[path]:g}, so nothing says how large it may be (no prior); "
                "set it to its order of magnitude with --set, or leave it out"
            )
    known = [*GROUPS, *single_names(action)]
    near = difflib.get_close_matches(text.removeprefix(FELT), known, n=1)
    hint = f"; did you mean {near[0]}" if near else ""
    return f"{option} {text}: no such parameter, felt or group{hint}; groups: {', '.join(GROUPS)}"
