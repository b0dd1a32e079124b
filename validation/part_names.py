"""Parts of an action by the names that a technician uses, in place of parameter paths."""

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
    "contact13.first.y": "hammer rest rail",
}
"""What is turned or bent when an action is regulated, as in `model.regulation.screws`."""
QUANTITIES = {
    "center_of_mass": "centre of mass",
    "first": "place",
    "friction": "friction",
    "hysteresis": "hysteresis of the felt",
    "normal": "stiffness of the felt",
    "normal.D": "damping of the felt",
    "preload_n": "preload",
    "second": "place",
    "stulov": "hysteresis of the felt",
    **dict.fromkeys(("b1", "b2"), "damping"),
    **dict.fromkeys(("contact_a", "contact_b", "contact_c", "pad_a", "pad_b", "pad_c"), "stiffness of the felt"),
}
"""Quantities that are not called as their parameter is."""
OWNERS = {
    "button": "let-off button",
    "jack stop": "jack rest pad",
    "key back": "back of the key",
    "key front": "front of the key",
    "repetition stop": "repetition rest pad",
    "rest": "rest rail",
    "drive": "finger or motor arm",
    "repetition": "repetition lever",
    "repetition_pin": "repetition lever's pin",
    "repetition_spring": "repetition spring",
    "key_pin": "key's pin",
    "jack_pin": "jack's pin",
    "whippen_pin": "whippen's pin",
    "hammer_pin": "hammer's pin",
}
"""Bodies, effects and ends of contacts that are not called as in an action file."""
PATH = re.compile(
    r"(?<![\w.(])((?:contact\d\d(?:_\d)?|(?:key|whippen|jack|repetition|hammer)(?:_pin|_spring)?|string|shank|finger|drive|"
    r"balance_rail|motor_arm|motor_drive)(?:\.[A-Za-z]\w*)+)(?!\))"
)


def name_parts(text: str, action: model.Action) -> str:
    """A text with each parameter path led by the name of its part, the path in brackets where it first stands."""
    said: set[str] = set()

    def named(found: re.Match[str]) -> str:
        path = found[1]
        if path in said:
            return part_name(path, action)
        said.add(path)
        return f"{part_name(path, action)} ({path})"

    return PATH.sub(named, text)


def part_name(path: str, action: model.Action) -> str:
    """The name of a parameter: a screw's, or a quantity of a part or of the two parts that touch."""
    if path in SCREWS:
        return SCREWS[path]
    owner, _, rest = path.partition(".")
    kind, *parts = rest.split(".")
    quantity = QUANTITIES.get(rest, QUANTITIES.get(kind, kind.removesuffix("_hz").replace("_", " ")))
    quantity = "radius" if parts == ["radius"] else quantity
    contact = str(action.structure.get(f"{owner}.description", ""))
    touching = [OWNERS.get(part, part) for part in contact.split(" - ")]
    if len(touching) == 2:
        where = "where {} and {} touch" if quantity == "place" else "between {} and {}"
        return f"{quantity} {where.format(*touching)}"
    return f"{quantity} of the {touching[0] or OWNERS.get(owner, owner.replace('_', ' '))}"
