"""String impacts: when the hammer touches, how fast it arrives and how fast it leaves.

Place in the data flow: `validation.motion` → here → `validation.events`.
Conventions: hammer height in m, 0 at the string; speeds of the head normal to the string, positive towards
the string before contact and away from it after.
Source: a fit from one side only, over the last 2 ms before contact.  A symmetric differentiator mixes both
sides of a velocity that jumps within a millisecond.  In free flight the head is slowed by gravity and joint
friction (about 10 m/s²), which over the half window is half a per cent of a forte; the straight line is
therefore carried to contact with the deceleration of the longest stretch that is free flight.
Failure: fewer than four samples in the window give a NaN speed with a note.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.crossings import down_crossings, up_crossings, with_level_uncertainty
from validation.event import Status
from validation.geometry import Array
from validation.motion import Motion

WINDOW_S = 2e-3
LONGEST_FLIGHT_S = 6e-3
REVERSAL_S = 6e-3
AWAY_M = 5e-3
NEAR_MISS_M = 2e-3
FREE_FLIGHT_M_PER_S2 = 30.0
SHARP_M_PER_S = 0.3
SIGMA_FLOOR_M = 1e-6
MINIMUM_SAMPLES = 4


@dataclass(frozen=True)
class Speed:
    """A speed at one side of a contact, m/s, and how it was found."""

    value: float
    u: float
    note: str = ""


@dataclass(frozen=True)
class Strike:
    """One contact of hammer and string."""

    time_s: float
    u_time_s: float
    arrival: Speed
    rebound: Speed
    status: Status
    note: str = ""


def _polynomial(t: Array, y: Array, degree: int, sigma: float) -> tuple[Array, Array, float]:
    """Coefficients (constant first), their covariance for noise `sigma`, and reduced chi-square."""
    design = np.vander(t, degree + 1, increasing=True)
    scale = np.abs(t).max() ** np.arange(degree + 1)
    inverse = np.linalg.pinv(design / scale)
    coefficient = (inverse @ y) / scale
    covariance = sigma**2 * (inverse @ inverse.T) / np.outer(scale, scale)
    freedom = max(t.size - degree - 1, 1)
    chi2 = float(np.sum((y - design @ coefficient) ** 2)) / sigma**2 / freedom
    return coefficient, covariance, chi2


def _passes(chi2: float, samples: int, degree: int) -> bool:
    freedom = max(samples - degree - 1, 1)
    return chi2 <= 1 + 3 * np.sqrt(2 / freedom)


def one_sided_speed(time_s: Array, height_m: Array, contact_s: float, side: int, sigma_m: float) -> Speed:
    """Magnitude of the head's speed at contact, from samples on one side of it.

    Parameters
    ----------
    time_s, height_m : (n,) arrays
    contact_s : float
        Instant at which contact begins (side −1) or ends (side +1).
    side : int
        −1 fits before the instant, +1 after it.
    sigma_m : float
        Standard uncertainty of one height sample.

    Returns
    -------
    Speed
        Positive towards the string for side −1, positive away from it for side +1.
    """
    sigma = max(sigma_m, SIGMA_FLOOR_M)
    age = side * (np.asarray(time_s) - contact_s)  # grows away from contact
    finite = np.isfinite(height_m)

    def stretch(length: float) -> tuple[Array, Array]:
        take = (age > 0) & (age <= length) & finite
        return age[take], np.asarray(height_m)[take]

    t2, h2 = stretch(WINDOW_S)
    if t2.size < MINIMUM_SAMPLES:
        return Speed(float("nan"), float("nan"), f"only {t2.size} samples within 2 ms of contact; 4 are needed")
    line, line_cov, _ = _polynomial(t2 - t2.mean(), h2, 1, sigma)
    curve, curve_cov, chi2 = _polynomial(t2, h2, 2, sigma)
    if not _passes(chi2, t2.size, 2):
        # shank vibration: neither line nor parabola holds; the line is less sensitive to it
        gap = abs(line[1] - curve[1])
        residual = np.std(h2 - np.polyval(line[::-1], t2 - t2.mean()), ddof=2)
        u = np.hypot(np.sqrt(line_cov[1, 1]) * max(residual / sigma, 1.0), gap / 2)
        return Speed(float(line[1]), float(u), "line over 2 ms; residual above encoder noise (vibration)")
    if abs(2 * curve[2]) > FREE_FLIGHT_M_PER_S2 + 3 * 2 * np.sqrt(curve_cov[2, 2]):
        return Speed(float(curve[1]), float(np.sqrt(curve_cov[1, 1])), "not in free flight: parabola over 2 ms")

    flight, best, best_cov = WINDOW_S, curve, curve_cov
    for length in np.arange(WINDOW_S + 1e-3, LONGEST_FLIGHT_S + 1e-9, 1e-3):
        t, h = stretch(float(length))
        fit, cov, chi2 = _polynomial(t, h, 2, sigma)
        if not _passes(chi2, t.size, 2) or abs(2 * fit[2]) > FREE_FLIGHT_M_PER_S2:
            break
        flight, best, best_cov = float(length), fit, cov
    # slope at the window's middle, carried to contact with the curvature of the whole flight
    back = float(t2.mean())
    value = line[1] - 2 * best[2] * back
    u = np.sqrt(line_cov[1, 1] + (2 * back) ** 2 * best_cov[2, 2])
    return Speed(float(value), float(u), f"line over 2 ms, deceleration over {1e3 * flight:.0f} ms of free flight")


def _reversal(motion: Motion, after_s: float) -> bool:
    """Whether the hammer moves away again within 6 ms of crossing the string line."""
    times = up_crossings(motion.time_s, motion.hammer_height_m, 0.0)
    return any(after_s <= t <= after_s + REVERSAL_S for t in times)


def _strike_at(motion: Motion, contact_s: float) -> Strike:
    """Strike whose contact begins at a crossing of the string line."""
    time, height = motion.time_s, motion.hammer_height_m
    arrival = one_sided_speed(time, height, contact_s, -1, motion.u_height_m)
    status: Status = "found"
    note = arrival.note
    rebound = Speed(float("nan"), float("nan"), "hammer did not come back")
    if _reversal(motion, contact_s):
        leave = min(t for t in up_crossings(time, height, 0.0) if t >= contact_s)
        rebound = one_sided_speed(time, height, leave, +1, motion.u_height_m)
    else:
        status, note = "ambiguous", "hammer crosses the string line without turning back within 6 ms"
    _, u_time = with_level_uncertainty(
        lambda level: min(
            (t for t in down_crossings(time, height, level) if abs(t - contact_s) < REVERSAL_S), default=None
        ),
        0.0,
        motion.level_u_height_m(),
    )
    return Strike(contact_s, u_time, arrival, rebound, status, note)


def _near_misses(motion: Motion, known: list[float]) -> list[Strike]:
    """Sharp reversals close below the string line: a string that is lower than the geometry says."""
    time, height = motion.time_s, motion.hammer_height_m
    out = []
    step = float(np.median(np.diff(time)))
    reach = max(int(round(WINDOW_S / step)), 2)
    for first in down_crossings(time, height, NEAR_MISS_M, AWAY_M):
        if any(abs(first - t) < 2 * REVERSAL_S for t in known):
            continue
        begin = int(np.searchsorted(time, first))
        look = height[begin : begin + 5 * reach]
        if look.size == 0 or not np.isfinite(look).any():
            continue
        turn = begin + int(np.nanargmin(look))
        if turn - reach < 0 or turn + reach >= time.size:
            continue
        speed_in = (height[turn - reach] - height[turn]) / (time[turn] - time[turn - reach])
        speed_out = (height[turn + reach] - height[turn]) / (time[turn + reach] - time[turn])
        if speed_in + speed_out < SHARP_M_PER_S:
            continue
        gap = 1e3 * height[turn]
        arrival = one_sided_speed(time, height, float(time[turn] - WINDOW_S / 2), -1, motion.u_height_m)
        note = f"hammer turns back sharply {gap:.2f} mm below the string line; check rest and string height"
        nothing = Speed(float("nan"), float("nan"), note)
        out.append(Strike(float(time[turn]), WINDOW_S / 2, arrival, nothing, "ambiguous", note))
    return out


def find_strikes(motion: Motion) -> list[Strike]:
    """All contacts of hammer and string, in order of time.

    A contact is a fall of the hammer height through 0, after the hammer was 5 mm away, that turns back within
    6 ms.  A sharp reversal within 2 mm below the string line is reported as ambiguous.
    """
    times = down_crossings(motion.time_s, motion.hammer_height_m, 0.0, AWAY_M)
    strikes = [_strike_at(motion, t) for t in times]
    return sorted([*strikes, *_near_misses(motion, times)], key=lambda s: s.time_s)
