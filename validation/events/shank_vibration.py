"""A flying hammer whose shank vibrates: rigid flight and one damped vibration fitted together.

Conventions: speed and way are those of the rigid flight, without the vibration. The encoder sits at the
butt, and in free flight a light butt swings against a heavy head: the head itself stays on the rigid path within
`HEAD_SHARE` of the vibration, which is stated as uncertainty.
Source: thesis Section 4.1, which saw the head vibrate on its shank; the first bending mode of a hammer shank lies at
some hundreds of hertz, so that a 2 ms line holds only half a period of it and its slope is wrong by up to the
vibration's own speed. At least one whole period must lie in the flight, so that a push is not taken for one; the
deceleration of free flight and the damping enter as measurements with their uncertainty, which keeps the fit
determined. The two parameters that are not linear are found on a grid and refined on ever smaller stencils.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from validation.conventions import Array

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


@dataclass(frozen=True)
class ShakenFlight:
    """Rigid flight at age 0: way (m), speed (m/s) and deceleration (m/s²), with u of way and speed; the vibration."""

    way: float
    u_way: float
    speed: float
    u_speed: float
    slowing: float
    frequency_hz: float
    note: str


def is_seen(age: Array, residual: Array, sigma: float) -> bool:
    """Whether what a rigid flight leaves holds a vibration that a chi-square of all samples overlooks."""
    turn = np.exp(2j * np.pi * TEST_HZ[:, None] * age)
    power = 2 * np.abs(turn @ (residual / sigma)) ** 2 / age.size
    return bool(power.max() > SEEN)


def fit_vibration(stretch: Stretch, sigma: float, slowing: float, u_slowing: float, side: int) -> ShakenFlight | None:
    """Fit the longest stretch that rigid flight and one vibration describe; None when there is none of 3 to 6 ms.

    Parameters
    ----------
    stretch : callable
        Gives ages and ways between two ages.
    sigma : float
        Standard uncertainty of one sample, m.
    slowing, u_slowing : float
        Deceleration of free flight and its standard uncertainty, m/s².
    side : int
        −1 before the contact, where the vibration dies away towards age 0; +1 after it.
    """
    found: list[ShakenFlight] = []
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


def _fit(age: Array, way: Array, sigma: float, prior: tuple[float, float], side: int) -> ShakenFlight | None:
    rigid = np.column_stack([np.ones(age.size), age, age**2 / 2])
    slowing, u_slowing = prior

    def solve(frequency: Array, damping: Array) -> tuple[Array, Array]:
        """Coefficients and cost at each frequency and damping: rigid flight, cosine, sine."""
        designs = np.concatenate(
            [np.broadcast_to(rigid, (frequency.size, *rigid.shape)), _vibration(age, frequency, damping, side)], axis=2
        )
        normal = np.swapaxes(designs, 1, 2) @ designs / sigma**2
        normal[:, 2, 2] += u_slowing**-2
        target = np.swapaxes(designs, 1, 2) @ way / sigma**2
        target[:, 2] += slowing / u_slowing**2
        scale = np.sqrt(np.einsum("kii->ki", normal))
        found = np.linalg.solve(normal / (scale[:, :, None] * scale[:, None, :]), (target / scale)[:, :, None])
        coefficient = found[:, :, 0] / scale
        cost = np.sum((way - (designs @ coefficient[:, :, None])[:, :, 0]) ** 2, axis=1) / sigma**2
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
    return ShakenFlight(
        float(coefficient[0]),
        float(np.hypot(np.sqrt(covariance[0, 0]), HEAD_SHARE * amplitude)),
        float(coefficient[1]),
        float(np.hypot(np.sqrt(covariance[1, 1]), HEAD_SHARE * amplitude * 2 * np.pi * frequency)),
        float(coefficient[2]),
        frequency,
        note,
    )


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
