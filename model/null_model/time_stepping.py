"""Time stepping of the null model, compiled: key and hammer, the hammer riding, flying or caught.

Rows are (s, w, phi, omega, riding): the key's turn and speed, the hammer's turn above its rest and its speed, 1 where
it rides. Classical Runge-Kutta at a fixed step; an event takes effect at the end of its step. All compiled code is in
this one file, which numba's disk cache watches as a whole.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.kernels.compile import inlined, kernel

Array = NDArray[np.float64]

RIDING, FLYING, CAUGHT = 0, 1, 2
MASS, PULL, LEVER, DRY, DAMP, ANGLE, RATIO = range(7)  # columns of a path's table; the last two are the hammer's


class Constants(NamedTuple):
    """Numbers of an action that time stepping needs beside the tables."""

    # start, per_rad: first place of the tables, rad, and rows per rad
    start: float
    per_rad: float
    omega_t: float  # threshold speed of friction, rad/s
    weight: float  # of the hammer, N
    # centre_x, centre_y: of the hammer's mass from its pivot, m
    centre_x: float
    centre_y: float
    damping: float  # of the string's felt, s/m
    reach: float  # of the hammer's head from its pivot, m
    # rest, up: angle of the hammer at rest, and the sense (+1 or -1) towards the string
    rest: float
    up: float
    inertia: float  # of the hammer about its pivot, kg m^2
    string: float  # turn from rest to the string, rad
    let_off: float  # place of the key at which the jack meets the button


def restitution(speed_m_per_s: float, damping: float) -> float:
    """Rebound speed over impact speed, 0 to 1, of a mass that meets felt of force F = g(x)(1 + D dx/dt) at
    ``speed_m_per_s``, m/s; ``damping``: D, s/m.

    From v dv/dx = -g(x)(1 + D v)/m both ways, v/D - log(1 + D v)/D^2 is the same in and out whatever g and m are.

    Parameters
    ----------
    speed_m_per_s : impact speed
    damping : D, s/m

    Returns
    -------
    float
        From 0 to 1.

    Examples
    --------
    >>> import model
    >>> print(f"{model.null_model.restitution(2.0, 0.45):.2f}")
    0.62
    """
    return float(_restitution(speed_m_per_s, damping))


@kernel
def _restitution(speed_m_per_s: float, damping: float) -> float:
    """Rebound speed over impact speed (m/s) of a mass on felt with the damping factor ``damping`` (s/m)."""
    z = damping * speed_m_per_s
    if z < 1e-6:
        return 1.0 - 2.0 / 3.0 * z
    wanted = z - math.log1p(z)
    low, high = 0.0, min(z, 1.0)  # of the rebound's own D v, which felt that only pushes keeps below 1
    for _ in range(50):
        middle = 0.5 * (low + high)
        if -middle - math.log1p(-middle) < wanted:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high) / z


@inlined
def _acceleration(table: Array, n: Constants, s: float, w: float, force: float, load: float) -> float:
    """s'' (rad/s^2) at ``s``, ``w`` on one path, ``table``, under ``force`` (N) on the key and ``load`` (N m) on the
    coordinate."""
    x = (s - n.start) * n.per_rad
    i = min(max(int(x), 0), len(table) - 2)
    a, b = table[i], table[i + 1]
    y = x - i
    pull = a[PULL] + y * (b[PULL] - a[PULL])  # beyond the ends felt goes on as it did before them
    turning = 0.5 * (b[MASS] - a[MASS]) * n.per_rad * w * w if 0.0 <= y <= 1.0 else 0.0
    y = min(max(y, 0.0), 1.0)
    friction = (a[DRY] + y * (b[DRY] - a[DRY])) * math.tanh(w / n.omega_t) + (a[DAMP] + y * (b[DAMP] - a[DAMP])) * w
    driven = pull + load + (a[LEVER] + y * (b[LEVER] - a[LEVER])) * force - turning - friction
    return driven / (a[MASS] + y * (b[MASS] - a[MASS]))


@inlined
def _interpolate(table: Array, n: Constants, s: float, column: int) -> float:
    """One column of a path's table at ``s``, held beyond its ends."""
    x = (s - n.start) * n.per_rad
    i = min(max(int(x), 0), len(table) - 2)
    y = min(max(x - i, 0.0), 1.0)
    return table[i, column] + y * (table[i + 1, column] - table[i, column])


@inlined
def _runge_kutta_step(
    table: Array, n: Constants, s: float, w: float, h: float, force: Array, k: int, load: float
) -> tuple[float, float]:
    """One step ``h`` of the classical Runge-Kutta method for (s, w) on one path; rows k, k + 1, k + 2 of ``force`` are
    at its start, middle and end."""
    a1 = _acceleration(table, n, s, w, force[k], load)
    w2 = w + 0.5 * h * a1
    a2 = _acceleration(table, n, s + 0.5 * h * w, w2, force[k + 1], load)
    w3 = w + 0.5 * h * a2
    a3 = _acceleration(table, n, s + 0.5 * h * w2, w3, force[k + 1], load)
    w4 = w + h * a3
    a4 = _acceleration(table, n, s + h * w3, w4, force[k + 2], load)
    return s + h * (w + 2.0 * (w2 + w3) + w4) / 6.0, w + h * (a1 + 2.0 * (a2 + a3) + a4) / 6.0


@inlined
def _gravity(n: Constants, phi: float) -> float:
    """Torque of the hammer's weight towards the string, N m."""
    angle = n.rest + n.up * phi
    return -n.up * n.weight * (math.cos(angle) * n.centre_x - math.sin(angle) * n.centre_y)


@kernel
def integrate(
    joined: Array, away: Array, check: Array, n: Constants, s: float, h: float, force: Array, rows: Array
) -> None:
    """Fill ``rows`` (m, 5): key turn, rate, hammer turn, rate, 1 where it rides; from key turn ``s`` (rad) at rest in
    steps ``h`` (s), under ``force`` (2 m - 1,), N, at half steps. ``joined``, ``away`` (p, 7): paths; ``check`` (p,).
    """
    w, mode, jack_out = 0.0, RIDING, False
    phi, omega = n.up * (_interpolate(joined, n, s, ANGLE) - n.rest), 0.0
    for k in range(len(rows)):
        rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3], rows[k, 4] = s, w, phi, omega, 1.0 if mode == RIDING else 0.0
        if k + 1 == len(rows):
            break
        if mode == RIDING:
            before = omega
            s, w = _runge_kutta_step(joined, n, s, w, h, force, 2 * k, 0.0)
            phi = n.up * (_interpolate(joined, n, s, ANGLE) - n.rest)
            omega = n.up * _interpolate(joined, n, s, RATIO) * w
            pushed = n.inertia * (omega - before) / h - _gravity(n, phi)
            if s >= n.let_off:
                mode, jack_out = FLYING, True
            elif pushed < 0.0:
                mode = FLYING
        else:
            load = 0.0
            if mode == CAUGHT:
                load = _gravity(n, phi) * n.up * _interpolate(joined, n, s, RATIO)
            s, w = _runge_kutta_step(away, n, s, w, h, force, 2 * k, load)
            if mode == FLYING:
                turn = _gravity(n, phi + 0.5 * h * omega) / n.inertia
                above = phi
                phi += h * (omega + 0.5 * h * turn)
                omega += h * turn
                caught = check[min(max(round((s - n.start) * n.per_rad), 0), len(check) - 1)]
                if jack_out and omega < 0.0 and phi <= caught <= above:
                    phi, omega, mode = caught, 0.0, CAUGHT
            if s >= n.let_off:
                jack_out = True
            ratio = n.up * _interpolate(joined, n, s, RATIO)
            path, along = n.up * (_interpolate(joined, n, s, ANGLE) - n.rest), ratio * w
            if jack_out and s < n.let_off:
                jack_out, mode = False, FLYING  # what was held up falls on, or meets the jack at once
            if jack_out and phi <= path:  # lies on the repetition lever, about as high as the jack carried it
                phi = path
                if omega <= 0.0:
                    omega, mode = 0.0, CAUGHT
            if not jack_out and phi <= path:  # comes down on the jack: both go on with the angular momentum they have
                if omega <= along:
                    alone = _interpolate(away, n, s, MASS)
                    w = (alone * w + n.inertia * ratio * omega) / (alone + n.inertia * ratio**2)
                    mode, omega = RIDING, ratio * w
                phi = path
        if phi >= n.string and omega > 0.0:
            omega *= -_restitution(omega * n.reach, n.damping)
            phi, mode = n.string, FLYING
