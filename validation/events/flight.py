"""Speed of the hammer's head at the string and the time of contact, from the flight on one side of it.

Conventions: the way is the hammer's angle from the string times the head's lever there, m, free of the circle's
curvature; *age* is the time from the contact, s, positive on both sides, so that one fit serves arrival and departure.

The time of contact is where the incoming flight reaches the string, not a crossing interpolated between a flying and an
already braked sample; a symmetric differentiator would mix both sides of a velocity that jumps within a millisecond.
Used are the last 2 to 5 ms, as far as they lie on the path of a free hammer at the level of `LEVEL`. In free flight
gravity and joint friction slow the head by about 10.5 m/s², and it falls back with 9 (a mass at the end of a light
lever: about g), known beforehand to 1.5 m/s². A flight that is not undisturbed for 3 ms is fitted together with one
vibration, or with a parabola while still pushed. Fewer than four samples give a NaN speed with a note.

*A shank that vibrates* (thesis Section 4.1). The encoder sits at the butt, and in free flight a light butt swings
against a heavy head: the head stays on the rigid path within `HEAD_SHARE` of the vibration, which is stated as
uncertainty. The first bending mode of a shank lies at some hundreds of hertz, so that a 2 ms line holds only half a
period of it and its slope is wrong by up to the vibration's own speed. At least one whole period must lie in the
flight, so that a push is not taken for one; the deceleration of free flight and the damping enter as measurements with
their uncertainty, which keeps the fit determined.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from validation.conventions import Array

LENGTHS_S = tuple(1e-3 * k for k in range(2, 7))  # of the flight that is fitted: choice, in whole milliseconds
WINDOW_S, LONGEST_S = LENGTHS_S[0], LENGTHS_S[-1]
MINIMUM_SAMPLES = 4  # beyond the numbers of the smallest fit, so that its residuals say something
NEAR_MISS_M = 2e-3  # a string may be so much lower than the geometry says: choice, the range of an adjustment
LEVEL = 0.01  # of each test of a flight: share of undisturbed ones that are taken for disturbed
DECELERATION_M_PER_S2, FALL_M_PER_S2 = 10.5, 9.0  # in flight, and back, when friction holds against gravity
U_DECELERATION_M_PER_S2 = DECELERATION_M_PER_S2 - FALL_M_PER_S2  # friction of the joint, from none to twice the usual
LOWEST_HZ, HIGHEST_HZ, STEP_HZ = 150.0, 800.0, 10.0  # of a shank's first mode (maple, 6 mm: 270 Hz); of its search
DAMPING = U_DAMPING = 0.03  # of critical damping: wood and glue 0.01, with felt more
MODEL_SHARE = 0.01  # of the vibration's amplitude that one damped sine leaves undescribed
HEAD_SHARE = 0.02  # of the butt's vibration that the head takes part in, about the ratio of their inertias
ITERATIONS = 6  # of Gauss and Newton from the best of the search, which is half a step off at most

Stretch = Callable[[float, float], tuple[Array, Array]]
"""Gives ages and ways between two ages."""


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


def fit_parabola(age: Array, position: Array, sigma: float, slowing: float | None = None) -> tuple[Array, Array]:
    """Way (m), speed (m/s) and second derivative (m/s²) at age 0, (3,), and their covariance, (3, 3), by least squares
    on ``position`` (n,), m, of u ``sigma``, at ``age`` (n,), s; ``slowing``, m/s²: prior of the last one, none without
    it."""
    design = np.stack([np.ones(age.size), age, 0.5 * age**2])
    normal, target = design @ design.T / sigma**2, design @ position / sigma**2
    if slowing is not None:
        normal[2, 2] += U_DECELERATION_M_PER_S2**-2
        target[2] += slowing * U_DECELERATION_M_PER_S2**-2
    scale = np.sqrt(normal.diagonal())
    covariance = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
    return covariance @ target, covariance


def _fit_path(age: Array, position: Array, sigma: float, slowing: float | None = None) -> _Path:
    """Parabola through ``position`` (n,), m, of u ``sigma``, at ``age`` (n,), s: way, speed and second derivative at
    age 0, covariance, and whether a chi-square test accepts it; ``slowing``, m/s²: prior of the last one, none without
    it."""
    value, covariance = fit_parabola(age, position, sigma, slowing)
    left = (position - value[0] - value[1] * age - 0.5 * value[2] * age**2) / sigma
    chi2, count = float(left @ left), age.size
    if slowing is not None:
        chi2, count = chi2 + ((slowing - value[2]) / U_DECELERATION_M_PER_S2) ** 2, count + 1
    return _Path(value, covariance, bool(chi2 <= chdtri(max(count - 3, 1), LEVEL)))


def _is_pushed(path: _Path) -> bool:
    return bool(path.value[2] < DECELERATION_M_PER_S2 - 3 * np.hypot(path.u(2), U_DECELERATION_M_PER_S2))


def fit_flight(time_s: Array, way_m: Array, contact_s: float, side: int, sigma_m: float) -> Flight:
    """Head speed (m/s) and time of contact (s) with their u, from the distance to the string ``way_m`` (n,) on one side
    of the contact (``side`` −1 before, +1 after its estimate ``contact_s``); ``sigma_m``: u of a sample. NaN, with a
    note, on failure.

    Parameters
    ----------
    time_s, way_m : (n,), NaN where lost
    contact_s : first estimate of when contact begins (side −1) or ends (side +1); only samples beyond it are used
    side : −1 fits before the contact, +1 after it
    sigma_m : standard uncertainty of one sample
    """
    sigma = max(sigma_m, 1e-6)  # m, a fifth of a count: noiseless samples have no chi-square
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
    path = _fit_path(*stretch(0.0, length), sigma, expected)
    if side < 0 and not clean and path.value[1] > 0:  # a string lower than the geometry says brakes the last samples
        touch = NEAR_MISS_M / float(path.value[1])
        length, clean = _find_undisturbed(lambda begin, end: stretch(touch + begin, touch + end), sigma, expected)
        if clean:
            path = _fit_path(*stretch(touch, touch + length), sigma, expected)
    speed, u_speed, note = float(path.value[1]), path.u(1), f"free flight over {1e3 * length:.0f} ms"
    gap, u_gap, slowing = float(path.value[0]), path.u(0), float(path.value[2])
    if not clean:
        shaken = _fit_shaken_flight(stretch, sigma, expected, side)
        curve = _fit_path(*stretch(0.0, WINDOW_S), sigma)
        earlier = stretch(WINDOW_S, 2 * WINDOW_S)
        before = _fit_path(*earlier, sigma) if earlier[0].size >= MINIMUM_SAMPLES else curve
        if shaken is not None:  # the head, which touches, keeps to the rigid path
            speed, u_speed, gap, u_gap, slowing, note = shaken
        else:
            speed, u_speed, slowing = float(curve.value[1]), curve.u(1), float(curve.value[2])
            gap, u_gap, note = float(curve.value[0]), curve.u(0), "not in free flight: parabola over 2 ms"
            if not (side < 0 and curve.good and _is_pushed(curve) and _is_pushed(before)):
                swing = _measure_swing(*stretch(0.0, LONGEST_S))
                u_gap = float(np.hypot(u_gap, swing))
                line, u_line = float(path.value[1]), path.u(1)
                of_swing = 2 * np.pi * math.sqrt(LOWEST_HZ * HIGHEST_HZ) * swing
                u_speed = float(np.hypot(u_line, max(abs(speed - line), of_swing)))
                speed, note = line, "line over 2 ms; path is bent (late let-off? shank?)"
    if not (speed > 0):
        return Flight(float("nan"), float("nan"), contact_s, float("nan"), "hammer does not move along the string side")
    age_of_contact = -gap / speed
    return Flight(
        speed + slowing * age_of_contact, u_speed, contact_s + side * age_of_contact, u_gap / speed, note, slowing
    )


def _measure_swing(age: Array, position: Array) -> float:
    """Root mean square deviation (m) of a path from its regression line."""
    line = np.polyfit(age, position, 1)
    return float(np.std(position - np.polyval(line, age)))


def _find_undisturbed(stretch: Stretch, sigma: float, slowing: float) -> tuple[float, bool]:
    """Length (s) of free flight to fit, and whether at least 3 ms are undisturbed; ``stretch`` returns ages (s) and
    ways (m) between two ages, ``sigma`` is the u of a way, m, ``slowing`` the expected deceleration, m/s².

    The last millisecond of the longest stretch that passes is left out: a disturbance may have begun in it unseen.
    """
    longest, last = -1, None
    for k, length in enumerate(LENGTHS_S):
        age, way = stretch(0.0, length)
        if age.size < MINIMUM_SAMPLES:
            break
        path = _fit_path(age, way, sigma, slowing)
        if not path.good:
            break
        longest, last = k, (age, path.residuals(age, way))
    clean = longest >= 1  # 3 ms
    if last is not None and clean and _has_vibration(*last, sigma):
        return WINDOW_S, False
    return LENGTHS_S[max(longest - 1, 0)], clean


def _has_vibration(age: Array, residual: Array, sigma: float) -> bool:
    """Whether the residuals (n,) of a rigid flight hold a vibration that a chi-square test of all samples overlooks."""
    hz = np.arange(LOWEST_HZ, HIGHEST_HZ, 0.5 / float(age.max()))  # nearer ones are hardly told apart
    turn = np.exp(2j * np.pi * hz[:, None] * age)
    power = 2 * np.abs(turn @ (residual / sigma)) ** 2 / age.size
    return bool(power.max() > chdtri(2, LEVEL / hz.size))


def _fit_shaken_flight(
    stretch: Stretch, sigma: float, slowing: float, side: int
) -> tuple[float, float, float, float, float, str] | None:
    """Speed, its u, way, its u, deceleration (SI) at age 0 and a note: rigid flight with one vibration over the longest
    of 3 to 6 ms it describes, or None; ``sigma``: u of a way, ``slowing``: expected deceleration, ``side``: −1 before,
    +1 after contact.

    Parameters
    ----------
    sigma : standard uncertainty of one sample, m
    slowing : deceleration of free flight, m/s²
    side : −1 before the contact, where the vibration dies away towards age 0; +1 after it
    """
    found: list[tuple[float, float, float, float, float, str]] = []
    for length in LENGTHS_S[:0:-1]:
        age, way = stretch(0.0, length)
        if age.size < len(PARAMETERS) + MINIMUM_SAMPLES:
            break
        fit = _fit_vibration(age, way, sigma, slowing, side)
        if fit is None:
            if found:
                break
            continue
        found.append(fit)
        if len(found) == 2:  # the last millisecond of the longest stretch may hold an unseen disturbance
            break
    return found[-1] if found else None


PARAMETERS = ("way", "speed", "deceleration", "cosine", "sine", "frequency", "damping")


def _vibration(age: Array, frequency: Array, damping: Array, side: int) -> Array:
    """Damped cosine and sine of several frequencies and dampings at ages, (k, n, 2)."""
    turn = 2 * np.pi * frequency[:, None] * age
    size = np.exp(-side * damping[:, None] * turn)
    return np.stack([size * np.cos(turn), size * np.sin(turn)], axis=2)


def _fit_vibration(
    age: Array, position: Array, sigma: float, slowing: float, side: int
) -> tuple[float, float, float, float, float, str] | None:
    """Speed, its u, way, its u, deceleration (SI) at age 0 and a note: rigid flight with a damped vibration through
    ``position`` (n,), m, of u ``sigma``; ``slowing``: expected deceleration, ``side``: −1 before, +1 after contact.
    None where rejected."""
    rigid = np.column_stack([np.ones(age.size), age, age**2 / 2])
    weight = np.zeros(len(PARAMETERS))  # of what is known beforehand, and what that is
    weight[[2, 6]] = U_DECELERATION_M_PER_S2**-2, U_DAMPING**-2
    known = np.array([0.0, 0.0, slowing, 0.0, 0.0, 0.0, DAMPING])

    def solve(frequency: Array, damping: Array) -> tuple[Array, Array]:
        """Coefficients and cost at each frequency and damping: rigid flight, cosine, sine."""
        designs = np.concatenate(
            [np.broadcast_to(rigid, (frequency.size, *rigid.shape)), _vibration(age, frequency, damping, side)], axis=2
        )
        normal = np.swapaxes(designs, 1, 2) @ designs / sigma**2 + np.diag(weight[:5])
        target = np.swapaxes(designs, 1, 2) @ position / sigma**2 + (weight * known)[:5]
        scale = np.sqrt(np.einsum("kii->ki", normal))
        found = np.linalg.solve(normal / (scale[:, :, None] * scale[:, None, :]), (target / scale)[:, :, None])
        coefficient = found[:, :, 0] / scale
        cost = np.sum((position - (designs @ coefficient[:, :, None])[:, :, 0]) ** 2, axis=1) / sigma**2
        return coefficient, cost + weight[2] * (coefficient[:, 2] - slowing) ** 2

    lowest = max(LOWEST_HZ, 1.0 / float(age.max()))
    grid = np.arange(lowest, HIGHEST_HZ, STEP_HZ)
    frequency, damping = float(grid[np.argmin(solve(grid, np.full(grid.size, DAMPING))[1])]), DAMPING
    turn = 2 * np.pi * age
    for _ in range(ITERATIONS):
        coefficients, costs = solve(np.array([frequency]), np.array([damping]))
        at = np.array([*coefficients[0], frequency, damping])
        wave = _vibration(age, at[5:6], at[6:], side)[0]
        swing, quarter = wave @ at[3:5], wave @ np.array([at[4], -at[3]])
        by_frequency, by_damping = turn * (quarter - side * damping * swing), -side * turn * frequency * swing
        design = np.column_stack([rigid, wave, by_frequency, by_damping])
        residual = position - rigid @ at[:3] - swing
        size = np.linalg.norm(design, axis=0) / sigma + np.sqrt(weight)
        normal = (design.T @ design / sigma**2 + np.diag(weight)) / np.outer(size, size)
        move = np.linalg.lstsq(normal, (design.T @ residual / sigma**2 + weight * (known - at)) / size)[0] / size
        frequency += float(np.clip(move[5], -STEP_HZ, STEP_HZ))
        damping += float(np.clip(move[6], -U_DAMPING, U_DAMPING))
    amplitude, freedom = float(np.hypot(at[3], at[4])), age.size + 2 - len(PARAMETERS)
    unknown = 1 + (MODEL_SHARE * amplitude / sigma) ** 2  # a large vibration is never quite one damped sine
    cost = float(costs[0]) + weight[6] * (at[6] - DAMPING) ** 2
    if cost > chdtri(freedom, LEVEL) * unknown or at[5] < 1.0 / float(age.max()):
        return None
    covariance = np.linalg.pinv(design.T @ design / (sigma**2 * unknown) + np.diag(weight))
    note = f"flight fitted with a vibration of {at[5]:.0f} Hz over {1e3 * age.max():.0f} ms"
    u_way = float(np.hypot(np.sqrt(covariance[0, 0]), HEAD_SHARE * amplitude))
    u_speed = float(np.hypot(np.sqrt(covariance[1, 1]), HEAD_SHARE * amplitude * 2 * np.pi * at[5]))
    return float(at[1]), u_speed, float(at[0]), u_way, float(at[2]), note
