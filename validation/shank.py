"""A flying hammer whose shank vibrates: rigid flight and one vibration fitted together.

Place in the data flow: called by `validation.flight` for a flight that no parabola describes.
Conventions: as there; the speed is that of the rigid flight, without the vibration.
Source: thesis Section 4.1, which saw the head vibrate on its shank; the first bending mode of a hammer shank lies at
some hundreds of hertz, so that a 2 ms line holds only half a period of it and its slope is wrong by up to the
vibration's own speed.  At least one whole period must lie in the flight, so that a push is not taken for one; the
deceleration of free flight enters as a measurement with its uncertainty, which keeps the fit determined.
Failure: None when no stretch of 3 to 6 ms is described within the samples' uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from validation.geometry import Array

Stretch = Callable[[float, float], tuple[Array, Array]]

LENGTHS_S = (6e-3, 5e-3, 4e-3, 3e-3)
LOWEST_HZ, HIGHEST_HZ, STEP_HZ = 150.0, 800.0, 10.0
MINIMUM_FREEDOM = 5


@dataclass(frozen=True)
class ShakenFlight:
    """Speed of the rigid flight at age 0, m/s, its standard uncertainty, and the vibration found."""

    speed: float
    u_speed: float
    frequency_hz: float
    note: str


def _design(age: Array, frequency_hz: float) -> Array:
    turn = 2 * np.pi * frequency_hz * age
    return np.column_stack([np.ones(age.size), age, age**2 / 2, np.cos(turn), np.sin(turn)])


def fit_vibration(stretch: Stretch, sigma: float, slowing: float, u_slowing: float) -> ShakenFlight | None:
    """Fit the longest stretch that rigid flight and one vibration describe.

    Parameters
    ----------
    stretch : callable
        Gives ages and ways between two ages.
    sigma : float
        Standard uncertainty of one sample, m.
    slowing, u_slowing : float
        Deceleration of free flight and its standard uncertainty, m/s².
    """
    found: list[ShakenFlight] = []
    for length in LENGTHS_S:
        age, way = stretch(0.0, length)
        if age.size < 6 + MINIMUM_FREEDOM:
            break
        fit = _fit(age, way, sigma, slowing, u_slowing)
        if fit is None:
            if found:
                break
            continue
        found.append(fit)
        if len(found) == 2:  # the last millisecond of the longest stretch may hold an unseen disturbance
            break
    return found[-1] if found else None


def _fit(age: Array, way: Array, sigma: float, slowing: float, u_slowing: float) -> ShakenFlight | None:
    prior = np.array([[0.0, 0.0, 1.0 / u_slowing, 0.0, 0.0]])
    target = np.append(way / sigma, slowing / u_slowing)

    def solve(frequency: float) -> tuple[Array, Array, float]:
        design = np.vstack([_design(age, frequency) / sigma, prior])
        coefficient = np.linalg.lstsq(design, target, rcond=None)[0]
        return design, coefficient, float(np.sum((target - design @ coefficient) ** 2))

    grid = np.arange(max(LOWEST_HZ, 1.0 / float(age.max())), HIGHEST_HZ, STEP_HZ)
    best = int(np.argmin([solve(float(f))[2] for f in grid]))
    fine = grid[best] + np.linspace(0.0 if best == 0 else -STEP_HZ, STEP_HZ, 41)
    frequency = float(fine[int(np.argmin([solve(float(f))[2] for f in fine]))])
    design, coefficient, cost = solve(frequency)
    freedom = age.size + 1 - 6
    if cost / freedom > 1 + 3 * np.sqrt(2 / freedom):
        return None
    turn = 2 * np.pi * frequency * age
    slope = 2 * np.pi * age * (coefficient[4] * np.cos(turn) - coefficient[3] * np.sin(turn))
    design = np.column_stack([design, np.append(slope / sigma, 0.0)])
    covariance = np.linalg.pinv(design.T @ design)
    note = f"flight fitted with a vibration of {frequency:.0f} Hz over {1e3 * age.max():.0f} ms"
    return ShakenFlight(float(coefficient[1]), float(np.sqrt(covariance[1, 1])), frequency, note)
