"""All events of one keystroke, by the definitions of `validation.events.definitions.EVENTS`."""

from __future__ import annotations

import math

from validation.events.check_and_rest import check, find_hold, key_bottom, key_release, rest
from validation.events.definitions import Event, absent
from validation.events.free_flight import Flight
from validation.events.onset_letoff_drop import bounces, drop, landing, let_off, onset
from validation.events.string_impact import Strike, find_strikes
from validation.measurement.stroke import Motion


def find_events(motion: Motion, quiet_stop: int) -> dict[str, Event]:
    """Find every event of `validation.events.definitions.EVENTS` in one keystroke.

    Parameters
    ----------
    motion : Motion
        Measured or predicted.
    quiet_stop : int
        Number of samples before the blow during which the action is at rest.

    Returns
    -------
    dict
        Event name → Event, in the order of `EVENTS`.

    Examples
    --------
    >>> import numpy as np
    >>> import model, validation
    >>> from validation.measurement.geometry import geometry_of
    >>> from validation.measurement.stroke import motion_of
    >>> action = model.load_action("hirschkorn2004")
    >>> blow = model.simulate(action, *model.force_table("forte"))
    >>> change_rad = (blow.angle_rad - blow.angle_rad[0])[:, [0, 1, 4]]
    >>> motion = motion_of(geometry_of(action, blow.angle_rad[0]), blow.time_s, change_rad, np.full(3, 1e-5))
    >>> found = validation.find_events(motion, quiet_stop=200)
    >>> print(f"{found['string_impact'].value:.3f} s")
    0.111 s
    """
    strikes = find_strikes(motion)
    first = strikes[0] if strikes else None
    second = strikes[1] if len(strikes) > 1 else None
    hold = find_hold(motion, first.time_s, second.time_s if second else float("inf")) if first else None
    check_time, check_height = check(motion, hold, struck=first is not None)
    release = key_release(motion)
    falls = drop(motion, hold, check_time.value, release.value)
    found = [
        onset(motion, quiet_stop),
        let_off(motion, first),
        key_bottom(motion),
        _impact("string_impact", first, "hammer never reaches the string"),
        _speed("hammer_speed", motion, first, first.arrival if first else None),
        _speed("rebound_speed", motion, first, first.rebound if first else None),
        check_time,
        check_height,
        bounces(motion, first, check_time),
        release,
        falls,
        landing(motion, hold, falls.value),
        _impact("second_strike", second, "one string impact only" if first else "no string impact"),
        rest(motion, quiet_stop),
    ]
    return {event.name: event for event in found}


def _impact(name: str, strike: Strike | None, why_absent: str) -> Event:
    if strike is None:
        return absent(name, why_absent)
    return Event(name, strike.time_s, strike.u_time_s, strike.status, strike.note if strike.status != "found" else "")


def _speed(name: str, motion: Motion, strike: Strike | None, speed: Flight | None) -> Event:
    if strike is None or speed is None:
        return absent(name, "no string impact")
    if math.isnan(speed.speed):
        return absent(name, speed.note)
    elsewhere = speed.slowing * motion.u_height_zero_m / speed.speed  # a string that stands higher is met later
    u = math.hypot(speed.u_speed, motion.u_speed_relative * speed.speed, elsewhere)
    return Event(name, speed.speed, u, strike.status, speed.note)
