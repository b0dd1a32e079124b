"""Events of a blow and their derivatives: what is regulated and heard, as numbers.

An event's time is where a function of the state passes a level; its derivative follows from that level. Values are read
at the event. Names end in the unit. The times are found on the recorded motion before its derivatives are computed, so
that those are had exactly there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.kernels.trajectory.contact_forces import penetrations
from model.observables import hammer_height_m, key_dip_m, key_front_gap_m
from model.parameters.action import BACK_CHECK, BODIES, JACK_KNUCKLE, LEVER_KNUCKLE, STRING, Action
from model.parameters.effects import SHANK
from model.sensitivity.observed import force_slopes, total_slopes
from model.sensitivity.tangents import Recorded

Array = NDArray[np.float64]

EVENTS = {
    "onset_s": "key dip first rises through 0.1 mm",
    "key_bottom_s": "the key front first touches its felt",
    "let_off_s": "last time before the strike that jack or repetition lever press on the knuckle: free flight begins",
    "let_off_m": "distance of the hammer from the string then",
    "strike_s": "the hammer first touches the string",
    "strike_m_per_s": "its speed towards the string then",
    "rebound_s": "it leaves the string again",
    "rebound_m_per_s": "its speed away from the string then",
    "check_s": "the back check first presses after the strike",
    "check_m": "distance of the hammer from the string half-way through the hold",
    "drop_s": "the hammer first is 0.5 mm further from the string than that, after the hold",
}
DIP_M, DROP_M = 1e-4, 5e-4
SHORTEST_HOLD_S = 0.05
SPACING_S = 1e-4  # of the times at which a level is looked for


@dataclass
class Found:
    """Events of one motion: time of each, why others are absent, and when the hammer is held."""

    at: dict[str, float] = field(default_factory=dict)
    absent: dict[str, str] = field(default_factory=dict)

    def times(self) -> Array:
        """All times at which states are needed, in order."""
        return np.unique(list(self.at.values()))


class Events:
    """Finds and differentiates the events of one motion.

    ``recorded`` gives states and accelerations at any times of ``span``.
    """

    def __init__(self, action: Action, recorded: Recorded, span: tuple[float, float]) -> None:
        self.action, self.recorded, self.states = action, recorded, recorded.states
        self.directions = recorded.directions
        self.scene = self.directions.scene
        self.times = np.append(np.arange(span[0], span[1], SPACING_S), span[1])
        self.angle, self.speed = recorded.states(self.times)
        self.found = Found()

    # quantities, (m,) of states (m, n)

    def _height(self, action: Action, angle: Array, _: Array) -> Array:
        bend = angle[:, self.scene.bodies.index(SHANK)] if SHANK in self.scene.bodies else None
        return hammer_height_m(action, angle, bend)

    def _approach(self, action: Action, angle: Array, speed: Array) -> Array:
        """Speed towards the string: the height's rate, by a difference along the motion."""
        h = 1e-5
        ends = [self._height(action, angle + s * h * speed, speed) for s in (1.0, -1.0)]
        return np.asarray((ends[1] - ends[0]) / (2.0 * h))

    @staticmethod
    def _front(action: Action, angle: Array, _: Array) -> Array:
        return key_front_gap_m(action, angle)

    def _presses(self, contact: str) -> Array:
        """Penetration (m,) of a contact along the motion; negative where it is open."""
        return self._all_depths[:, self.scene.contacts.index(contact)]

    @cached_property
    def _all_depths(self) -> Array:
        return self._depths(self.angle, self.speed, self.scene.vector)

    def _depths(self, angle: Array, speed: Array, vector: Array) -> Array:
        out = np.empty((len(angle), len(self.scene.contacts)))
        for row, q, v in zip(out, angle, speed, strict=True):
            penetrations(np.ascontiguousarray(q), np.ascontiguousarray(v), vector, self.scene.tables, row)
        return out

    # where a level is passed

    def _root(self, value: Callable[[Array, Array], Array], k: int) -> float:
        """Time between samples ``k`` and ``k + 1`` at which ``value`` changes sign."""
        left, right = float(self.times[k]), float(self.times[k + 1])
        sign = float(value(self.angle[k : k + 1], self.speed[k : k + 1])[0]) > 0.0
        for _ in range(60):
            middle = 0.5 * (left + right)
            if not left < middle < right:
                break
            if (float(value(*self.states(np.array([middle])))[0]) > 0.0) == sign:
                left = middle
            else:
                right = middle
        return 0.5 * (left + right)

    def _first(self, name: str, value: Callable[[Array, Array], Array], rising: bool, after: float, why: str) -> bool:
        """Note the first time from ``after`` on at which ``value`` passes zero."""
        y = value(self.angle, self.speed)
        above = y > 0.0
        passes = (above[1:] & ~above[:-1]) if rising else (~above[1:] & above[:-1])
        at = np.flatnonzero(passes & (self.times[1:] > after))
        if not len(at):
            self.found.absent[name] = why
            return False
        self.found.at[name] = self._root(value, int(at[0]))
        return True

    def find(self) -> Found:
        """Times of all events."""
        missing = [body for body in BODIES if body not in self.scene.bodies[: len(BODIES)]]
        if missing or self.scene.bodies[: len(BODIES)] != BODIES:
            self.found.absent.update(dict.fromkeys(EVENTS, f"the scene has no free {' or '.join(missing) or 'key'}"))
            return self.found
        action = self.action
        rest = self.angle[0]
        self._first(
            "onset_s",
            lambda q, _: key_dip_m(action, q, rest) - DIP_M,
            True,
            -np.inf,
            "the key dips by less than 0.1 mm",
        )
        self._first(
            "key_bottom_s", lambda q, v: self._front(action, q, v), False, -np.inf, "the key does not reach its felt"
        )
        if STRING in self.scene.contacts and self._first(
            "strike_s", lambda q, v: self._height(action, q, v), False, -np.inf, "the hammer does not reach the string"
        ):
            self._after_strike()
        else:
            why = self.found.absent.setdefault("strike_s", "the scene has no string")
            for name in EVENTS:
                if name not in self.found.at:
                    self.found.absent.setdefault(name, why)
        self.found.absent.update(
            {name: self.found.absent[other] for name, other in _READ_AT.items() if other in self.found.absent}
        )
        return self.found

    def _after_strike(self) -> None:
        action, strike = self.action, self.found.at["strike_s"]
        self._first(
            "rebound_s", lambda q, v: self._height(action, q, v), True, strike, "the hammer does not leave the string"
        )
        knuckle = np.maximum(self._presses(JACK_KNUCKLE), self._presses(LEVER_KNUCKLE)) > 0.0
        before = np.flatnonzero(knuckle[:-1] & ~knuckle[1:] & (self.times[1:] < strike))
        if len(before):
            k = int(before[-1])
            leaving = JACK_KNUCKLE if self._presses(JACK_KNUCKLE)[k] > 0.0 else LEVER_KNUCKLE
            self._leaver = leaving
            self.found.at["let_off_s"] = self._root(lambda q, v: self._depth_of(leaving, q, v), k)
        else:
            self.found.absent["let_off_s"] = "the hammer is carried to the string"
        if BACK_CHECK not in self.scene.contacts:
            self.found.absent["check_s"] = self.found.absent["check_m"] = "the scene has no back check"
            self.found.absent["drop_s"] = "the scene has no back check"
            return
        self._hold(strike)

    def _depth_of(self, contact: str, angle: Array, speed: Array) -> Array:
        return self._depths(angle, speed, self.scene.vector)[:, self.scene.contacts.index(contact)]

    def _hold(self, strike: float) -> None:
        action = self.action
        if not self._first(
            "check_s", lambda q, v: self._depth_of(BACK_CHECK, q, v), True, strike, "the back check does not touch"
        ):
            self.found.absent["check_m"] = self.found.absent["drop_s"] = "the back check does not touch"
            return
        pressed = self._presses(BACK_CHECK) > 0.0
        last = float(self.times[np.flatnonzero(pressed)[-1]])
        if last - self.found.at["check_s"] < SHORTEST_HOLD_S:
            self.found.absent["check_m"] = self.found.absent["drop_s"] = "the hammer is not held"
            return
        middle = 0.5 * (self.found.at["check_s"] + last)
        self.found.at["check_m"] = middle
        level = float(self._height(action, *self.states(np.array([middle])))[0]) + DROP_M
        self._first(
            "drop_s", lambda q, v: self._height(action, q, v) - level, True, middle, "the hammer does not drop again"
        )

    # values and derivatives

    def differentiate(self, times: Array, slopes: tuple[Array, Array]) -> tuple[dict[str, float], dict[str, Array]]:
        """Values and derivatives (P,) of all events; ``slopes`` are those of angles and speeds at ``times``."""
        events = dict.fromkeys(EVENTS, float("nan"))
        count = len(self.directions.parameters)
        d_events = {name: np.full(count, np.nan) for name in EVENTS}
        row = {float(t): k for k, t in enumerate(times)}
        for name in ("check_m", *(name for name in self.found.at if name != "check_m")):
            if name not in self.found.at:
                continue
            t = self.found.at[name]
            k = row[t]
            state = self.states(np.array([t]))
            own = (slopes[0][k : k + 1], slopes[1][k : k + 1])
            if name == "check_m":
                events[name] = float(self._height(self.action, *state)[0])
                d_events[name] = self._slope(self._height, state, own)
                continue
            events[name], d_events[name] = t, self._moved(name, state, own, d_events["check_m"])
            for value, at in _READ_AT.items():
                if at == name and value != name:
                    quantity = self._height if value.endswith("_m") else self._approach
                    sign = -1.0 if value.startswith("rebound") else 1.0
                    y = float(quantity(self.action, *state)[0])
                    rate = self._rate(quantity, t, state)
                    events[value] = sign * y
                    d_events[value] = sign * (self._slope(quantity, state, own) + rate * d_events[name])
        return events, d_events

    def _slope(
        self, quantity: Callable[[Action, Array, Array], Array], state: tuple[Array, Array], own: tuple[Array, Array]
    ) -> Array:
        out: Array = total_slopes(self.action, self.directions.parameters, quantity, state, own)[0]
        return out

    def _rate(self, quantity: Callable[[Action, Array, Array], Array], t: float, state: tuple[Array, Array]) -> float:
        """How fast a quantity changes at a time."""
        angle, speed = state
        h, acceleration = 1e-7, self.recorded.acceleration(t)
        ends = [quantity(self.action, angle + s * h * speed, speed + s * h * acceleration)[0] for s in (1.0, -1.0)]
        return float((ends[0] - ends[1]) / (2.0 * h))

    def _moved(self, name: str, state: tuple[Array, Array], own: tuple[Array, Array], d_check: Array) -> Array:
        """Derivative (P,) of the time of an event: what is passed moves by d, and changes at a rate."""
        contact = {"check_s": BACK_CHECK, "let_off_s": getattr(self, "_leaver", "")}.get(name)
        if contact:
            c = self.scene.contacts.index(contact)
            d = force_slopes(self.directions, self._depths, state, own)[0, c]
            h = 1e-7
            ends = [self._depth_of(contact, state[0] + s * h * state[1], state[1])[0] for s in (1.0, -1.0)]
            return np.asarray(-d * 2.0 * h / (ends[0] - ends[1]))
        if name == "onset_s":
            rest, d_rest = self.angle[0], self.recorded.d_rest

            # the dip is counted from rest, which moves too: a difference of two heights
            def dip(action: Action, angle: Array, _: Array) -> Array:
                return key_dip_m(action, angle[:1], angle[1])

            both = np.vstack([state[0][0], rest]), np.zeros((2, len(rest)))
            slopes = np.concatenate([own[0], d_rest[None]]), np.zeros((2, len(rest), len(d_check)))
            d = total_slopes(self.action, self.directions.parameters, dip, both, slopes)[0]
            rate = self._along(lambda q: key_dip_m(self.action, q, rest), state)
            return np.asarray(-d / rate)
        if name == "key_bottom_s":
            d = self._slope(self._front, state, own)
            return np.asarray(-d / self._along(lambda q: self._front(self.action, q, q), state))
        d = self._slope(self._height, state, own)
        if name == "drop_s":
            d = d - d_check
        return np.asarray(-d / self._along(lambda q: self._height(self.action, q, q), state))

    @staticmethod
    def _along(value: Callable[[Array], Array], state: tuple[Array, Array]) -> float:
        """Rate of a function of the angles along the motion."""
        h = 1e-7
        return float((value(state[0] + h * state[1])[0] - value(state[0] - h * state[1])[0]) / (2.0 * h))


_READ_AT = {"let_off_m": "let_off_s", "strike_m_per_s": "strike_s", "rebound_m_per_s": "rebound_s"}
