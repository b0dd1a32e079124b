"""All events of one keystroke, by the definitions of `validation.events.definitions.EVENTS`; the door is `find_events`.

Conventions: time in s, levels and heights in m, 0 at the string and positive below it; speeds of the head normal to the
string, positive towards it before contact and away from it after. Every time is a sub-sample crossing by straight lines
between two samples (without it a time would carry dt/√12), whose standard uncertainty comes from moving the level by
its own; NaN samples are never part of one. Levels are measured from the stroke's own rest or held height where that is
possible, so that the zero of the bench does not enter. An event at the edge of its definition is ``ambiguous`` with a
note. Source: thesis Section 3.2.2 for the phases of a stroke; levels and bands are this project's definitions.

*String impact.* The time of contact is where the incoming flight reaches the string, not a crossing interpolated
between a flying and an already braked sample. The way is the hammer's angle from the string times the head's lever
there, free of the circle's curvature; *age* is the time from the contact, positive on both sides, so that one fit
serves arrival and departure. Samples of the last 2 to 5 ms count, as far as they lie on the path of a free hammer: a
symmetric differentiator mixes both sides of a velocity that jumps within a millisecond. In free flight gravity and
joint friction slow the head by about 10.5 m/s², and it falls back with 9 (a mass at the end of a light lever: about g),
known beforehand to 1.5 m/s²: over 2 ms that is a straight line carried to contact, over longer flights the deceleration
is measured. A flight that is not undisturbed for 3 ms is fitted together with one vibration, or with a parabola while
still pushed. Fewer than four samples give a NaN speed with a note.

*A shank that vibrates* (thesis Section 4.1). The encoder sits at the butt, and in free flight a light butt swings
against a heavy head: the head stays on the rigid path within `HEAD_SHARE` of the vibration, which is stated as
uncertainty. The first bending mode of a shank lies at some hundreds of hertz, so that a 2 ms line holds only half a
period of it and its slope is wrong by up to the vibration's own speed. At least one whole period must lie in the
flight, so that a push is not taken for one; the deceleration of free flight and the damping enter as measurements with
their uncertainty, which keeps the fit determined. The two parameters that are not linear are found on a grid and
refined on ever smaller stencils.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from validation.conventions import Array
from validation.events.definitions import Event, Status
from validation.measurement.geometry import Motion


def make_absent_event(name: str, note: str = "") -> Event:
    return Event(name, float("nan"), float("nan"), "absent", note)


def make_crossing_event(name: str, value: float, u: float) -> Event:
    """A time at which a level is crossed; ambiguous when it is not crossed at all levels within the uncertainty."""
    if math.isnan(u):
        return Event(name, value, u, "ambiguous", "grazes its level: not found within the uncertainty of the level")
    return Event(name, value, u, "found")


def up_crossings(time_s: Array, signal: Array, level: float, hysteresis: float = 0.0) -> list[float]:
    """Times at which a signal rises through a level, s.

    Parameters
    ----------
    time_s, signal : (n,)
    hysteresis : after a crossing the signal must fall below ``level - hysteresis`` before the next one counts, so that
        noise around the level makes one crossing, not many
    """
    above = signal >= level
    if hysteresis == 0.0:
        turns = 1 + np.flatnonzero(above[1:] & (signal[:-1] < level))
    else:
        state = np.zeros(len(signal), dtype=np.int8)  # NaN stays 0: the state before goes on
        state[above] = 1
        state[signal < level - hysteresis] = -1
        known = np.flatnonzero(state)
        turns = known[1:][np.diff(state[known]) == 2]
    times = []
    for i in turns:
        if not signal[i - 1] < level:  # the sample before was lost
            continue
        share = (level - signal[i - 1]) / (signal[i] - signal[i - 1])
        times.append(float(time_s[i - 1] + share * (time_s[i] - time_s[i - 1])))
    return times


def down_crossings(time_s: Array, signal: Array, level: float, hysteresis: float = 0.0) -> list[float]:
    """Times at which a signal falls through a level, s; the mirror image of `up_crossings`."""
    return up_crossings(time_s, -np.asarray(signal), -level, hysteresis)


def bend_uncertainty_s(time_s: Array, signal: Array, at_s: float) -> float:
    """What a straight line between two samples may miss of a bent signal at a crossing, as a standard uncertainty, s.

    The line is off by up to a·dt²/8 for a second derivative a; its root mean square over the interval is 0.73 of that.
    """
    i = int(np.clip(np.searchsorted(time_s, at_s), 2, len(time_s) - 2))
    near = np.asarray(signal, dtype=float)[i - 2 : i + 2]
    slope = abs(near[2] - near[1]) / (time_s[i] - time_s[i - 1])
    bend = float(np.abs(np.diff(near, 2)).max()) / 8
    return 0.73 * bend / slope if slope > 0 else 0.0


def find_last_fall(time_s: Array, signal: Array, level: float) -> float | None:
    """Time at which a signal falls through a level for good; None when it was never above, still is, or is lost."""
    above = np.flatnonzero(signal > level)
    if above.size == 0 or above[-1] + 1 >= signal.size or not np.isfinite(signal[above[-1] + 1]):
        return None
    i = int(above[-1])
    share = (signal[i] - level) / (signal[i] - signal[i + 1])
    return float(time_s[i] + share * (time_s[i + 1] - time_s[i]))


def select_first_after(times: list[float], after_s: float) -> float | None:
    return next((t for t in times if t >= after_s), None)


def read_level_with_uncertainty(
    find: Callable[[float], float | None], level: float, u_level: float, u_time_s: float = 0.0
) -> tuple[float | None, float]:
    """Value of a finder at a level and its standard uncertainty, by moving the level up and down by its own.

    A finder that jumps to another oscillation when the level moves gets the large uncertainty it deserves;
    one that finds nothing at a moved level falls back on the other side.

    Parameters
    ----------
    find : takes a level, returns a value or None
    u_time_s : a further independent standard uncertainty, added in quadrature

    Returns
    -------
    value : float or None
    u : float
        NaN when nothing was found, at the level or at a moved one.
    """
    value = find(level)
    if value is None:
        return None, float("nan")
    if u_level <= 0:
        return value, u_time_s
    sides = [find(level - u_level), find(level + u_level)]
    if any(other is None for other in sides):
        return value, float("nan")
    # a slow signal is a staircase of counts: three times the shift tells its slope where one may stay on a step
    wide = [find(level - 3 * u_level), find(level + 3 * u_level)]
    spread = max(abs(other - value) for other in sides if other is not None)
    spread = max([spread, *(abs(other - value) / 3 for other in wide if other is not None)])
    return value, float(np.hypot(spread, u_time_s))


LevelReading = Callable[[Callable[[float], float | None], float, float], tuple[float | None, float]]


def read_level(find: Callable[[float], float | None], level: float, u_level: float) -> tuple[float | None, float]:
    """Value of a finder at a level, and 0; for `read_level_with_uncertainty` where no uncertainty is asked for."""
    return find(level), 0.0


Stretch = Callable[[float, float], tuple[Array, Array]]

LENGTHS_S = (6e-3, 5e-3, 4e-3, 3e-3)
LOWEST_HZ, HIGHEST_HZ, STEP_HZ = 150.0, 800.0, 10.0
DAMPING, U_DAMPING = 0.03, 0.03  # of critical damping: wood and glue 0.01, with felt more
DAMPINGS = (0.0, 0.02, 0.04, 0.08)
MINIMUM_FREEDOM = 4
MODEL_SHARE = 0.01  # of the vibration's amplitude that one damped sine leaves undescribed
HEAD_SHARE = 0.02  # of the butt's vibration that the head takes part in, about the ratio of their inertias
ROUNDS = 8
SEEN = 18.0  # chi-square of two parameters at the best of some frequencies: one clean flight in a thousand
TEST_HZ = np.arange(170.0, 420.0, 25.0)


def has_vibration(age: Array, residual: Array, sigma: float) -> bool:
    """Whether what a rigid flight leaves holds a vibration that a chi-square of all samples overlooks."""
    turn = np.exp(2j * np.pi * TEST_HZ[:, None] * age)
    power = 2 * np.abs(turn @ (residual / sigma)) ** 2 / age.size
    return bool(power.max() > SEEN)


def fit_vibration(
    stretch: Stretch, sigma: float, slowing: float, u_slowing: float, side: int
) -> tuple[float, float, float, float, float, str] | None:
    """Fit the longest stretch that rigid flight and one vibration describe; None when there is none of 3 to 6 ms.

    Of the rigid flight at age 0: speed (m/s) and its u, way (m) and its u, deceleration (m/s²); what was fitted.

    Parameters
    ----------
    stretch : gives ages and ways between two ages
    sigma : standard uncertainty of one sample, m
    slowing, u_slowing : deceleration of free flight and its standard uncertainty, m/s²
    side : −1 before the contact, where the vibration dies away towards age 0; +1 after it
    """
    found: list[tuple[float, float, float, float, float, str]] = []
    for length in LENGTHS_S:
        age, way = stretch(0.0, length)
        if age.size < 7 + MINIMUM_FREEDOM:
            break
        fit = _fit(age, way, sigma, (slowing, u_slowing), side)
        if fit is None:
            if found:
                break
            continue
        found.append(fit)
        if len(found) == 2:  # the last millisecond of the longest stretch may hold an unseen disturbance
            break
    return found[-1] if found else None


def _vibration(age: Array, frequency: Array, damping: Array, side: int) -> Array:
    """Damped cosine and sine of several frequencies and dampings at ages, (k, n, 2)."""
    turn = 2 * np.pi * frequency[:, None] * age
    size = np.exp(-side * damping[:, None] * turn)
    return np.stack([size * np.cos(turn), size * np.sin(turn)], axis=2)


def _fit(
    age: Array, position: Array, sigma: float, prior: tuple[float, float], side: int
) -> tuple[float, float, float, float, float, str] | None:
    rigid = np.column_stack([np.ones(age.size), age, age**2 / 2])
    slowing, u_slowing = prior

    def solve(frequency: Array, damping: Array) -> tuple[Array, Array]:
        """Coefficients and cost at each frequency and damping: rigid flight, cosine, sine."""
        designs = np.concatenate(
            [np.broadcast_to(rigid, (frequency.size, *rigid.shape)), _vibration(age, frequency, damping, side)], axis=2
        )
        normal = np.swapaxes(designs, 1, 2) @ designs / sigma**2
        normal[:, 2, 2] += u_slowing**-2
        target = np.swapaxes(designs, 1, 2) @ position / sigma**2
        target[:, 2] += slowing / u_slowing**2
        scale = np.sqrt(np.einsum("kii->ki", normal))
        found = np.linalg.solve(normal / (scale[:, :, None] * scale[:, None, :]), (target / scale)[:, :, None])
        coefficient = found[:, :, 0] / scale
        cost = np.sum((position - (designs @ coefficient[:, :, None])[:, :, 0]) ** 2, axis=1) / sigma**2
        cost += ((coefficient[:, 2] - slowing) / u_slowing) ** 2 + ((damping - DAMPING) / U_DAMPING) ** 2
        return coefficient, cost

    grid = np.arange(max(LOWEST_HZ, 1.0 / float(age.max())), HIGHEST_HZ, STEP_HZ)
    frequencies, dampings = (x.ravel() for x in np.meshgrid(grid, DAMPINGS))
    best = int(np.argmin(solve(frequencies, dampings)[1]))
    refined = _refine(solve, age, frequencies[best], dampings[best], side)
    frequency, damping, coefficient, cost, design = refined
    amplitude = float(np.hypot(coefficient[3], coefficient[4]))
    freedom = age.size + 2 - 7
    # a large vibration is never quite one damped sine
    unknown = 1 + (MODEL_SHARE * amplitude / sigma) ** 2
    if cost / freedom > (1 + 3 * np.sqrt(2 / freedom)) * unknown or frequency < 1.0 / float(age.max()):
        return None
    inside = np.diag([0.0, 0.0, u_slowing**-2, 0.0, 0.0, 0.0, U_DAMPING**-2])
    covariance = np.linalg.pinv(design.T @ design / (sigma**2 * unknown) + inside)
    note = f"flight fitted with a vibration of {frequency:.0f} Hz over {1e3 * age.max():.0f} ms"
    u_way = float(np.hypot(np.sqrt(covariance[0, 0]), HEAD_SHARE * amplitude))
    u_speed = float(np.hypot(np.sqrt(covariance[1, 1]), HEAD_SHARE * amplitude * 2 * np.pi * frequency))
    return float(coefficient[1]), u_speed, float(coefficient[0]), u_way, float(coefficient[2]), note


def _refine(
    solve: Callable[[Array, Array], tuple[Array, Array]],
    age: Array,
    frequency: float,
    damping: float,
    side: int,
) -> tuple[float, float, Array, float, Array]:
    """Frequency, damping, coefficients, cost, and the design with both as columns of their own, at the least cost."""
    steps = np.array([STEP_HZ, 0.02])
    at = np.array([frequency, damping])
    for _ in range(ROUNDS):
        # a stencil about the place, its parabola's vertex, a smaller stencil
        stencil = at + steps * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        cost = solve(stencil[:, 0], stencil[:, 1])[1]
        bend = np.array([cost[1] + cost[2] - 2 * cost[0], cost[3] + cost[4] - 2 * cost[0]])
        tilt = np.array([cost[1] - cost[2], cost[3] - cost[4]])
        with np.errstate(divide="ignore", invalid="ignore"):
            move = np.where(bend > 0, -tilt / (2 * bend), -np.sign(tilt))
        at = at + np.clip(np.nan_to_num(move), -1.5, 1.5) * steps
        steps = steps / 2
    coefficients, costs = solve(at[:1], at[1:])
    wave = _vibration(age, at[:1], at[1:], side)[0]
    coefficient, turn = coefficients[0], 2 * np.pi * age
    swing, quarter = wave @ coefficient[3:], wave @ np.array([coefficient[4], -coefficient[3]])
    by_frequency = turn * (quarter - side * at[1] * swing)
    by_damping = -side * turn * at[0] * swing
    design = np.column_stack([np.ones(age.size), age, age**2 / 2, wave, by_frequency, by_damping])
    return float(at[0]), float(at[1]), coefficient, float(costs[0]), design


WINDOW_S = 2e-3
LONGEST_FLIGHT_S = 6e-3
STEP_S = 1e-3
CLEAN_FLIGHT_S = 3e-3
DECELERATION_M_PER_S2 = 10.5
FALL_M_PER_S2 = 9.0  # on the way back friction holds against gravity
U_DECELERATION_M_PER_S2 = 1.5
SIGMA_FLOOR_M = 1e-6
MINIMUM_SAMPLES = 4
SHANK_HZ = 250.0


@dataclass(frozen=True)
class Flight:
    """Speed at contact (m/s) and time at which the flight reaches the string, each with its standard uncertainty.

    ``slowing`` is the deceleration at contact, m/s²: what a string elsewhere makes of the speed.
    """

    speed: float
    u_speed: float
    contact_s: float
    u_contact_s: float
    note: str = ""
    slowing: float = 0.0


@dataclass(frozen=True)
class _Path:
    """Way, speed and second derivative at age 0 with their covariance; whether the samples lie on such a path."""

    value: Array
    covariance: Array
    good: bool

    def residuals(self, age: Array, way: Array) -> Array:
        return way - (self.value[0] + self.value[1] * age + self.value[2] * age**2 / 2)

    def u(self, i: int) -> float:
        return float(np.sqrt(self.covariance[i, i]))


def _parabola(age: Array, position: Array, sigma: float, slowing: float | None = None) -> tuple[Array, Array]:
    """Way, speed and second derivative at age 0 by weighted least squares, (3,), and their covariance, (3, 3)."""
    design = np.stack([np.ones(age.size), age, 0.5 * age**2])
    normal, target = design @ design.T / sigma**2, design @ position / sigma**2
    if slowing is not None:
        normal[2, 2] += U_DECELERATION_M_PER_S2**-2
        target[2] += slowing * U_DECELERATION_M_PER_S2**-2
    scale = np.sqrt(normal.diagonal())
    covariance = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
    return covariance @ target, covariance


def _path(age: Array, position: Array, sigma: float, slowing: float | None = None) -> _Path:
    """Parabola through samples; of a free hammer (the deceleration known beforehand), or of any."""
    value, covariance = _parabola(age, position, sigma, slowing)
    left = (position - value[0] - value[1] * age - 0.5 * value[2] * age**2) / sigma
    chi2, count = float(left @ left), age.size
    if slowing is not None:
        chi2, count = chi2 + ((slowing - value[2]) / U_DECELERATION_M_PER_S2) ** 2, count + 1
    freedom = max(count - 3, 1)
    # three standard deviations of a reduced chi-square
    return _Path(value, covariance, bool(chi2 / freedom <= 1 + 3 * math.sqrt(2 / freedom)))


def _is_pushed(path: _Path) -> bool:
    return bool(path.value[2] < DECELERATION_M_PER_S2 - 3 * np.hypot(path.u(2), U_DECELERATION_M_PER_S2))


def fit_flight(time_s: Array, way_m: Array, contact_s: float, side: int, sigma_m: float) -> Flight:
    """Speed and time of contact from samples on one side of it.

    Parameters
    ----------
    time_s, way_m : (n,), NaN where lost
    contact_s : first estimate of when contact begins (side −1) or ends (side +1); only samples beyond it are used
    side : −1 fits before the contact, +1 after it
    sigma_m : standard uncertainty of one sample
    """
    sigma = max(sigma_m, SIGMA_FLOOR_M)
    way = np.asarray(way_m, dtype=float)
    age = side * (np.asarray(time_s, dtype=float) - contact_s)
    usable = np.isfinite(way) & (age > 0)

    def stretch(begin: float, end: float) -> tuple[Array, Array]:
        take = usable & (age > begin) & (age <= end)
        return age[take], way[take]

    samples = stretch(0.0, WINDOW_S)[0].size
    if samples < MINIMUM_SAMPLES:
        nan = float("nan")
        return Flight(nan, nan, contact_s, nan, f"only {samples} samples within 2 ms of contact; 4 are needed")
    expected = DECELERATION_M_PER_S2 if side < 0 else FALL_M_PER_S2
    length, clean = _find_undisturbed(stretch, sigma, expected)
    path = _path(*stretch(0.0, length), sigma, expected)
    if side < 0 and not clean and path.value[1] > 0:  # a string lower than the geometry says brakes the last samples
        touch = NEAR_MISS_M / float(path.value[1])
        length, clean = _find_undisturbed(lambda begin, end: stretch(touch + begin, touch + end), sigma, expected)
        if clean:
            path = _path(*stretch(touch, touch + length), sigma, expected)
    speed, u_speed, note = float(path.value[1]), path.u(1), f"free flight over {1e3 * length:.0f} ms"
    gap, u_gap, slowing = float(path.value[0]), path.u(0), float(path.value[2])
    if not clean:
        shaken = fit_vibration(stretch, sigma, expected, U_DECELERATION_M_PER_S2, side)
        curve = _path(*stretch(0.0, WINDOW_S), sigma)
        earlier = stretch(WINDOW_S, 2 * WINDOW_S)
        before = _path(*earlier, sigma) if earlier[0].size >= MINIMUM_SAMPLES else curve
        if shaken is not None:  # the head, which touches, keeps to the rigid path
            speed, u_speed, gap, u_gap, slowing, note = shaken
        else:
            speed, u_speed, slowing = float(curve.value[1]), curve.u(1), float(curve.value[2])
            gap, u_gap, note = float(curve.value[0]), curve.u(0), "not in free flight: parabola over 2 ms"
            if not (side < 0 and curve.good and _is_pushed(curve) and _is_pushed(before)):
                swing = _measure_swing(*stretch(0.0, LONGEST_FLIGHT_S))
                u_gap = float(np.hypot(u_gap, swing))
                line, u_line = float(path.value[1]), path.u(1)
                u_speed = float(np.hypot(u_line, max(abs(speed - line), 2 * np.pi * SHANK_HZ * swing)))
                speed, note = line, "line over 2 ms; path is bent (late let-off? shank?)"
    if not (speed > 0):
        return Flight(float("nan"), float("nan"), contact_s, float("nan"), "hammer does not move along the string side")
    age_of_contact = -gap / speed
    return Flight(
        speed + slowing * age_of_contact, u_speed, contact_s + side * age_of_contact, u_gap / speed, note, slowing
    )


def _measure_swing(age: Array, position: Array) -> float:
    """How far a bent path swings about a straight line, root mean square, m."""
    line = np.polyfit(age, position, 1)
    return float(np.std(position - np.polyval(line, age)))


def _find_undisturbed(stretch: Stretch, sigma: float, slowing: float) -> tuple[float, bool]:
    """Length of free flight to use, and whether at least 3 ms are one.

    The last millisecond of the longest stretch that passes is left out: a disturbance may have begun in it unseen.
    """
    longest, last = 0.0, None
    for length in np.arange(WINDOW_S, LONGEST_FLIGHT_S + 1e-9, STEP_S):
        age, way = stretch(0.0, float(length))
        if age.size < MINIMUM_SAMPLES:
            break
        path = _path(age, way, sigma, slowing)
        if not path.good:
            break
        longest, last = float(length), (age, path.residuals(age, way))
    if last is not None and longest >= CLEAN_FLIGHT_S - 1e-9 and has_vibration(*last, sigma):
        return WINDOW_S, False
    return max(longest - STEP_S, WINDOW_S), longest >= CLEAN_FLIGHT_S - 1e-9


REVERSAL_S = 6e-3
AWAY_M = 5e-3
NEAR_MISS_M = 2e-3
SHARP_M_PER_S = 0.3
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
    """Strike whose contact begins at a crossing of the string line."""
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


def _find_near_misses(motion: Motion, known: list[float]) -> list[Strike]:
    """Sharp reversals close below the string line: a string that is lower than the geometry says."""
    time, height = motion.time_s, motion.hammer_height_m
    out = []
    step = float(np.median(np.diff(time)))
    reach = max(int(round(WINDOW_S / step)), 2)
    for first in down_crossings(time, height, NEAR_MISS_M, AWAY_M):
        if any(abs(first - t) < 2 * REVERSAL_S for t in known):
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
    """All contacts of hammer and string, in order of time.

    A contact is a fall of the hammer height through 0, after the hammer was 5 mm away, that turns back within
    6 ms.  A sharp reversal within 2 mm below the string line is reported as ambiguous.
    """
    times = down_crossings(motion.time_s, motion.hammer_height_m, 0.0, AWAY_M)
    strikes = [_fit_strike(motion, t) for t in times]
    return sorted([*strikes, *_find_near_misses(motion, times)], key=lambda s: s.time_s)


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


def key_bottom(motion: Motion, read: LevelReading = read_level_with_uncertainty) -> Event:
    """First time the key dip rises through the dip at which the key front touches its felt."""

    def find(level: float) -> float | None:
        return select_first_after(up_crossings(motion.time_s, motion.key_dip_m, level, DIP_HYSTERESIS_M), -np.inf)

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
    """First stretch after an impact and before a time in which the hammer is held; None when there is none.

    The height of a hammer that creeps while it is held depends on where noise lets the hold begin and end: the hold is
    found again in ranges narrower and wider by three standard uncertainties of a sample, and the change of the height
    is part of its uncertainty.
    """
    margin = 3 * motion.u_height_m
    ranges = (HOLD_RANGE_M,) if read is read_level else (HOLD_RANGE_M, HOLD_RANGE_M - margin, HOLD_RANGE_M + margin)
    for length, note in ((LEAST_HOLD_S, ""), (DOUBTFUL_HOLD_S, "held for less than 20 ms")):
        found, *others = _find_held(motion, after_s, until_s, length, ranges)
        if found is None:
            continue
        level, first, last, by_sample = found
        moved = max([by_sample, *(abs(other[0] - level) for other in others if other is not None)])
        if None in others or moved > CHECK_BAND_M:
            note = note or "within the uncertainty of a sample the hammer is held elsewhere, or not"
        return Hold(after_s, level, math.hypot(motion.u_height_still_m, moved), first, last, note)
    return None


def _find_held(
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


def check(
    motion: Motion, hold: Hold | None, *, struck: bool = True, read: LevelReading = read_level_with_uncertainty
) -> tuple[Event, Event]:
    """Time and height at which the hammer is caught.

    Parameters
    ----------
    hold : None when the hammer is never held
    struck : without an impact there is no check
    read : how a time at a level is read: with its uncertainty or without
    """
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
    value, u = read(entry, CHECK_BAND_M, math.hypot(motion.u_height_m, hold.u_own_m))
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
    """Last fall of the key dip through half the touching dip, when the key stays up to the end of the record."""
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
    """Time from which height and dip stay within 0.1 mm of their mean over the first `quiet_stop` samples."""
    time = motion.time_s
    height = np.abs(motion.hammer_height_m - float(np.mean(motion.hammer_height_m[:quiet_stop])))
    dip = np.abs(motion.key_dip_m - float(np.mean(motion.key_dip_m[:quiet_stop])))
    u_height, u_dip = motion.own_u_height_m(), motion.own_u_dip_m()
    # both in units of their own uncertainty, so that a band moved by one moves both as they may
    away = np.fmax((height - REST_BAND_M) / u_height, (dip - REST_BAND_M) / u_dip)

    def find(level: float) -> float | None:
        when = find_last_fall(time, away, level)
        return when if when is not None and time[-1] - when >= REST_LASTS_S else None

    value, u = read(find, 0.0, 1.0)
    if value is None:
        far = np.fmax(height, dip)
        left = 1e3 * float(far[np.isfinite(far)][-1])
        return make_absent_event("rest", f"not at rest for the last 50 ms of the record; {left:.2f} mm away at its end")
    return _make_time_event("rest", value, u)


def _make_time_event(name: str, value: float, u: float) -> Event:
    """A time event; one that jumps by more than 10 ms within its level's uncertainty is ambiguous."""
    if u > DOUBTFUL_TIME_S:
        return Event(name, value, u, "ambiguous", f"moves by {1e3 * u:.0f} ms within the uncertainty of its level")
    return make_crossing_event(name, value, u)


ONSET_M = 0.1e-3
OFF_PATH_M = 0.1e-3
FREE_FOR_S = 0.05
SWINGS_S = 0.01  # before the impact
SWINGS_BY = 2.0  # the level that a vibration does not reach on the side of the jack either
DROP_M = 0.5e-3
BOUNCE_M = 0.3e-3
LANDED_M = 0.3e-3
TURN_S = 0.6e-3


def onset(motion: Motion, quiet_stop: int, read: LevelReading = read_level_with_uncertainty) -> Event:
    """Key dip first rises through 0.1 mm above its rest."""
    dip = motion.key_dip_m - float(np.mean(motion.key_dip_m[:quiet_stop]))

    def find(level: float) -> float | None:
        return select_first_after(up_crossings(motion.time_s, dip, level), -np.inf)

    value, u = read(find, ONSET_M, motion.own_u_dip_m())
    if value is None:
        return make_absent_event("onset", f"key never dips by {1e3 * ONSET_M:g} mm")
    return _make_bent_crossing("onset", value, u, motion.time_s, dip)


def let_off(motion: Motion, strike: Strike | None, read: LevelReading = read_level_with_uncertainty) -> Event:
    """Last time before the impact at which the hammer is 0.1 mm off the path of its free flight."""
    if strike is None or not math.isfinite(strike.arrival.speed):
        return make_absent_event("let_off", "no string impact")
    contact = strike.arrival.contact_s
    age = contact - motion.time_s
    near = (age > 0) & (age < FREE_FOR_S)

    def lag_of_path(speed: float) -> Array:
        path = speed * age + DECELERATION_M_PER_S2 * age**2 / 2
        return np.where(near, motion.hammer_way_m - path, np.nan)

    # the deceleration of the path is part of the definition; the speed is not, and tilts it
    speed, u_speed = strike.arrival.speed, strike.arrival.u_speed
    behind = lag_of_path(speed)
    # a jack pushes the hammer from one side of its path; one that is off on the other side vibrates about it, unless it
    # is as near as a string that is lower than the geometry says
    in_flight = (age < SWINGS_S) & (speed * age > NEAR_MISS_M)
    swing = float(np.nanmax(np.where(in_flight, behind, np.nan), initial=0.0))
    vibrates = swing > OFF_PATH_M
    level = OFF_PATH_M + (SWINGS_BY * swing if vibrates else 0.0)
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
    """Number of times the hammer turns round by 0.3 mm or more between the impact and the check."""
    if strike is None:
        return make_absent_event("check_bounces", "no string impact")
    if not math.isfinite(caught.value):
        return make_absent_event("check_bounces", "hammer is never held")
    part = (motion.time_s > strike.time_s + 2e-3) & (motion.time_s < caught.value)
    height, margin = motion.hammer_height_m[part], 3 * motion.u_height_m
    count, fewest, most = (_count_turns(height, BOUNCE_M + by) for by in (0.0, margin, -margin))
    note = caught.note if caught.status == "ambiguous" else ""
    if fewest != most:
        note = f"{min(fewest, most)} to {max(fewest, most)} within the uncertainty of a sample"
    return Event("check_bounces", float(count), 0.0, "ambiguous" if note else "found", note)


def _count_turns(height: Array, least: float) -> int:
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
    """Hammer first is 0.5 mm further from the string than the height it was held at, after the key was let go."""
    if hold is None or not math.isfinite(check_s):
        return make_absent_event("drop", "hammer is never held")
    height = motion.hammer_height_m

    def find(level: float) -> float | None:
        return select_first_after(up_crossings(motion.time_s, height, level), check_s)

    value, u = read(find, hold.height_m + DROP_M, math.hypot(motion.u_height_m, hold.u_own_m))
    if value is None:
        return make_absent_event("drop", "hammer stays where it was held")
    note = hold.note
    if math.isfinite(release_s) and value < release_s - 0.05:
        note = "long before the key was let go"
    event = _make_bent_crossing("drop", value, u, motion.time_s, height)
    return event if not note else Event("drop", value, event.u, "ambiguous", note)


def landing(motion: Motion, hold: Hold | None, drop_s: float) -> Event:
    """After the drop the hammer first comes back by 0.3 mm: the time it was furthest from the string before that."""
    if hold is None or not math.isfinite(drop_s):
        return make_absent_event("landing", "no drop")
    time, height = motion.time_s, motion.hammer_height_m
    begin = int(np.searchsorted(time, drop_s))
    highest = np.fmax.accumulate(height[begin:])
    back = np.flatnonzero(highest - height[begin:] > LANDED_M)
    if back.size == 0:
        return make_absent_event("landing", "hammer does not bounce by 0.3 mm when it lands")
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
    (level, slope, bend), covariance = _parabola(t, height[part], 1.0)
    if bend >= 0:
        return float("nan"), float("nan")
    residual = height[part] - level - slope * t - 0.5 * bend * t**2
    noise = max(sigma, float(np.sqrt(residual @ residual / (t.size - 3))))
    return float(time[turn] - slope / bend), noise * math.sqrt(covariance[1, 1]) / abs(bend)


def _make_bent_crossing(name: str, value: float, u: float, time: Array, signal: Array) -> Event:
    return make_crossing_event(name, value, math.hypot(u, bend_uncertainty_s(time, np.nan_to_num(signal), value)))


def find_events(motion: Motion, quiet_stop: int, read: LevelReading = read_level_with_uncertainty) -> dict[str, Event]:
    """Find every event of `validation.events.definitions.EVENTS` in one keystroke.

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


def _make_speed_event(name: str, motion: Motion, strike: Strike | None, speed: Flight | None) -> Event:
    if strike is None or speed is None:
        return make_absent_event(name, "no string impact")
    if math.isnan(speed.speed):
        return make_absent_event(name, speed.note)
    elsewhere = speed.slowing * motion.u_height_zero_m / speed.speed  # a string that stands higher is met later
    u = math.hypot(speed.u_speed, motion.u_speed_relative * speed.speed, elsewhere)
    return Event(name, speed.speed, u, strike.status, speed.note)
