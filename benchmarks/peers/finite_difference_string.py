"""A hammer on a stiff, lossy string by explicit finite differences, compiled: the peer of the string of modes.

The scheme of A. Chaigne and A. Askenfelt, J. Acoust. Soc. Am. 95 (1994) 1112, of second order, with the loss law of
the model (b1 + b2 k^2; its second part one step back, as there) and the hammer's force spread over the two points
beside its place. The grid is the finest that is stable at the step.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from model.string import Hammer, String

Array = NDArray[np.float64]


def points_at(string: String, step_s: float) -> int:
    """Most intervals of the grid that are stable at a step, s."""
    c2 = string.tension_n * string.length_m / string.mass_kg
    stiff = c2 * string.length_m**2 * string.stiffness
    first = c2 * step_s**2 + 4.0 * string.b2_m2_per_s * step_s
    least = math.sqrt(0.5 * (first + math.sqrt(first**2 + 16.0 * stiff * step_s**2)))
    return int(string.length_m / least / 1.001)


def blow(string: String, hammer: Hammer, speed: float, seconds: float, steps: int) -> tuple[Array, Array]:
    """Force (steps + 1,), N, and speed of the hammer (steps + 1,), m/s, of a felt that follows a power law."""
    step = seconds / steps
    points = points_at(string, step)
    c2 = string.tension_n * string.length_m / string.mass_kg
    numbers = (
        c2, c2 * string.length_m**2 * string.stiffness, string.b1_per_s, string.b2_m2_per_s,
        string.mass_kg / string.length_m, string.length_m / points, string.struck_at * points,
        hammer.mass_kg, hammer.k, hammer.p, speed, step,
    )  # fmt: skip
    return _march(numbers, points, steps)


@njit(cache=False)
def _march(numbers, points, steps):  # type: ignore[no-untyped-def]
    c2, stiff, b1, b2, density, h, place, mass, k, p, speed, dt = numbers
    before, now, after = np.zeros(points + 5), np.zeros(points + 5), np.zeros(points + 5)  # two ghosts at each end
    force, speeds = np.zeros(steps + 1), np.empty(steps + 1)
    left = int(place)
    part = place - left
    z0, z1 = 0.0, speed * dt
    speeds[0] = speed
    wave, bend, old = c2 * dt * dt / (h * h), stiff * dt * dt / h**4, 2.0 * b2 * dt / (h * h)
    lead = 1.0 / (1.0 + b1 * dt)
    for n in range(1, steps + 1):
        depth = z1 - (1.0 - part) * now[left + 2] - part * now[left + 3]
        f = k * depth**p if depth > 0.0 else 0.0
        force[n] = f
        for i in range(3, points + 2):
            second = now[i + 1] - 2.0 * now[i] + now[i - 1]
            fourth = now[i + 2] - 4.0 * now[i + 1] + 6.0 * now[i] - 4.0 * now[i - 1] + now[i - 2]
            lag = before[i + 1] - 2.0 * before[i] + before[i - 1]
            after[i] = 2.0 * now[i] - (1.0 - b1 * dt) * before[i] + wave * second - bend * fourth + old * (second - lag)
        push = dt * dt * f / (density * h)
        after[left + 2] += (1.0 - part) * push
        after[left + 3] += part * push
        for i in range(3, points + 2):
            after[i] *= lead
        after[1], after[points + 3] = -after[3], -after[points + 1]  # pinned: odd about the ends
        z2 = 2.0 * z1 - z0 - dt * dt * f / mass
        speeds[n] = (z2 - z0) / (2.0 * dt)
        z0, z1 = z1, z2
        before, now, after = now, after, before
    return force, speeds
