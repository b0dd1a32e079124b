"""The quantities of a verdict: which there are, which the claim rests on, how much of each matters.

Conventions: SI and rad; model − trial. A phase of a stroke ends at an event of the trial itself: *attack* at the string
impact, *check* at the key's release, *release* at the end of the window. Where the event that ends a phase is not
recorded, the phase goes on to the next one that is, and the phase that should follow has no sample.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.curves.display_signs import TITLE
from validation.errors import ValidationInputError
from validation.events.definitions import EVENTS, Event
from validation.events.session_events import Window
from validation.measurement.geometry import Motion

CHANNELS = (*ENCODER_CHANNELS, *FILM_CHANNELS)
PHASES = {"attack": "string_impact", "check": "key_release", "release": ""}
"""Each phase and the event that ends it."""


@dataclass(frozen=True)
class Relevance:
    """A limit from which a difference matters: its default, and the unit and factor in which it is given and shown."""

    default: float
    unit: str
    factor: float
    of_value: bool = False
    """Whether it is a share of the measured quantity."""


SHARE = 0.05  # of what was measured: choice
RELEVANT = {
    "travel": Relevance(SHARE, "%", 100.0, of_value=True),
    "check_height": Relevance(2e-3, "mm", 1e3),
    "let_off": Relevance(0.5e-3, "mm", 1e3),
    "time": Relevance(2e-3, "ms", 1e3),
    "speed": Relevance(SHARE, "%", 100.0, of_value=True),
}
"""Limits of relevance by name: shares of a channel's travel and of the speed at impact, lengths, a time."""


@dataclass(frozen=True)
class Quantity:
    """One quantity of a stroke; value × ``factor`` in ``unit_shown``.

    ``relevant`` is a key of `RELEVANT` for the primary ones, empty for those that are shown and not in the claim.
    """

    name: str
    title: str
    unit: str
    unit_shown: str
    factor: float
    relevant: str = ""
    channel: str = ""
    phase: str = ""
    bodies: tuple[str, ...] = ("hammer",)

    @property
    def is_primary(self) -> bool:
        return bool(self.relevant)


def _angle(channel: str, phase: str) -> Quantity:
    degrees = 180.0 / np.pi
    title = f"{TITLE[channel]} in {phase}"
    return Quantity(f"{channel}_in_{phase}", title, "rad", "°", degrees, "travel", channel, phase, (channel,))


def _event(name: str, relevant: str = "") -> Quantity:
    kind = EVENTS[name]
    title = kind.title[0].lower() + kind.title[1:]
    return Quantity(name, title, kind.unit, kind.display_unit, kind.display_factor, relevant, bodies=kind.bodies)


LET_OFF = Quantity("let_off_distance", "let-off", "m", "mm", 1e3, "let_off")
PRIMARY_EVENTS = {"string_impact": "time", "hammer_speed": "speed", "check_height": "check_height"}
ANGLES = tuple(_angle(channel, phase) for channel in CHANNELS for phase in PHASES)
EVENT_QUANTITIES = tuple(
    _event(name, PRIMARY_EVENTS.get(name, "")) for name, kind in EVENTS.items() if kind.unit != "1"
)
QUANTITIES = (*ANGLES, LET_OFF, *EVENT_QUANTITIES)
"""All quantities, angles first; every array of this package has them in this order."""
INDEX = {q.name: i for i, q in enumerate(QUANTITIES)}
IS_PRIMARY = np.array([q.is_primary for q in QUANTITIES])


def relevance_limits(given: Mapping[str, float]) -> dict[str, float]:
    """Limits of relevance by name (travel, check_height, let_off, time, speed), in SI or as a share, the defaults where
    ``given`` has none; raises an input error for an unknown name or a limit not above 0."""
    for name, value in given.items():
        if name not in RELEVANT:
            raise ValidationInputError(f"relevant: {name!r} is no limit; allowed {', '.join(RELEVANT)}")
        if not (np.isfinite(value) and value > 0):
            raise ValidationInputError(f"relevant: {name} is {value:g}; a limit must be above 0")
    return {name: float(given.get(name, kind.default)) for name, kind in RELEVANT.items()}


def quantity_limits(limits: Mapping[str, float], travel: Mapping[str, float], values: Array) -> Array:
    """Limit of relevance of each of `QUANTITIES` in its unit, (V,), from ``limits`` by name, the ``travel`` of each
    channel, rad, and the measured ``values`` as of `event_values`; NaN where it is not primary or not measured."""
    out = np.full(len(QUANTITIES), np.nan)
    for i, q in enumerate(QUANTITIES):
        if q.is_primary:
            measured = travel.get(q.channel, np.nan) if q.channel else values[i - len(ANGLES)]
            out[i] = limits[q.relevant] * (measured if RELEVANT[q.relevant].of_value else 1.0)
    return out


def phase_masks(time_s: Array, events: Mapping[str, Event], window: Window) -> dict[str, NDArray[np.bool_]]:
    """Masks (n,) of the samples at ``time_s`` (n,) in the phases attack, check and release of one trial, by name,
    inside the window; all False for a phase whose begin is not recorded."""
    ends = {phase: events[event].value if event in events else float("nan") for phase, event in PHASES.items()}
    out: dict[str, NDArray[np.bool_]] = {}
    begin, begins, inside = window.start_s, True, window.mask(time_s)
    for k, phase in enumerate(PHASES):
        end = next((t for t in list(ends.values())[k:] if np.isfinite(t)), float("inf"))
        out[phase] = inside & begins & (time_s >= begin) & (time_s < end)
        begins = bool(np.isfinite(ends[phase]))
        begin = max(begin, ends[phase]) if begins else begin
    return out


def event_values(motion: Motion, events: Mapping[str, Event]) -> Array:
    """Values, SI, of the let-off distance, m, and then of `EVENT_QUANTITIES`, in one stroke, in that order; NaN where
    an event did not happen.

    The let-off is the way of the hammer from where its free flight begins to where the string turns it, so that neither
    the zero nor a wrong blow distance enters.
    """
    found = {name: event.value for name, event in events.items() if event.status != "absent"}
    way = float("nan")
    if "let_off" in found and "string_impact" in found:
        height = motion.hammer_height_m
        near = np.abs(motion.time_s - found["string_impact"]) < NEAR_IMPACT_S
        if near.any():
            way = float(np.interp(found["let_off"], motion.time_s, height) - np.nanmin(height[near]))
    return np.array([way, *(found.get(q.name, float("nan")) for q in EVENT_QUANTITIES)])


NEAR_IMPACT_S = 5e-3  # longer than the hammer touches the string
BRANCH = {
    "string_impact": ("the hammer strikes", "the hammer does not strike"),
    "second_strike": ("it strikes twice", "it strikes once"),
    "check_height": ("it is caught", "it is not caught"),
    "key_bottom": ("the key is down", "the key does not come down"),
}
"""What the branch of a motion is known by, with its words where it happens and where it does not."""


def branch_of(events: Mapping[str, Event]) -> int:
    return sum(1 << i for i, name in enumerate(BRANCH) if events[name].status != "absent")


def branch_mask(bodies: Collection[str]) -> int:
    """Bit mask of a branch that the encoders of these bodies determine."""
    return sum(1 << i for i, name in enumerate(BRANCH) if set(EVENTS[name].bodies) <= set(bodies))


def branch_words(branch: int, known: int = -1) -> str:
    """Text of a branch, from the bits in ``known``; without a strike nothing that follows it."""
    bits = [i for i in range(len(BRANCH)) if known >> i & 1 and (i in (0, 3) or branch & 1)]
    said = [words[0] if branch >> i & 1 else words[1] for i, words in enumerate(BRANCH.values()) if i in bits]
    return ", ".join(said) or "no event is known"
