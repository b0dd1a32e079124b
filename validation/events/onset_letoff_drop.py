"""Onset, let-off, bounces before the check, drop and landing.

Conventions: levels in m, measured from the stroke's own rest or held height, so that the zero of the bench does not
enter; every time is a sub-sample crossing whose uncertainty comes from moving the level by its own.
Source: thesis Section 3.2.2 for the phases of a stroke; the levels are this project's definitions
(`validation.events.definitions`).
"""

from __future__ import annotations

import math

import numpy as np

from validation.conventions import Array
from validation.events.check_and_rest import Hold
from validation.events.definitions import Event, absent, crossing
from validation.events.free_flight import DECELERATION_M_PER_S2
from validation.events.level_crossings import (
    bend_uncertainty_s,
    first_after,
    last_fall,
    up_crossings,
    with_level_uncertainty,
)
from validation.events.string_impact import Strike
from validation.measurement.stroke import Motion

ONSET_M = 0.1e-3
OFF_PATH_M = 0.1e-3
LONGEST_FLIGHT_S = 0.05
DROP_M = 0.5e-3
BOUNCE_M = 0.3e-3
LANDED_M = 0.3e-3
TURN_S = 0.6e-3


def onset(motion: Motion, quiet_stop: int) -> Event:
    """Key dip first rises through 0.1 mm above its rest."""
    dip = motion.key_dip_m - float(np.mean(motion.key_dip_m[:quiet_stop]))

    def find(level: float) -> float | None:
        return first_after(up_crossings(motion.time_s, dip, level), -np.inf)

    value, u = with_level_uncertainty(find, ONSET_M, motion.own_u_dip_m())
    if value is None:
        return absent("onset", f"key never dips by {1e3 * ONSET_M:g} mm")
    return _at("onset", value, u, motion.time_s, dip)


def let_off(motion: Motion, strike: Strike | None) -> Event:
    """Last time before the impact at which the hammer is 0.1 mm off the path of its free flight."""
    if strike is None or not math.isfinite(strike.arrival.speed):
        return absent("let_off", "no string impact")
    contact = strike.arrival.contact_s
    age = contact - motion.time_s
    near = (age > 0) & (age < LONGEST_FLIGHT_S)

    def off_path(speed: float) -> Array:
        path = speed * age + DECELERATION_M_PER_S2 * age**2 / 2
        return np.where(near, np.abs(motion.hammer_way_m - path), np.nan)

    # the deceleration of the path is part of the definition; the speed is not, and tilts it
    speed, u_speed = strike.arrival.speed, strike.arrival.u_speed
    off = off_path(speed)
    value, u = with_level_uncertainty(lambda level: last_fall(motion.time_s, off, level), OFF_PATH_M, motion.u_height_m)
    if value is None:
        return absent("let_off", "hammer is in free flight for longer than 50 ms, or never")
    _, u_tilt = with_level_uncertainty(lambda v: last_fall(motion.time_s, off_path(v), OFF_PATH_M), speed, u_speed)
    return _at("let_off", value, math.hypot(u, u_tilt), motion.time_s, off)


def bounces(motion: Motion, strike: Strike | None, caught: Event) -> Event:
    """Number of times the hammer turns round by 0.3 mm or more between the impact and the check."""
    if strike is None:
        return absent("check_bounces", "no string impact")
    if not math.isfinite(caught.value):
        return absent("check_bounces", "hammer is never held")
    part = (motion.time_s > strike.time_s + 2e-3) & (motion.time_s < caught.value)
    height, margin = motion.hammer_height_m[part], 3 * motion.u_height_m
    count, fewest, most = (_turns(height, BOUNCE_M + by) for by in (0.0, margin, -margin))
    note = caught.note if caught.status == "ambiguous" else ""
    if fewest != most:
        note = f"{min(fewest, most)} to {max(fewest, most)} within the uncertainty of a sample"
    return Event("check_bounces", float(count), 0.0, "ambiguous" if note else "found", note)


def _turns(height: Array, least: float) -> int:
    """Reversals of a curve by at least so much."""
    count, direction = 0, 0
    low = high = None
    for h in height[np.isfinite(height)]:
        low, high = (h, h) if low is None or high is None else (min(low, h), max(high, h))
        if direction >= 0 and high - h >= least:
            count, direction, low, high = count + (direction > 0), -1, h, h
        elif direction <= 0 and h - low >= least:
            count, direction, low, high = count + (direction < 0), 1, h, h
    return count


def drop(motion: Motion, hold: Hold | None, check_s: float, release_s: float) -> Event:
    """Hammer first is 0.5 mm further from the string than the height it was held at, after the key was let go."""
    if hold is None or not math.isfinite(check_s):
        return absent("drop", "hammer is never held")
    height = motion.hammer_height_m

    def find(level: float) -> float | None:
        return first_after(up_crossings(motion.time_s, height, level), check_s)

    value, u = with_level_uncertainty(find, hold.height_m + DROP_M, math.hypot(motion.u_height_m, hold.u_own_m))
    if value is None:
        return absent("drop", "hammer stays where it was held")
    note = hold.note
    if math.isfinite(release_s) and value < release_s - 0.05:
        note = "long before the key was let go"
    event = _at("drop", value, u, motion.time_s, height)
    return event if not note else Event("drop", value, event.u, "ambiguous", note)


def landing(motion: Motion, hold: Hold | None, drop_s: float) -> Event:
    """After the drop the hammer first comes back by 0.3 mm: the time it was furthest from the string before that."""
    if hold is None or not math.isfinite(drop_s):
        return absent("landing", "no drop")
    time, height = motion.time_s, motion.hammer_height_m
    begin = int(np.searchsorted(time, drop_s))
    highest = np.fmax.accumulate(height[begin:])
    back = np.flatnonzero(highest - height[begin:] > LANDED_M)
    if back.size == 0:
        return absent("landing", "hammer does not bounce by 0.3 mm when it lands")
    turn = begin + int(np.nanargmax(height[begin : begin + int(back[0]) + 1]))
    reach = max(round(TURN_S / float(time[1] - time[0])), 3)
    near = height[max(turn - reach, 0) : turn + reach + 1]
    if near.size < 2 * reach + 1 or not np.isfinite(near).all():
        return Event("landing", float(time[turn]), float(time[1] - time[0]), "ambiguous", "lost samples near it")
    wide, u = _vertex(time, height, turn, reach, motion.u_height_m)
    narrow, u_narrow = _vertex(time, height, turn, 2 * reach // 3, motion.u_height_m)
    if math.isnan(wide) or math.isnan(narrow):
        return Event("landing", float(time[turn]), float(time[1] - time[0]), "ambiguous", "no clear turning point")
    # felt is no parabola: the change of the vertex with the width of the fit is part of its uncertainty
    u = math.hypot(max(u, u_narrow), wide - narrow)
    return Event("landing", narrow, u, "ambiguous" if hold.note else "found", hold.note)


def _vertex(time: Array, height: Array, turn: int, reach: int, sigma: float) -> tuple[float, float]:
    """Time of the vertex of a parabola through the samples about a turning point, and its standard uncertainty."""
    part = slice(turn - reach, turn + reach + 1)
    t = time[part] - time[turn]
    (a, b, c), covariance = np.polyfit(t, height[part], 2, cov="unscaled")
    if a >= 0:
        return float("nan"), float("nan")
    residual = height[part] - np.polyval((a, b, c), t)
    noise = max(sigma, float(np.sqrt(residual @ residual / (t.size - 3))))
    return float(time[turn] - b / (2 * a)), noise * float(np.sqrt(covariance[1, 1])) / abs(2 * a)


def _at(name: str, value: float, u: float, time: Array, signal: Array) -> Event:
    return crossing(name, value, math.hypot(u, bend_uncertainty_s(time, np.nan_to_num(signal), value)))
