"""Parts of an action by the names that a technician uses, in place of parameter paths.

The names of regulating screws are those of `model.regulation`; other parameters are named by their body or contact.
"""

from __future__ import annotations

import re

import model

SCREWS = {
    "contact02.first.y": "key-dip washers",
    "contact01.first.y": "capstan",
    "contact05.second.x": "jack rest pad",
    "contact06.second.y": "repetition rest pad",
    "contact08.second.y": "let-off button",
    "contact11.first.y": "drop screw",
    "contact04.second.x": "back-check wire",
}
BODY = {
    "mass": "mass of the {}",
    "inertia": "inertia of the {}",
    "center_of_mass": "centre of mass of the {}",
    "pivot": "pivot of the {}",
    "joint_friction": "friction of the joint of the {}",
}
CONTACT = {
    "normal": "felt of the contact {}",
    "friction": "friction of the contact {}",
    "first": "place of the contact {}",
    "second": "place of the contact {}",
}
SPRING = {"jack_spring": "spring of the jack", "repetition_spring": "spring of the repetition lever"}
BODIES = {"repetition": "repetition lever", **{name: name for name in ("key", "whippen", "jack", "hammer")}}
PATH = re.compile(rf"(?<![\w.(])((?:contact\d\d(?:_\d)?|{'|'.join((*BODIES, *SPRING))})(?:\.[A-Za-z]\w*)+)")


def name_parts(text: str, action: model.Action) -> str:
    """A text with each parameter path led by the name of its part, the path in brackets where it first stands."""
    said: set[str] = set()

    def named(found: re.Match[str]) -> str:
        path = found[1]
        name = part_name(path, action)
        if not name:
            return path
        first = path not in said
        said.add(path)
        return f"{name} ({path})" if first else name

    return PATH.sub(named, text)


def part_name(path: str, action: model.Action) -> str:
    """The part that a parameter belongs to; empty where none is known."""
    if path in SCREWS:
        return SCREWS[path]
    owner, kind, *_ = (*path.split("."), "")
    if owner in SPRING:
        return SPRING[owner]
    if owner in BODIES:
        return BODY[kind].format(BODIES[owner]) if kind in BODY else ""
    description = str(action.structure.get(f"{owner}.description", ""))
    return CONTACT[kind].format(description) if description and kind in CONTACT else ""
