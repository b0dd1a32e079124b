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

    @property
    def kind(self) -> EventKind:
        """Title, unit and definition of this event."""
        return EVENTS[self.name]


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


EVENTS: dict[str, EventKind] = {
    "onset": EventKind("Onset", "s", "ms", 1e3, "key dip first rises through 0.1 mm above its rest", bodies=("key",)),
    "let_off": EventKind(
        "Let-off",
        "s",
        "ms",
        1e3,
        "free flight begins: last time before the impact at which the hammer is 0.1 mm off the path of its flight",
    ),
    "key_bottom": EventKind(
        "Key bottom",
        "s",
        "ms",
        1e3,
        "key dip first rises through the dip at which the key front touches its felt",
        bodies=("key",),
    ),
    "string_impact": EventKind(
        "String impact",
        "s",
        "ms",
        1e3,
        "hammer height first falls to 0 and the hammer turns back within 4 ms",
    ),
    "hammer_speed": EventKind(
        "Hammer speed at impact",
        "m/s",
        "m/s",
        1.0,
        "speed of the hammer head towards the string just before contact, one-sided fit",
    ),
    "rebound_speed": EventKind(
        "Rebound speed", "m/s", "m/s", 1.0, "speed of the hammer head away from the string just after contact"
    ),
    "check_time": EventKind(
        "Check begins",
        "s",
        "ms",
        1e3,
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
    "key_release": EventKind(
        "Key release", "s", "ms", 1e3, "key dip falls for the last time through half the touching dip", bodies=("key",)
    ),
    "drop": EventKind(
        "Drop",
        "s",
        "ms",
        1e3,
        "hammer first is 0.5 mm further from the string than where it was held",
    ),
    "landing": EventKind(
        "Landing",
        "s",
        "ms",
        1e3,
        "after the drop, when the hammer is furthest from the string before it first comes back by 0.3 mm",
    ),
    "second_strike": EventKind(
        "Second strike",
        "s",
        "ms",
        1e3,
        "a further string impact after the hammer was 5 mm away",
        expected=False,
    ),
    "rest": EventKind(
        "Rest",
        "s",
        "ms",
        1e3,
        "hammer height and key dip stay within 0.1 mm of where they began, at least 50 ms",
        bodies=("key", "hammer"),
    ),
}


def absent(name: str, note: str = "") -> Event:
    """An event that did not happen."""
    return Event(name, float("nan"), float("nan"), "absent", note)
