"""Events of holding and letting go: check, key bottom, key release, rest.

Place in the data flow: `validation.motion` → here → `validation.events`.
Conventions: levels in m; every time is a sub-sample crossing whose uncertainty comes from moving the level by
its own.
Source: thesis Section 3.2.2 for the course of a stroke; the bands are this project's definitions
(`validation.event`).
Failure: an event that did not happen is ``absent``; one at the edge of its definition is ``ambiguous`` with a
note.
"""

from __future__ import annotations

import math

import numpy as np

from validation.crossings import bend_uncertainty_s, down_crossings, first_after, up_crossings, with_level_uncertainty
from validation.event import Event, Status, absent
from validation.motion import Motion

HOLD_S = 0.02
DOUBTFUL_HOLD_S = 0.01
HOLD_RANGE_M = 0.5e-3
CHECK_BAND_M = 0.25e-3
CHECK_LOWEST = 0.85
CHECK_HIGHEST_M = 1e-3
RELEASE_SHARE = 0.5
DIP_HYSTERESIS_M = 0.5e-3
REST_BAND_M = 0.1e-3
REST_STAYS_S = 0.05
DOUBTFUL_S = 0.01


def key_bottom(motion: Motion) -> Event:
    """First time the key dip rises through the dip at which the key front touches its felt."""

    def find(level: float) -> float | None:
        return first_after(up_crossings(motion.time_s, motion.key_dip_m, level, DIP_HYSTERESIS_M), -np.inf)

    value, u = with_level_uncertainty(find, motion.key_touch_dip_m, motion.level_u_dip_m())
    if value is None:
        deepest = 1e3 * float(np.nanmax(motion.key_dip_m))
        touch = 1e3 * motion.key_touch_dip_m
        return absent("key_bottom", f"deepest dip {deepest:.2f} mm, touch at {touch:.2f} mm")
    return _timed("key_bottom", value, u)


def check(motion: Motion, impact_s: float | None, until_s: float = np.inf) -> tuple[Event, Event]:
    """Time and height at which the hammer is caught after an impact and before a time.

    Parameters
    ----------
    motion : Motion
    impact_s : float or None
        No impact, no check.
    until_s : float
        A later impact ends the search.
    """
    if impact_s is None:
        return absent("check_time", "no string impact"), absent("check_height", "no string impact")
    window = _first_hold(motion, impact_s, until_s, HOLD_S)
    note = ""
    if window is None:
        window = _first_hold(motion, impact_s, until_s, DOUBTFUL_HOLD_S)
        if window is None:
            return absent("check_time", "hammer is never held"), absent("check_height", "hammer is never held")
        note = "held for less than 20 ms"
    first, last = window
    time, height = motion.time_s, motion.hammer_height_m
    centre = float(np.median(height[first:last]))
    outside = np.flatnonzero(np.abs(height - centre) > HOLD_RANGE_M)
    later = outside[outside >= last]
    stop = int(later[0]) if later.size else time.size
    held = height[first:stop][np.isfinite(height[first:stop])]
    level = float(np.median(held))
    u_height = float(np.hypot(motion.level_u_height_m(), np.std(held) / np.sqrt(len(held))))

    def entry(band: float) -> float | None:
        away = np.abs(height - level)
        inside_by = float(time[min(first + (last - first) // 2, time.size - 1)])
        falls = [t for t in down_crossings(time, away, band) if impact_s <= t <= inside_by]
        return falls[-1] if falls else None

    # the band is around the hammer's own held height, so the zero of the height does not enter
    value, u = with_level_uncertainty(entry, CHECK_BAND_M, motion.u_height_m)
    if value is not None:  # the back check brakes the hammer within a few samples
        u = float(np.hypot(u, bend_uncertainty_s(time, height, value)))
    status: Status = "ambiguous" if note else "found"
    when = absent("check_time", "no entry into the held band") if value is None else _timed("check_time", value, u)
    if note and value is not None:
        when = Event("check_time", value, u, "ambiguous", note)
    return when, Event("check_height", level, u_height, status, note)


def _first_hold(motion: Motion, after_s: float, until_s: float, length_s: float) -> tuple[int, int] | None:
    """First stretch of given length in which the hammer stays within 0.5 mm between string and rest."""
    time, height = motion.time_s, motion.hammer_height_m
    step = float(np.median(np.diff(time)))
    n = int(round(length_s / step)) + 1
    begin, end = int(np.searchsorted(time, after_s)), int(np.searchsorted(time, until_s))
    if end - begin < n:
        return None
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    part = np.where(np.isfinite(height[begin:end]), height[begin:end], np.inf)
    origin = -(n // 2)  # windows that begin at the sample
    top = maximum_filter1d(part, n, mode="constant", cval=np.inf, origin=origin)
    low = minimum_filter1d(part, n, mode="constant", cval=-np.inf, origin=origin)
    with np.errstate(invalid="ignore"):  # a window of lost samples only
        narrow = top - low < HOLD_RANGE_M
    held = narrow & (low > CHECK_HIGHEST_M) & (top < CHECK_LOWEST * motion.rest_height_m)
    hits = np.flatnonzero(held[: part.size - n + 1])
    return (begin + int(hits[0]), begin + int(hits[0]) + n) if hits.size else None


def key_release(motion: Motion) -> Event:
    """Last fall of the key dip through half the touching dip, when the key stays up to the end of the record."""
    time, dip = motion.time_s, motion.key_dip_m

    def find(level: float) -> float | None:
        falls = down_crossings(time, dip, level)
        rises = up_crossings(time, dip, level)
        return falls[-1] if falls and (not rises or rises[-1] < falls[-1]) else None

    value, u = with_level_uncertainty(find, RELEASE_SHARE * motion.key_touch_dip_m, motion.level_u_dip_m())
    if value is None:
        return absent("key_release", "key never went half down, or is still down at the end of the record")
    return _timed("key_release", value, u)


def rest(motion: Motion, quiet_stop: int) -> Event:
    """Time from which height and dip stay within 0.1 mm of their mean over the first `quiet_stop` samples."""
    time = motion.time_s
    height = np.abs(motion.hammer_height_m - float(np.mean(motion.hammer_height_m[:quiet_stop])))
    dip = np.abs(motion.key_dip_m - float(np.mean(motion.key_dip_m[:quiet_stop])))
    away = np.fmax(height, dip)

    def find(band: float) -> float | None:
        out = np.flatnonzero(away > band)
        if out.size == 0 or out[-1] + 1 >= time.size:
            return None
        i = int(out[-1])
        share = (away[i] - band) / (away[i] - away[i + 1])
        when = float(time[i] + share * (time[i + 1] - time[i]))
        return when if time[-1] - when >= REST_STAYS_S else None

    value, u = with_level_uncertainty(find, REST_BAND_M, max(motion.u_height_m, motion.u_dip_m))
    if value is None:
        left = 1e3 * float(away[np.isfinite(away)][-1])
        return absent("rest", f"not at rest for the last 50 ms of the record; {left:.2f} mm away at its end")
    return _timed("rest", value, u)


def _timed(name: str, value: float, u: float) -> Event:
    """A time event; one that jumps by more than 10 ms within its level's uncertainty is ambiguous."""
    if math.isnan(u):
        return Event(name, value, u, "ambiguous", "grazes its level: not found within the uncertainty of the level")
    if u > DOUBTFUL_S:
        return Event(name, value, u, "ambiguous", f"moves by {1e3 * u:.0f} ms within the uncertainty of its level")
    return Event(name, value, u, "found")
