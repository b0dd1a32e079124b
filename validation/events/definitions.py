"""What an event is: a value, its standard uncertainty, and whether it happened at all; the definition of each event.

Conventions: times in s on the DAQ clock, heights in m, speeds in m/s; NaN when the event did not happen. An event that
cannot be decided has status ``ambiguous`` and a note, never an exception.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Status = Literal["found", "absent", "ambiguous"]


@dataclass(frozen=True)
class Event:
    """One event of one keystroke; ``value`` and ``u`` are NaN unless the status is found or ambiguous."""

    name: str
    value: float
    u: float
    status: Status
    note: str = ""


@dataclass(frozen=True)
class EventKind:
    """How an event is called and shown: value × ``display_factor`` in ``display_unit``; the encoders it needs."""

    title: str
    unit: str
    display_unit: str
    display_factor: float
    definition: str
    expected: bool = True
    bodies: tuple[str, ...] = ("hammer",)

    @property
    def label(self) -> str:
        """Title with the unit it is shown in."""
        return f"{self.title} ({self.display_unit})"


def _time(title: str, definition: str, *, expected: bool = True, bodies: tuple[str, ...] = ("hammer",)) -> EventKind:
    return EventKind(title, "s", "ms", 1e3, definition, expected, bodies)


def _speed(title: str, definition: str) -> EventKind:
    return EventKind(title, "m/s", "m/s", 1.0, definition)


EVENTS: dict[str, EventKind] = {
    "onset": _time("Onset", "key dip first rises through 0.1 mm above its rest", bodies=("key",)),
    "let_off": _time(
        "Let-off",
        "free flight begins: last time before the impact at which the hammer is 0.1 mm off the path of its flight",
    ),
    "key_bottom": _time(
        "Key bottom",
        "key dip first rises through the dip at which the key front touches its felt",
        bodies=("key",),
    ),
    "string_impact": _time("String impact", "hammer height first falls to 0 and the hammer turns back within 6 ms"),
    "hammer_speed": _speed(
        "Hammer speed at impact", "speed of the hammer head towards the string just before contact, one-sided fit"
    ),
    "rebound_speed": _speed("Rebound speed", "speed of the hammer head away from the string just after contact"),
    "check_time": _time(
        "Check begins",
        "hammer height enters the band of 0.25 mm around the height it is then held at",
    ),
    "check_height": EventKind(
        "Check height", "m", "mm", 1e3, "median hammer height while held for at least 20 ms after the impact"
    ),
    "check_bounces": EventKind(
        "Bounces before the check",
        "1",
        "count",
        1.0,
        "number of times the hammer turns round by at least 0.3 mm between impact and check",
    ),
    "key_release": _time(
        "Key release", "key dip falls for the last time through half the touching dip", bodies=("key",)
    ),
    "drop": _time("Drop", "hammer first is 0.5 mm further from the string than where it was held"),
    "landing": _time(
        "Landing", "after the drop, when the hammer is furthest from the string before it first comes back by 0.3 mm"
    ),
    "second_strike": _time("Second strike", "a further string impact after the hammer was 5 mm away", expected=False),
    "rest": _time(
        "Rest",
        "hammer height and key dip stay within 0.1 mm of where they began, at least 50 ms",
        bodies=("key", "hammer"),
    ),
}
