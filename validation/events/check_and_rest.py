"""Key bottom, check, key release and rest.

Conventions: levels in m; every time is a sub-sample crossing whose uncertainty comes from moving the level by
its own. An event at the edge of its definition is ``ambiguous`` with a note.
Source: thesis Section 3.2.2 for the phases of a stroke; the bands are this project's definitions
(`validation.events.definitions`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from validation.events.definitions import Event, Status, absent, crossing
from validation.events.level_crossings import (
    bend_uncertainty_s,
    down_crossings,
    first_after,
    last_fall,
    up_crossings,
    with_level_uncertainty,
)
from validation.measurement.stroke import Motion

# A hammer that turns round in flight stays within half a millimetre for up to 2·√(2·0.5 mm/9 m/s²) ≈ 20 ms about the
# top of its path: only what lasts longer is held. Half of that may be a check of short notes, and is reported as such.
LEAST_HOLD_S = 0.02
DOUBTFUL_HOLD_S = 0.01
# Head and shank creep and swing by some tenths of a millimetre in the felt of the check.
HOLD_RANGE_M = 0.5e-3
# Half of that range: the hammer enters the check when it comes this close to the height it is then held at.
CHECK_BAND_M = 0.25e-3
# Of the rest height: a hammer lower than this has fallen through the check onto the repetition lever or the rest rail.
CHECK_LOWEST_SHARE = 0.85
# A head this close to the string is not held but blocks it; the let-off distance of a regulated action is larger.
CHECK_HIGHEST_M = 1e-3
# Half way up the key moves fastest, so that the time hardly depends on the level.
RELEASE_SHARE = 0.5
# The key bounces on its front felt by a few tenths of a millimetre: one touch, not several.
DIP_HYSTERESIS_M = 0.5e-3
# Some 20 counts of the encoders: above their rounding and the slow recovery of the felt, below any motion one can see.
REST_BAND_M = 0.1e-3
# Longer than a hammer that bounces on its rest takes to pass through the band.
REST_LASTS_S = 0.05
# A time that moves by more than the shortest hold within the uncertainty of its level says nothing about its order.
DOUBTFUL_TIME_S = 0.01


def key_bottom(motion: Motion) -> Event:
    """First time the key dip rises through the dip at which the key front touches its felt."""

    def find(level: float) -> float | None:
        return first_after(up_crossings(motion.time_s, motion.key_dip_m, level, DIP_HYSTERESIS_M), -np.inf)

    value, u = with_level_uncertainty(find, motion.key_touch_dip_m, motion.level_u_dip_m())
    if value is not None:
        u = math.hypot(u, bend_uncertainty_s(motion.time_s, np.nan_to_num(motion.key_dip_m), value))
    else:
        deepest = 1e3 * float(np.nanmax(motion.key_dip_m))
        touch = 1e3 * motion.key_touch_dip_m
        return absent("key_bottom", f"deepest dip {deepest:.2f} mm, touch at {touch:.2f} mm")
    return _timed("key_bottom", value, u)


@dataclass(frozen=True)
class Hold:
    """Height at which the hammer is held after ``after_s``, and the first samples that show it.

    ``u_own_m`` is the height's standard uncertainty against other heights of the same record; a hold that is doubtful
    says why in its ``note``.
    """

    after_s: float
    height_m: float
    u_own_m: float
    first: int
    last: int
    note: str


def find_hold(motion: Motion, after_s: float, until_s: float = np.inf) -> Hold | None:
    """First stretch after an impact and before a time in which the hammer is held; None when there is none.

    The height of a hammer that creeps while it is held depends on where noise lets the hold begin and end: the hold is
    found again in ranges narrower and wider by three standard uncertainties of a sample, and the change of the height
    is part of its uncertainty.
    """
    margin = 3 * motion.u_height_m
    ranges = (HOLD_RANGE_M, HOLD_RANGE_M - margin, HOLD_RANGE_M + margin)
    for length, note in ((LEAST_HOLD_S, ""), (DOUBTFUL_HOLD_S, "held for less than 20 ms")):
        found, *others = _held(motion, after_s, until_s, length, ranges)
        if found is None:
            continue
        level, first, last, by_sample = found
        moved = max([by_sample, *(abs(other[0] - level) for other in others if other is not None)])
        if None in others or moved > CHECK_BAND_M:
            note = note or "within the uncertainty of a sample the hammer is held elsewhere, or not"
        return Hold(after_s, level, math.hypot(motion.u_height_still_m, moved), first, last, note)
    return None


def _held(
    motion: Motion, after_s: float, until_s: float, length_s: float, ranges_m: tuple[float, ...]
) -> list[tuple[float, int, int, float] | None]:
    """First stretch of given length in which the hammer stays within each range between string and rest.

    Median height over the whole hold, the stretch, and the change of the height when the hold begins a sample later.
    """
    time, height = motion.time_s, motion.hammer_height_m
    step = float(np.median(np.diff(time)))
    n = int(round(length_s / step)) + 1
    begin, end = int(np.searchsorted(time, after_s)), int(np.searchsorted(time, until_s))
    if end - begin < n:
        return [None] * len(ranges_m)
    part = np.where(np.isfinite(height[begin:end]), height[begin:end], np.inf)
    origin = -(n // 2)  # windows that begin at the sample
    top = maximum_filter1d(part, n, mode="constant", cval=np.inf, origin=origin)
    low = minimum_filter1d(part, n, mode="constant", cval=-np.inf, origin=origin)
    between = (low > CHECK_HIGHEST_M) & (top < CHECK_LOWEST_SHARE * motion.rest_height_m)
    with np.errstate(invalid="ignore"):  # a window of lost samples only
        extent = np.where(between, top - low, np.inf)[: part.size - n + 1]
    found: list[tuple[float, int, int, float] | None] = []
    for range_m in ranges_m:
        hits = np.flatnonzero(extent < range_m)
        if hits.size == 0:
            found.append(None)
            continue
        first, last = begin + int(hits[0]), begin + int(hits[0]) + n
        later = np.flatnonzero(np.abs(height[last:] - float(np.median(height[first:last]))) > range_m)
        held = height[first : last + int(later[0]) if later.size else height.size]
        level = float(np.nanmedian(held))
        found.append((level, first, last, abs(float(np.nanmedian(held[1:])) - level)))
    return found


def check(motion: Motion, hold: Hold | None, *, struck: bool = True) -> tuple[Event, Event]:
    """Time and height at which the hammer is caught.

    Parameters
    ----------
    motion : Motion
    hold : Hold or None
        None when the hammer is never held.
    struck : bool
        Without an impact there is no check.
    """
    if hold is None:
        why = "hammer is never held" if struck else "no string impact"
        return absent("check_time", why), absent("check_height", why)
    time, height = motion.time_s, motion.hammer_height_m

    def entry(band: float) -> float | None:
        away = np.abs(height - hold.height_m)
        inside_by = float(time[min((hold.first + hold.last) // 2, time.size - 1)])
        falls = [t for t in down_crossings(time, away, band) if hold.after_s <= t <= inside_by]
        return falls[-1] if falls else None

    # the band is around the hammer's own held height, so the zero of the height does not enter
    value, u = with_level_uncertainty(entry, CHECK_BAND_M, math.hypot(motion.u_height_m, hold.u_own_m))
    if value is not None:  # the back check brakes the hammer within a few samples
        u = float(np.hypot(u, bend_uncertainty_s(time, height, value)))
    status: Status = "ambiguous" if hold.note else "found"
    when = absent("check_time", "no entry into the held band") if value is None else _timed("check_time", value, u)
    if hold.note and value is not None:
        when = Event("check_time", value, u, "ambiguous", hold.note)
    u_height = math.hypot(motion.u_height_zero_m, hold.u_own_m)
    return when, Event("check_height", hold.height_m, u_height, status, hold.note)


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
    u_height, u_dip = motion.own_u_height_m(), motion.own_u_dip_m()
    # both in units of their own uncertainty, so that a band moved by one moves both as they may
    away = np.fmax((height - REST_BAND_M) / u_height, (dip - REST_BAND_M) / u_dip)

    def find(level: float) -> float | None:
        when = last_fall(time, away, level)
        return when if when is not None and time[-1] - when >= REST_LASTS_S else None

    value, u = with_level_uncertainty(find, 0.0, 1.0)
    if value is None:
        far = np.fmax(height, dip)
        left = 1e3 * float(far[np.isfinite(far)][-1])
        return absent("rest", f"not at rest for the last 50 ms of the record; {left:.2f} mm away at its end")
    return _timed("rest", value, u)


def _timed(name: str, value: float, u: float) -> Event:
    """A time event; one that jumps by more than 10 ms within its level's uncertainty is ambiguous."""
    if u > DOUBTFUL_TIME_S:
        return Event(name, value, u, "ambiguous", f"moves by {1e3 * u:.0f} ms within the uncertainty of its level")
    return crossing(name, value, u)
