"""Contacts of hammer and string in one keystroke."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.events.crossings import down_crossings, up_crossings
from validation.events.definitions import Status
from validation.events.flight import NEAR_MISS_M, WINDOW_S, Flight, fit_flight
from validation.measurement.geometry import Motion

REVERSAL_S = 6e-3  # longer than hammer and string touch: a hammer that turns round later met no string
AWAY_M = 5e-3  # before a contact counts: a rattle at the string is one contact
SHARP_M_PER_S = 0.3  # of both speeds together: gravity turns a hammer round by 0.04 within `WINDOW_S`
NO_FLIGHT = Flight(float("nan"), float("nan"), float("nan"), float("nan"), "hammer did not come back")


@dataclass(frozen=True)
class Strike:
    """One contact of hammer and string."""

    time_s: float
    u_time_s: float
    arrival: Flight
    rebound: Flight
    status: Status
    note: str = ""


def _fit_strike(motion: Motion, crossing_s: float) -> Strike:
    """Strike whose contact begins where the hammer height falls through 0 at ``crossing_s``, s, with flights fitted
    before and after it; ambiguous, without rebound, where the hammer does not come back within 6 ms."""
    time, height = motion.time_s, motion.hammer_height_m
    arrival = fit_flight(time, motion.hammer_way_m, crossing_s, -1, motion.u_height_m)
    known = np.isfinite(arrival.u_contact_s)
    contact_s = arrival.contact_s if known else crossing_s
    speed = arrival.speed if known else motion.u_height_m / WINDOW_S
    u_time = float(np.hypot(arrival.u_contact_s if known else 0.0, motion.u_height_zero_m / speed))
    leaves = [t for t in up_crossings(time, height, 0.0) if crossing_s <= t <= crossing_s + REVERSAL_S]
    if not leaves:
        note = "hammer crosses the string line without turning back within 6 ms"
        return Strike(contact_s, u_time, arrival, NO_FLIGHT, "ambiguous", note)
    rebound = fit_flight(time, motion.hammer_way_m, leaves[0], +1, motion.u_height_m)
    return Strike(contact_s, u_time, arrival, rebound, "found")


def _find_near_misses(motion: Motion, contact_times_s: list[float]) -> list[Strike]:
    """Ambiguous strikes: the hammer turns round sharply less than 2 mm below the string line without reaching it (a
    string lower than the geometry says), more than 12 ms away from each of the contacts at ``contact_times_s``, s."""
    time, height = motion.time_s, motion.hammer_height_m
    out = []
    step = float(np.median(np.diff(time)))
    reach = max(int(round(WINDOW_S / step)), 2)
    for first in down_crossings(time, height, NEAR_MISS_M, AWAY_M):
        if any(abs(first - t) < 2 * REVERSAL_S for t in contact_times_s):
            continue
        begin = int(np.searchsorted(time, first))
        near = height[begin : begin + 5 * reach]
        if near.size == 0 or not np.isfinite(near).any():
            continue
        turn = begin + int(np.nanargmin(near))
        if turn - reach < 0 or turn + reach >= time.size:
            continue
        speed_in = (height[turn - reach] - height[turn]) / (time[turn] - time[turn - reach])
        speed_out = (height[turn + reach] - height[turn]) / (time[turn + reach] - time[turn])
        if speed_in + speed_out < SHARP_M_PER_S:
            continue
        gap = 1e3 * height[turn]
        arrival = fit_flight(time, motion.hammer_way_m, float(time[turn] - WINDOW_S / 2), -1, motion.u_height_m)
        note = f"hammer turns back sharply {gap:.2f} mm below the string line; check rest and string height"
        out.append(Strike(float(time[turn]), WINDOW_S / 2, arrival, NO_FLIGHT, "ambiguous", note))
    return out


def find_strikes(motion: Motion) -> list[Strike]:
    """All contacts of hammer and string of a stroke in order of time: each fall of the hammer height through 0 after
    the hammer was 5 mm away, and sharp turns up to 2 mm below the string, which are ambiguous."""
    times = down_crossings(motion.time_s, motion.hammer_height_m, 0.0, AWAY_M)
    strikes = [_fit_strike(motion, t) for t in times]
    return sorted([*strikes, *_find_near_misses(motion, times)], key=lambda s: s.time_s)
