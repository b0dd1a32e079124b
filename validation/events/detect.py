"""All events of one keystroke, by the definitions of `validation.events.definitions.EVENTS`; the door is `find_events`.

Conventions: time in s, levels and heights in m, 0 at the string and positive below it; speeds of the head normal to the
string, positive towards it before contact and away from it after. Levels are measured from the stroke's own rest or
held height where that is possible, so that the zero of the bench does not enter. An event at the edge of its definition
is ``ambiguous`` with a note. Source: thesis Section 3.2.2 for the phases of a stroke; levels and bands are this
project's definitions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from validation.conventions import Array
from validation.events.contact import Strike, find_strikes
from validation.events.crossings import (
    LevelReading,
    bend_uncertainty_s,
    down_crossings,
    find_last_fall,
    read_level,
    read_level_with_uncertainty,
    select_first_after,
    up_crossings,
)
from validation.events.definitions import Event, Status
from validation.events.flight import DECELERATION_M_PER_S2, NEAR_MISS_M, WINDOW_S, Flight, fit_parabola
from validation.measurement.geometry import Motion


def make_absent_event(name: str, note: str = "") -> Event:
    return Event(name, float("nan"), float("nan"), "absent", note)


def make_crossing_event(name: str, value: float, u: float) -> Event:
    """A time at which a level is crossed; ambiguous when it is not crossed at all levels within the uncertainty."""
    if math.isnan(u):
        return Event(name, value, u, "ambiguous", "grazes its level: not found within the uncertainty of the level")
    return Event(name, value, u, "found")


MOVED_M = 0.1e-3  # some 20 counts: above rounding and the slow recovery of felt, below any motion one can see
BOUNCE_M = 0.3e-3  # choice: the smallest turn round that is called a bounce
# Head and shank creep and swing by some tenths of a millimetre in the felt of the check, a key on its front felt.
FELT_M = 0.5e-3
# A hammer that turns round in flight stays within `FELT_M` for up to 2·√(2·0.5 mm/9 m/s²) ≈ 20 ms about the top of its
# path: only what lasts longer is held. Half of that may be a check of short notes, and is reported as such. A time that
# moves by as much within the uncertainty of its level says nothing about its order.
LEAST_HOLD_S = 0.02
DOUBTFUL_S = LEAST_HOLD_S / 2
# Of the rest height: a hammer lower than this has fallen through the check onto the repetition lever or the rest rail.
CHECK_LOWEST_SHARE = 0.85
# A head this close to the string is not held but blocks it; the let-off distance of a regulated action is larger.
CHECK_HIGHEST_M = 1e-3
# Half way up the key moves fastest, so that the time hardly depends on the level.
RELEASE_SHARE = 0.5
LONG_S = 0.05  # a free flight ends before, a hammer that bounces on its rest passes through its band in less
SWINGS_BY = 2.0  # times a vibration before the impact: a level it does not reach on the side of the jack either
TURN_S = 0.6e-3  # to either side of a landing: choice, felt turns the hammer round in some milliseconds


def key_bottom(motion: Motion, read: LevelReading = read_level_with_uncertainty) -> Event:
    """Event: time, s, at which the key dip first rises through the dip at which the key front touches its felt; absent,
    with the reason, where it never does. ``read``: how a level is read, with or without its uncertainty."""

    def find(level: float) -> float | None:
        return select_first_after(up_crossings(motion.time_s, motion.key_dip_m, level, FELT_M), -np.inf)

    value, u = read(find, motion.key_touch_dip_m, motion.level_u_dip_m())
    if value is not None:
        u = math.hypot(u, bend_uncertainty_s(motion.time_s, np.nan_to_num(motion.key_dip_m), value))
    else:
        deepest = 1e3 * float(np.nanmax(motion.key_dip_m))
        touch = 1e3 * motion.key_touch_dip_m
        return make_absent_event("key_bottom", f"deepest dip {deepest:.2f} mm, touch at {touch:.2f} mm")
    return _make_time_event("key_bottom", value, u)


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


def find_hold(
    motion: Motion, after_s: float, until_s: float = np.inf, read: LevelReading = read_level_with_uncertainty
) -> Hold | None:
    """First stretch of 20 ms or more (else of 10 ms or more, noted as doubtful) between ``after_s`` and ``until_s``, s,
    in which the hammer stays within 0.5 mm clear of string and rest; None when there is none. ``read_level`` as
    ``read`` saves time.

    The height of a hammer that creeps while it is held depends on where noise lets the hold begin and end: the hold is
    found again in ranges narrower and wider by three standard uncertainties of a sample, and the change of the height
    is part of its uncertainty.
    """
    margin = 3 * motion.u_height_m
    ranges = (FELT_M,) if read is read_level else (FELT_M, FELT_M - margin, FELT_M + margin)
    for length, note in ((LEAST_HOLD_S, ""), (DOUBTFUL_S, "held for less than 20 ms")):
        found, *others = _find_held(motion, after_s, until_s, length, ranges)
        if found is None:
            continue
        level, first, last, by_sample = found
        moved = max([by_sample, *(abs(other[0] - level) for other in others if other is not None)])
        if None in others or moved > FELT_M / 2:
            note = note or "within the uncertainty of a sample the hammer is held elsewhere, or not"
        return Hold(after_s, level, math.hypot(motion.u_height_still_m, moved), first, last, note)
    return None


def _find_held(
    motion: Motion, after_s: float, until_s: float, length_s: float, ranges_m: tuple[float, ...]
) -> list[tuple[float, int, int, float] | None]:
    """For each range (m) of height, the first hold of at least ``length_s`` between ``after_s`` and ``until_s``, s:
    median height (m), first sample, end of its first ``length_s`` as a sample, change of the height (m) if begun a
    sample later; or None."""
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


def check(
    motion: Motion, hold: Hold | None, *, struck: bool = True, read: LevelReading = read_level_with_uncertainty
) -> tuple[Event, Event]:
    """Two events of the back check: time, s, at which the hammer enters 0.25 mm around its held height, and that
    height, m below the string; both absent, with the reason (``struck``: whether it struck), where ``hold`` is None."""
    if hold is None:
        why = "hammer is never held" if struck else "no string impact"
        return make_absent_event("check_time", why), make_absent_event("check_height", why)
    time, height = motion.time_s, motion.hammer_height_m

    def entry(band: float) -> float | None:
        away = np.abs(height - hold.height_m)
        inside_by = float(time[min((hold.first + hold.last) // 2, time.size - 1)])
        falls = [t for t in down_crossings(time, away, band) if hold.after_s <= t <= inside_by]
        return falls[-1] if falls else None

    # the band is around the hammer's own held height, so the zero of the height does not enter
    value, u = read(entry, FELT_M / 2, math.hypot(motion.u_height_m, hold.u_own_m))
    if value is not None:  # the back check brakes the hammer within a few samples
        u = float(np.hypot(u, bend_uncertainty_s(time, height, value)))
    status: Status = "ambiguous" if hold.note else "found"
    when = (
        make_absent_event("check_time", "no entry into the held band")
        if value is None
        else _make_time_event("check_time", value, u)
    )
    if hold.note and value is not None:
        when = Event("check_time", value, u, "ambiguous", hold.note)
    u_height = math.hypot(motion.u_height_zero_m, hold.u_own_m)
    return when, Event("check_height", hold.height_m, u_height, status, hold.note)


def key_release(motion: Motion, read: LevelReading = read_level_with_uncertainty) -> Event:
    """Event: time, s, of the last fall of the key dip through half of the dip at which the key touches its felt; absent
    where the key never went that far down or is down at the end of the record."""
    time, dip = motion.time_s, motion.key_dip_m

    def find(level: float) -> float | None:
        falls = down_crossings(time, dip, level)
        rises = up_crossings(time, dip, level)
        return falls[-1] if falls and (not rises or rises[-1] < falls[-1]) else None

    value, u = read(find, RELEASE_SHARE * motion.key_touch_dip_m, motion.level_u_dip_m())
    if value is None:
        return make_absent_event("key_release", "key never went half down, or is still down at the end of the record")
    return _make_time_event("key_release", value, u)


def rest(motion: Motion, quiet_stop: int, read: LevelReading = read_level_with_uncertainty) -> Event:
    """Event: time, s, from which hammer height and key dip stay within 0.1 mm of their means over the first
    ``quiet_stop`` samples, to the end of the record and for 50 ms at least; else absent."""
    time = motion.time_s
    height = np.abs(motion.hammer_height_m - float(np.mean(motion.hammer_height_m[:quiet_stop])))
    dip = np.abs(motion.key_dip_m - float(np.mean(motion.key_dip_m[:quiet_stop])))
    u_height, u_dip = motion.own_u_height_m(), motion.own_u_dip_m()
    # both in units of their own uncertainty, so that a band moved by one moves both as they may
    away = np.fmax((height - MOVED_M) / u_height, (dip - MOVED_M) / u_dip)

    def find(level: float) -> float | None:
        when = find_last_fall(time, away, level)
        return when if when is not None and time[-1] - when >= LONG_S else None

    value, u = read(find, 0.0, 1.0)
    if value is None:
        far = np.fmax(height, dip)
        left = 1e3 * float(far[np.isfinite(far)][-1])
        return make_absent_event("rest", f"not at rest for the last 50 ms of the record; {left:.2f} mm away at its end")
    return _make_time_event("rest", value, u)


def _make_time_event(name: str, value: float, u: float) -> Event:
    """A time event; one that jumps by more than 10 ms within its level's uncertainty is ambiguous."""
    if u > DOUBTFUL_S:
        return Event(name, value, u, "ambiguous", f"moves by {1e3 * u:.0f} ms within the uncertainty of its level")
    return make_crossing_event(name, value, u)


def onset(motion: Motion, quiet_stop: int, read: LevelReading = read_level_with_uncertainty) -> Event:
    """Event: time, s, at which the key dip first rises 0.1 mm above its mean over the first ``quiet_stop`` samples;
    absent where it never does."""
    dip = motion.key_dip_m - float(np.mean(motion.key_dip_m[:quiet_stop]))

    def find(level: float) -> float | None:
        return select_first_after(up_crossings(motion.time_s, dip, level), -np.inf)

    value, u = read(find, MOVED_M, motion.own_u_dip_m())
    if value is None:
        return make_absent_event("onset", f"key never dips by {1e3 * MOVED_M:g} mm")
    return _make_bent_crossing("onset", value, u, motion.time_s, dip)


def let_off(motion: Motion, strike: Strike | None, read: LevelReading = read_level_with_uncertainty) -> Event:
    """Event: last time, s, before the impact at which the hammer is 0.1 mm off the path of its free flight; absent
    without strike or flight, ambiguous where the hammer vibrates about that path by more than 0.1 mm."""
    if strike is None or not math.isfinite(strike.arrival.speed):
        return make_absent_event("let_off", "no string impact")
    contact = strike.arrival.contact_s
    age = contact - motion.time_s
    near = (age > 0) & (age < LONG_S)

    def lag_of_path(speed: float) -> Array:
        path = speed * age + DECELERATION_M_PER_S2 * age**2 / 2
        return np.where(near, motion.hammer_way_m - path, np.nan)

    # the deceleration of the path is part of the definition; the speed is not, and tilts it
    speed, u_speed = strike.arrival.speed, strike.arrival.u_speed
    behind = lag_of_path(speed)
    # a jack pushes the hammer from one side of its path; one that is off on the other side vibrates about it, unless it
    # is as near as a string that is lower than the geometry says
    in_flight = (age < DOUBTFUL_S) & (speed * age > NEAR_MISS_M)
    swing = float(np.nanmax(np.where(in_flight, behind, np.nan), initial=0.0))
    vibrates = swing > MOVED_M
    level = MOVED_M + (SWINGS_BY * swing if vibrates else 0.0)
    value, u = read(lambda level: find_last_fall(motion.time_s, -behind, level), level, motion.u_height_m)
    if value is None:
        return make_absent_event("let_off", "hammer is in free flight for longer than 50 ms, or never")
    _, u_tilt = read(lambda v: find_last_fall(motion.time_s, -lag_of_path(v), level), speed, u_speed)
    event = _make_bent_crossing("let_off", value, math.hypot(u, u_tilt), motion.time_s, behind)
    if not vibrates:
        return event
    note = f"the hammer vibrates by {1e3 * swing:.2f} mm about the path of its flight"
    return Event("let_off", event.value, event.u, "ambiguous", note)


def count_bounces(motion: Motion, strike: Strike | None, caught: Event) -> Event:
    """Event whose value is the number of times the hammer turns round by 0.3 mm or more between the impact and the
    begin of the check, ``caught``; absent without either, ambiguous where the noise of a sample changes the number."""
    if strike is None:
        return make_absent_event("check_bounces", "no string impact")
    if not math.isfinite(caught.value):
        return make_absent_event("check_bounces", "hammer is never held")
    part = (motion.time_s > strike.time_s + WINDOW_S) & (motion.time_s < caught.value)
    height, margin = motion.hammer_height_m[part], 3 * motion.u_height_m
    count, fewest, most = (_count_turns(height, BOUNCE_M + by) for by in (0.0, margin, -margin))
    note = caught.note if caught.status == "ambiguous" else ""
    if fewest != most:
        note = f"{min(fewest, most)} to {max(fewest, most)} within the uncertainty of a sample"
    return Event("check_bounces", float(count), 0.0, "ambiguous" if note else "found", note)


def _count_turns(height: Array, least: float) -> int:
    """Number of turns, from rising to falling or back, of a curve (n,), m, each followed by a change of ``least``, m,
    or more; NaN are skipped."""
    count, direction = 0, 0
    low = high = None
    for h in height[np.isfinite(height)]:
        low, high = (h, h) if low is None or high is None else (min(low, h), max(high, h))
        if direction >= 0 and high - h >= least:
            count, direction, low, high = count + (direction > 0), -1, h, h
        elif direction <= 0 and h - low >= least:
            count, direction, low, high = count + (direction < 0), 1, h, h
    return count


def drop(
    motion: Motion,
    hold: Hold | None,
    check_s: float,
    release_s: float,
    read: LevelReading = read_level_with_uncertainty,
) -> Event:
    """Event: first time, s, after the check at ``check_s`` at which the hammer is 0.5 mm further from the string than
    it was held; absent where it is not, ambiguous where that is more than 50 ms before the key's release at
    ``release_s``, s."""
    if hold is None or not math.isfinite(check_s):
        return make_absent_event("drop", "hammer is never held")
    height = motion.hammer_height_m

    def find(level: float) -> float | None:
        return select_first_after(up_crossings(motion.time_s, height, level), check_s)

    value, u = read(find, hold.height_m + FELT_M, math.hypot(motion.u_height_m, hold.u_own_m))
    if value is None:
        return make_absent_event("drop", "hammer stays where it was held")
    note = hold.note
    if math.isfinite(release_s) and value < release_s - LONG_S:
        note = "long before the key was let go"
    event = _make_bent_crossing("drop", value, u, motion.time_s, height)
    return event if not note else Event("drop", value, event.u, "ambiguous", note)


def landing(motion: Motion, hold: Hold | None, drop_s: float) -> Event:
    """Event: time, s, at which, after the drop at ``drop_s``, s, the hammer is furthest from the string before it first
    comes back by 0.3 mm; absent without a drop or such a bounce."""
    if hold is None or not math.isfinite(drop_s):
        return make_absent_event("landing", "no drop")
    time, height = motion.time_s, motion.hammer_height_m
    begin = int(np.searchsorted(time, drop_s))
    highest = np.fmax.accumulate(height[begin:])
    back = np.flatnonzero(highest - height[begin:] > BOUNCE_M)
    if back.size == 0:
        return make_absent_event("landing", "hammer does not bounce by 0.3 mm when it lands")
    turn = begin + int(np.nanargmax(height[begin : begin + int(back[0]) + 1]))
    reach = max(round(TURN_S / float(time[1] - time[0])), 3)
    near = height[max(turn - reach, 0) : turn + reach + 1]
    if near.size < 2 * reach + 1 or not np.isfinite(near).all():
        return Event("landing", float(time[turn]), float(time[1] - time[0]), "ambiguous", "lost samples near it")
    wide, u = _fit_vertex(time, height, turn, reach, motion.u_height_m)
    narrow, u_narrow = _fit_vertex(time, height, turn, 2 * reach // 3, motion.u_height_m)
    if math.isnan(wide) or math.isnan(narrow):
        return Event("landing", float(time[turn]), float(time[1] - time[0]), "ambiguous", "no clear turning point")
    # felt is no parabola: the change of the vertex with the width of the fit is part of its uncertainty
    u = math.hypot(max(u, u_narrow), wide - narrow)
    return Event("landing", narrow, u, "ambiguous" if hold.note else "found", hold.note)


def _fit_vertex(time: Array, height: Array, turn_index: int, half_width: int, u_height_m: float) -> tuple[float, float]:
    """Time (s) of the largest value of a parabola fitted to the heights (n,), m, within ``half_width`` samples of the
    sample ``turn_index``, and its standard uncertainty (s), both NaN where the parabola has no maximum; ``u_height_m``:
    least noise."""
    part = slice(turn_index - half_width, turn_index + half_width + 1)
    t = time[part] - time[turn_index]
    (level, slope, bend), covariance = fit_parabola(t, height[part], 1.0)
    if bend >= 0:
        return float("nan"), float("nan")
    residual = height[part] - level - slope * t - 0.5 * bend * t**2
    noise = max(u_height_m, float(np.sqrt(residual @ residual / (t.size - 3))))
    return float(time[turn_index] - slope / bend), noise * math.sqrt(covariance[1, 1]) / abs(bend)


def _make_bent_crossing(name: str, value: float, u: float, time: Array, signal: Array) -> Event:
    return make_crossing_event(name, value, math.hypot(u, bend_uncertainty_s(time, np.nan_to_num(signal), value)))


def find_events(motion: Motion, quiet_stop: int, read: LevelReading = read_level_with_uncertainty) -> dict[str, Event]:
    """Find all events of one keystroke: name → event, in the order of `EVENTS`, one that did not happen as an absent
    event; ``quiet_stop``: number of samples at rest before the blow, ``read``: how the time at a level and its
    uncertainty are found.

    Parameters
    ----------
    motion : Motion
        Measured or predicted.
    quiet_stop : int
        Number of samples before the blow during which the action is at rest.
    read : callable
        How a time at a level is read; `read_level` gives the same values in half the time.

    Returns
    -------
    dict
        Event name → Event, in the order of `EVENTS`.

    Examples
    --------
    >>> import numpy as np
    >>> import model, validation
    >>> from validation.measurement.geometry import geometry_of
    >>> from validation.measurement.geometry import motion_of
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
    hold = find_hold(motion, first.time_s, second.time_s if second else float("inf"), read) if first else None
    check_time, check_height = check(motion, hold, struck=first is not None, read=read)
    release = key_release(motion, read)
    falls = drop(motion, hold, check_time.value, release.value, read)
    found = [
        onset(motion, quiet_stop, read),
        let_off(motion, first, read),
        key_bottom(motion, read),
        _make_impact_event("string_impact", first, "hammer never reaches the string"),
        _make_speed_event("hammer_speed", motion, first, first.arrival if first else None),
        _make_speed_event("rebound_speed", motion, first, first.rebound if first else None),
        check_time,
        check_height,
        count_bounces(motion, first, check_time),
        release,
        falls,
        landing(motion, hold, falls.value),
        _make_impact_event("second_strike", second, "one string impact only" if first else "no string impact"),
        rest(motion, quiet_stop, read),
    ]
    return {event.name: event for event in found}


def _make_impact_event(name: str, strike: Strike | None, why_absent: str) -> Event:
    if strike is None:
        return make_absent_event(name, why_absent)
    return Event(name, strike.time_s, strike.u_time_s, strike.status, strike.note if strike.status != "found" else "")


def _make_speed_event(name: str, motion: Motion, strike: Strike | None, flight: Flight | None) -> Event:
    """Event ``name`` with the speed at contact of ``flight``, m/s, positive, and its uncertainty with that of scale and
    string height; absent, with the reason, without strike or speed, ambiguous where the strike is."""
    if strike is None or flight is None:
        return make_absent_event(name, "no string impact")
    if math.isnan(flight.speed):
        return make_absent_event(name, flight.note)
    elsewhere = flight.slowing * motion.u_height_zero_m / flight.speed  # a string that stands higher is met later
    u = math.hypot(flight.u_speed, motion.u_speed_relative * flight.speed, elsewhere)
    return Event(name, flight.speed, u, strike.status, flight.note)
