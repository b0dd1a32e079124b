"""The hammer just before and just after the string: speed at contact and time of contact, from one side only.

Conventions: the way is the hammer's angle from the string times the head's lever there: m, 0 at the string, positive
below it, free of the circle's curvature. *Age* is the time from the contact, positive on both sides, so that one fit
serves arrival and departure; speeds are magnitudes.
Source: samples of the last 2 to 5 ms, as far as they lie on the path of a free hammer. A symmetric differentiator
mixes both sides of a velocity that jumps within a millisecond. In free flight gravity and joint friction slow the head
by about 10.5 m/s², and it falls back with 9 (a mass at the end of a light lever: about g), known beforehand to
1.5 m/s²: over 2 ms that is a straight line carried to contact, over longer flights the deceleration is measured. A
flight that is not undisturbed for 3 ms is fitted together with one vibration (`validation.events.shank_vibration`),
or with a parabola while still pushed. Fewer than four samples give a NaN speed with a note.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.conventions import Array
from validation.events.shank_vibration import Stretch, fit_vibration, is_seen

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

    def left(self, age: Array, way: Array) -> Array:
        return way - (self.value[0] + self.value[1] * age + self.value[2] * age**2 / 2)

    def u(self, i: int) -> float:
        return float(np.sqrt(self.covariance[i, i]))


def _path(age: Array, way: Array, sigma: float, slowing: float | None = None) -> _Path:
    """Parabola through samples; of a free hammer (the deceleration known beforehand), or of any."""
    design = np.column_stack([np.ones(age.size), age, age**2 / 2]) / sigma
    target = way / sigma
    if slowing is not None:
        design = np.vstack([design, [0.0, 0.0, 1.0 / U_DECELERATION_M_PER_S2]])
        target = np.append(target, slowing / U_DECELERATION_M_PER_S2)
    scale = np.linalg.norm(design, axis=0)
    inverse = np.linalg.pinv(design / scale)
    value = (inverse @ target) / scale
    freedom = max(target.size - 3, 1)
    chi2 = float(np.sum((target - design @ value) ** 2)) / freedom
    # three standard deviations of a reduced chi-square
    return _Path(value, (inverse @ inverse.T) / np.outer(scale, scale), chi2 <= 1 + 3 * np.sqrt(2 / freedom))


def _is_pushed(path: _Path) -> bool:
    return bool(path.value[2] < DECELERATION_M_PER_S2 - 3 * np.hypot(path.u(2), U_DECELERATION_M_PER_S2))


def flight(time_s: Array, way_m: Array, contact_s: float, side: int, sigma_m: float) -> Flight:
    """Speed and time of contact from samples on one side of it.

    Parameters
    ----------
    time_s, way_m : (n,) arrays
        NaN where lost.
    contact_s : float
        First estimate of when contact begins (side −1) or ends (side +1); only samples beyond it are used.
    side : int
        −1 fits before the contact, +1 after it.
    sigma_m : float
        Standard uncertainty of one sample.
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
    length, clean = _undisturbed(stretch, sigma, expected)
    path = _path(*stretch(0.0, length), sigma, expected)
    speed, u_speed, note = float(path.value[1]), path.u(1), f"free flight over {1e3 * length:.0f} ms"
    gap, u_gap, slowing = float(path.value[0]), path.u(0), float(path.value[2])
    if not clean:
        shaken = fit_vibration(stretch, sigma, expected, U_DECELERATION_M_PER_S2, side)
        curve = _path(*stretch(0.0, WINDOW_S), sigma)
        earlier = stretch(WINDOW_S, 2 * WINDOW_S)
        before = _path(*earlier, sigma) if earlier[0].size >= MINIMUM_SAMPLES else curve
        if shaken is not None:  # the head, which touches, keeps to the rigid path
            speed, u_speed, gap, u_gap = shaken.speed, shaken.u_speed, shaken.way, shaken.u_way
            slowing, note = shaken.slowing, shaken.note
        else:
            speed, u_speed, slowing = float(curve.value[1]), curve.u(1), float(curve.value[2])
            gap, u_gap, note = float(curve.value[0]), curve.u(0), "not in free flight: parabola over 2 ms"
            if not (side < 0 and curve.good and _is_pushed(curve) and _is_pushed(before)):
                swing = _swing(*stretch(0.0, LONGEST_FLIGHT_S))
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


def _swing(age: Array, way: Array) -> float:
    """How far a bent path swings about a straight line, root mean square, m."""
    line = np.polyfit(age, way, 1)
    return float(np.std(way - np.polyval(line, age)))


def _undisturbed(stretch: Stretch, sigma: float, slowing: float) -> tuple[float, bool]:
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
        longest, last = float(length), (age, path.left(age, way))
    if last is not None and longest >= CLEAN_FLIGHT_S - 1e-9 and is_seen(*last, sigma):
        return WINDOW_S, False
    return max(longest - STEP_S, WINDOW_S), longest >= CLEAN_FLIGHT_S - 1e-9
