"""Events of a blow and their derivatives: what is regulated and heard, as numbers.

An event's time is where a function of the state passes a level; its derivative follows from that level. Values are read
at the event. Names end in the unit. The times are found on the recorded motion before its derivatives are computed, so
that those are had exactly there.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from model.codegen.evaluate_observables import contacts_at
from model.codegen.observable_columns import DEPTH, RATE
from model.observables import head_approach_m_per_s, head_height_m, key_dip_m
from model.parameters.action import BACK_CHECK, BODIES, JACK_KNUCKLE, KEY_FRONT, LEVER_KNUCKLE, STRING, Action
from model.scene.build import Scene
from model.sensitivity.observed import SMOOTH_TURN, gradient, parameter_derivatives, state_derivatives
from model.sensitivity.sources import gap_number_places
from model.sensitivity.tangents import RecordedMotion

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
DIP_M, DROP_M = 1e-4, 5e-4  # m, as in the definitions above
SHORTEST_HOLD_S = 0.05  # s in the back check that counts as held
SPACING_S = 1e-4  # of the times at which a level is looked for
RELEASE = "release_s"  # end of the hold; `check_m` is read half-way to it
SHIFT_S = 1e-6  # of a central difference: short against a contact's millisecond, long against rounding
NARROWINGS, NARROWED_BY = 5, 32  # to some 1e-12 s


def contact_columns(scene: Scene, angle: Array, speed: Array, vector: Array | None = None) -> Array:
    """Columns (m, c, 11) of contacts, forces by the slow loading curve, at states (m, n + g), angles or speeds of the
    bodies, then of what joints give; ``vector``: other numbers of the scene.

    Depths and their rates are those of every law.
    """
    numbers, n = scene.vector if vector is None else vector, len(scene.bodies)
    rows = np.concatenate([angle[:, n:], speed[:, n:]], axis=1)  # felt and string play no part in a depth
    return contacts_at(scene.static_tables, numbers, angle[:, :n], speed[:, :n], rows)


class Events:
    """Finds and differentiates the events of one motion.

    ``recorded`` gives states and accelerations at any times of ``span``.
    """

    def __init__(self, action: Action, recorded: RecordedMotion, span: tuple[float, float]) -> None:
        self.action, self.recorded, self.states = action, recorded, recorded.coordinates
        self.directions = recorded.directions
        self.scene = self.directions.scene
        self.span = span
        self.at: dict[str, float] = {}  # time of each event that was found, s
        self.absent: dict[str, str] = {}  # why one was not

    @cached_property
    def times(self) -> Array:
        """Times at which levels are looked for."""
        return np.append(np.arange(*self.span, SPACING_S), self.span[1])

    @cached_property
    def motion(self) -> tuple[Array, Array]:
        """Angles and speeds (m, n) at these times."""
        return self.states(self.times)

    @cached_property
    def depths(self) -> Array:
        """Penetrations (m, c) of all contacts at these times."""
        return contact_columns(self.scene, *self.motion)[:, :, DEPTH]

    # quantities, (m,) of states (m, n), how far joints give after the scene's own coordinates

    def _height(self, action: Action, angle: Array, _: Array) -> Array:
        return head_height_m(action, self.scene.coordinates, angle)

    def _approach(self, action: Action, angle: Array, speed: Array) -> Array:
        return head_approach_m_per_s(action, self.scene.coordinates, angle, speed)

    def _depth_of(self, contact: str, angle: Array, speed: Array, vector: Array | None = None) -> tuple[Array, Array]:
        """Penetration (m,) of a contact, m, negative where it is open, and its rate (m,), m/s."""
        found = contact_columns(self.scene, angle, speed, vector)[:, self.scene.contacts.index(contact)]
        return found[:, DEPTH], found[:, RATE]

    def _depth(self, contact: str, angle: Array, speed: Array) -> Array:
        """Penetration (m,) of a contact alone; at the times at which levels are looked for it is found once for all."""
        if angle is self.motion[0]:
            return self.depths[:, self.scene.contacts.index(contact)]
        return self._depth_of(contact, angle, speed)[0]

    # where a level is passed

    def _refine_crossing(self, value: Callable[[Array, Array], Array], k: int) -> float:
        """Time (s) between samples ``k`` and ``k + 1`` at which ``value``, a function of angles and speeds (m, n),
        changes sign, found in the motion itself."""
        left, right = (float(t) for t in self.times[k : k + 2])
        for _ in range(NARROWINGS):
            at = np.linspace(left, right, NARROWED_BY + 1)
            y = value(*self.states(at))
            j = int(np.argmax((y[1:] > 0.0) != (y[0] > 0.0)))
            left, right = float(at[j]), float(at[j + 1])
        # a line from there: what bends it is below rounding
        return left + (right - left) * float(y[j] / (y[j] - y[j + 1])) if y[j] != y[j + 1] else left

    def _find_first(
        self, name: str, value: Callable[[Array, Array], Array], rising: bool, after: float, why: str
    ) -> bool:
        """Set ``at[name]`` to the first time (s) after ``after`` at which ``value`` (of angles, speeds) crosses zero,
        upwards if ``rising``; where there is none set ``absent[name]`` to ``why`` and return False."""
        y = value(*self.motion)
        above = y > 0.0
        passes = (above[1:] & ~above[:-1]) if rising else (~above[1:] & above[:-1])
        at = np.flatnonzero(passes & (self.times[1:] > after))
        if not len(at):
            self.absent[name] = why
            return False
        self.at[name] = self._refine_crossing(value, int(at[0]))
        return True

    def find(self) -> Array:
        """Find all events, into ``at`` or, with the reason, ``absent``; return the times, in order, at which states are
        needed for them."""
        missing = [body for body in BODIES if body not in self.scene.bodies[: len(BODIES)]]
        if missing or self.scene.bodies[: len(BODIES)] != BODIES:
            self.absent.update(dict.fromkeys(EVENTS, f"the scene has no free {' or '.join(missing) or 'key'}"))
            return np.empty(0)
        action = self.action
        rest = self.motion[0][0]
        self._find_first(
            "onset_s",
            lambda q, _: key_dip_m(action, q, rest) - DIP_M,
            True,
            -np.inf,
            "the key dips by less than 0.1 mm",
        )
        if KEY_FRONT in self.scene.contacts:  # its own depth: where the key lifts, its angle alone does not tell
            front = partial(self._depth, KEY_FRONT)
            self._find_first("key_bottom_s", front, True, -np.inf, "the key does not reach its felt")
        else:
            self.absent["key_bottom_s"] = "the scene has no felt under the key's front"
        if STRING in self.scene.contacts and self._find_first(
            "strike_s", lambda q, v: self._height(action, q, v), False, -np.inf, "the hammer does not reach the string"
        ):
            self._find_events_after_strike()
        else:
            why = self.absent.setdefault("strike_s", "the scene has no string")
            for name in EVENTS:
                if name not in self.at:
                    self.absent.setdefault(name, why)
        self.absent.update({name: self.absent[other] for name, other in _READ_AT.items() if other in self.absent})
        return np.unique(list(self.at.values()))

    def _find_events_after_strike(self) -> None:
        """Set the times (s) of rebound, let-off, check and drop in ``at``, or the reason in ``absent``."""
        action, strike = self.action, self.at["strike_s"]
        self._find_first(
            "rebound_s", lambda q, v: self._height(action, q, v), True, strike, "the hammer does not leave the string"
        )
        driving = [contact for contact in (JACK_KNUCKLE, LEVER_KNUCKLE) if contact in self.scene.contacts]
        presses = {contact: self._depth(contact, *self.motion) > 0.0 for contact in driving}
        knuckle = np.any([np.zeros(len(self.times), dtype=bool), *presses.values()], axis=0)
        before = np.flatnonzero(knuckle[:-1] & ~knuckle[1:] & (self.times[1:] < strike))
        if len(before):
            k = int(before[-1])
            leaving = next(contact for contact in driving if presses[contact][k])
            self._leaver = leaving
            self.at["let_off_s"] = self._refine_crossing(partial(self._depth, leaving), k)
        else:
            self.absent["let_off_s"] = "the hammer is carried to the string"
        if BACK_CHECK not in self.scene.contacts:
            self.absent["check_s"] = self.absent["check_m"] = "the scene has no back check"
            self.absent["drop_s"] = "the scene has no back check"
            return
        self._find_check_and_drop(strike)

    def _find_check_and_drop(self, strike: float) -> None:
        """Set the times (s) of check, mid-hold (``check_m``), release and drop in ``at``, or reasons in ``absent``."""
        action = self.action
        if not self._find_first(
            "check_s", partial(self._depth, BACK_CHECK), True, strike, "the back check does not touch"
        ):
            self.absent["check_m"] = self.absent["drop_s"] = "the back check does not touch"
            return
        pressed, y = self._depth(BACK_CHECK, *self.motion) > 0.0, self._height(action, *self.motion)
        again = (y[:-1] > 0.0) & (y[1:] <= 0.0) & (self.times[1:] > self.at["check_s"])
        pressed[1:] &= np.cumsum(again) == 0  # what is held after another strike is that one's
        k = int(np.flatnonzero(pressed)[-1])
        last = float(self.times[k])
        if last - self.at["check_s"] < SHORTEST_HOLD_S:
            self.absent["check_m"] = self.absent["drop_s"] = "the hammer is not held"
            return
        if k + 1 < len(self.times):  # else it is held to the end
            last = self.at[RELEASE] = self._refine_crossing(partial(self._depth, BACK_CHECK), k)
        middle = 0.5 * (self.at["check_s"] + last)
        self.at["check_m"] = middle
        level = float(self._height(action, *self.states(np.array([middle])))[0]) + DROP_M
        self._find_first(
            "drop_s", lambda q, v: self._height(action, q, v) - level, True, middle, "the hammer does not drop again"
        )

    # values and derivatives

    def differentiate(self, times: Array, slopes: tuple[Array, Array]) -> tuple[dict[str, float], dict[str, Array]]:
        """Values by event (NaN where absent) and derivatives (P,) of each by the parameters; ``slopes`` are those of
        angles and speeds, (k, n, P) each, at ``times`` (k,), as `find` returned them."""
        events = dict.fromkeys(EVENTS, float("nan"))
        count = len(self.directions.parameters)
        d_events = {name: np.full(count, np.nan) for name in EVENTS} | {RELEASE: np.zeros(count)}
        row = {float(t): k for k, t in enumerate(times)}
        first = ("check_s", RELEASE, "check_m")  # each hangs on those before it, and the drop on them
        for name in (*first, *(name for name in self.at if name not in first)):
            if name not in self.at:
                continue
            t = self.at[name]
            k = row[t]
            state = self.states(np.array([t]))
            own = (slopes[0][k : k + 1], slopes[1][k : k + 1])
            if name == "check_m":
                middle = 0.5 * (d_events["check_s"] + d_events[RELEASE])
                events[name] = float(self._height(self.action, *state)[0])
                d_events[name] = (
                    self._total_derivative(self._height, state, own) + self._rate(self._height, t, state) * middle
                )
                continue
            events[name], d_events[name] = t, self._time_derivative(name, state, own, d_events["check_m"])
            for value, at in _READ_AT.items():
                if at == name and value != name:
                    quantity = self._height if value.endswith("_m") else self._approach
                    sign = -1.0 if value.startswith("rebound") else 1.0
                    y = float(quantity(self.action, *state)[0])
                    rate = self._rate(quantity, t, state)
                    events[value] = sign * y
                    d_events[value] = sign * (self._total_derivative(quantity, state, own) + rate * d_events[name])
        for of in (events, d_events):
            of.pop(RELEASE, None)
        return events, d_events

    def _total_derivative(
        self,
        quantity: Callable[[Action, Array, Array], Array],
        state: tuple[Array, Array],
        state_slopes: tuple[Array, Array],
    ) -> Array:
        """Total derivative (P,) of ``quantity`` (of action, angles, speeds) by the parameters, directly and through the
        state; ``state_slopes``, of angles and of speeds: (1, n, P) each."""
        by_angle, by_speed = state_derivatives(partial(quantity, self.action), (state[0][0], state[1][0]))
        of_itself = parameter_derivatives(
            self.action, self.directions.parameters, lambda a: float(quantity(a, *state)[0])
        )
        return np.asarray(by_angle @ state_slopes[0][0] + by_speed @ state_slopes[1][0] + of_itself)

    def _depth_derivative(self, contact: str, state: tuple[Array, Array], angle_slopes: Array) -> Array:
        """Total derivative (P,) of a contact's penetration by the parameters; ``angle_slopes`` (1, n, P) are those of
        the angles."""
        angle, speed = state
        n, depth = angle.shape[1], partial(self._depth_of, contact)
        # what it gains at a speed of one coordinate alone is its slope by that coordinate
        out = depth(np.repeat(angle, n, axis=0), np.eye(n))[1] @ angle_slopes[0]
        vector, slopes = self.scene.vector, self.directions
        places = gap_number_places(self.scene, contact)
        for j in np.flatnonzero(slopes.slope[:, places].any(axis=1)):
            h = slopes.parameters[j].step
            ends = [depth(angle, speed, vector + s * h * slopes.slope[j])[0][0] for s in (1.0, -1.0)]
            out[j] += (ends[0] - ends[1]) / (2.0 * h)
        return np.asarray(out)

    def _rate(self, quantity: Callable[[Action, Array, Array], Array], t: float, state: tuple[Array, Array]) -> float:
        """How fast a quantity changes at a time."""
        angle, speed = state
        h, acceleration = SHIFT_S, self.recorded.acceleration(t)
        ends = [quantity(self.action, angle + s * h * speed, speed + s * h * acceleration)[0] for s in (1.0, -1.0)]
        return float((ends[0] - ends[1]) / (2.0 * h))

    def _time_derivative(
        self, name: str, state: tuple[Array, Array], state_slopes: tuple[Array, Array], d_check: Array
    ) -> Array:
        """Derivative (P,) of an event's time, from those of angles and speeds there, ``state_slopes`` (1, n, P), and of
        the check height, ``d_check`` (P,)."""
        pressing = {"key_bottom_s": KEY_FRONT, "check_s": BACK_CHECK, RELEASE: BACK_CHECK}
        contact = (pressing | {"let_off_s": getattr(self, "_leaver", "")}).get(name)
        if contact:
            return -self._depth_derivative(contact, state, state_slopes[0]) / self._depth_of(contact, *state)[1][0]
        if name == "onset_s":
            # the dip is counted from rest, which moves too: a difference of two heights
            at, rest = state[0][0], self.recorded.rest
            d = gradient(lambda q: key_dip_m(self.action, q, rest), at, SMOOTH_TURN) @ state_slopes[0][0]
            d -= gradient(lambda q: key_dip_m(self.action, q, at), rest, SMOOTH_TURN) @ self.recorded.d_rest
            parameters = self.directions.parameters
            d += parameter_derivatives(self.action, parameters, lambda a: float(key_dip_m(a, state[0], rest)[0]))
            return np.asarray(-d / self._rate_along_motion(lambda q: key_dip_m(self.action, q, rest), state))
        d = self._total_derivative(self._height, state, state_slopes)
        if name == "drop_s":
            d = d - d_check
        return np.asarray(-d / self._rate_along_motion(lambda q: self._height(self.action, q, q), state))

    @staticmethod
    def _rate_along_motion(value: Callable[[Array], Array], state: tuple[Array, Array]) -> float:
        h = SHIFT_S
        return float((value(state[0] + h * state[1])[0] - value(state[0] - h * state[1])[0]) / (2.0 * h))


_READ_AT = {"let_off_m": "let_off_s", "strike_m_per_s": "strike_s", "rebound_m_per_s": "rebound_s"}
