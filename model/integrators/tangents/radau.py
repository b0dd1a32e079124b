"""One step of Radau's method of order five for the tangents of a motion, and the estimate of its error.

With sigma = dq/dp and nu = dv/dp the motion's equations M a = f give, linear in both and exact along the motion,

    sigma' = nu,    M nu' = K sigma + D nu + M alpha,    alpha = da/dp at a fixed state.

The three values of nu' of a step solve one linear system, the same for all parameters. Method and error estimate:
Hairer and Wanner, Solving Ordinary Differential Equations II, Sections IV.5 and IV.8.
"""

from math import isfinite, sqrt
from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.tangents.nodes import SPACE
from model.kernels.compile import inlined, step_loop

R6 = sqrt(6.0)
NODES = ((4.0 - R6) / 10.0, (4.0 + R6) / 10.0, 1.0)
WEIGHTS = (
    ((88.0 - 7.0 * R6) / 360.0, (296.0 - 169.0 * R6) / 1800.0, (-2.0 + 3.0 * R6) / 225.0),
    ((296.0 + 169.0 * R6) / 1800.0, (88.0 + 7.0 * R6) / 360.0, (-2.0 - 3.0 * R6) / 225.0),
    ((16.0 - R6) / 36.0, (16.0 + R6) / 36.0, 1.0 / 9.0),
)
FILTER = 0.2748888295956774  # the inverse of the real eigenvalue of WEIGHTS' inverse
ESTIMATE = (FILTER / 3.0 * (-13.0 - 7.0 * R6), FILTER / 3.0 * (-13.0 + 7.0 * R6), FILTER / 3.0 * -1.0)


class Wanted(NamedTuple):
    """Times (m,) of the outputs and their rows (m, n, P); what errors are measured by; longest step.

    ``floor`` (2, P) is the least value that counts, of angles' and of speeds' derivatives.
    """

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    tolerance: float
    floor: np.ndarray
    stride: int  # steps of the motion that one may span


_f, _i = types.float64, types.int64
_numbers, _table, _cube = (types.Array(_f, k, "C") for k in (1, 2, 3))
WANTED = types.NamedTuple([_numbers, _cube, _cube, _f, _table, _i], Wanted)
SOLVE_STEP = types.boolean(_f, _cube, SPACE)
ESTIMATED_ERROR = _f(_f, _cube, WANTED, SPACE)


@inlined
def factor(a, order):
    """Factors of a square matrix in place, rows exchanged as ``order`` says; False where it is singular."""
    n = a.shape[0]
    for i in range(n):
        order[i] = i
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        if not abs(a[best, k]) > 0.0:
            return False
        if best != k:
            order[k], order[best] = order[best], order[k]
            for j in range(n):
                a[k, j], a[best, j] = a[best, j], a[k, j]
        a[k, k] = 1.0 / a[k, k]
        for i in range(k + 1, n):
            if a[i, k] != 0.0:
                a[i, k] *= a[k, k]
                x = a[i, k]
                for j in range(k + 1, n):
                    a[i, j] -= x * a[k, j]
    return True


@inlined
def add_row(rows, i, x, others, j):
    """Add ``x`` times a row of ``others`` to a row of ``rows``."""
    if x != 0.0:
        for k in range(rows.shape[1]):
            rows[i, k] += x * others[j, k]


@inlined
def substitute(a, rows):
    """Solve with the factors ``a`` for right-hand sides ``rows`` (n, P), in place; rows are in the factors' order."""
    n = a.shape[0]
    for i in range(n):
        for j in range(i):
            add_row(rows, i, -a[i, j], rows, j)
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            add_row(rows, i, -a[i, j], rows, j)
        for k in range(rows.shape[1]):
            rows[i, k] *= a[i, i]


@step_loop(SOLVE_STEP)
def solve_step(h, tangent, space):
    """Fill ``space.slopes`` with nu' at the three nodes of a step of ``h`` from ``tangent``; False where it cannot."""
    n = space.alpha.shape[1]
    a, order, slopes = space.matrix, space.order, space.slopes
    sigma, nu = tangent[0], tangent[1]
    for m in range(3):
        for i in range(n):
            for c in range(3):
                twice = 0.0
                for k in range(3):
                    twice += WEIGHTS[m][k] * WEIGHTS[k][c]
                for j in range(n):
                    x = -h * WEIGHTS[m][c] * space.damp[m + 1, i, j] - h * h * twice * space.stiff[m + 1, i, j]
                    a[n * m + i, n * c + j] = x + space.mass[m + 1, i, j] if c == m else x
    if not factor(a, order):
        return False
    for row in range(3 * n):
        m, i = order[row] // n, order[row] % n
        for k in range(slopes.shape[1]):
            slopes[row, k] = 0.0
        for j in range(n):
            stiff = space.stiff[m + 1, i, j]
            add_row(slopes, row, stiff, sigma, j)
            add_row(slopes, row, stiff * h * NODES[m] + space.damp[m + 1, i, j], nu, j)
            add_row(slopes, row, space.mass[m + 1, i, j], space.alpha[m + 1], j)
    substitute(a, slopes)
    return True


@step_loop(ESTIMATED_ERROR)
def estimated_error(h, tangent, wanted, space):
    """The error of a step, of what is allowed in any column: the difference from a method of order three."""
    n = space.alpha.shape[1]
    sigma, nu = tangent[0], tangent[1]
    error, slopes = space.error, space.slopes
    a, order = space.matrix[:n, :n], space.order[:n]
    g = FILTER * h
    for i in range(n):
        for j in range(n):
            a[i, j] = space.mass[0, i, j] - g * space.damp[0, i, j] - g * g * space.stiff[0, i, j]
    if not factor(a, order):
        return 1e300
    # the difference itself: of angles in the upper half, M times that of speeds in the lower
    rises = 0.0
    for m in range(3):
        rises += ESTIMATE[m] * NODES[m]
    columns = error.shape[1]
    for i in range(n):
        for k in range(columns):
            error[i, k] = h * (FILTER + rises) * nu[i, k]
    for c in range(3):
        single = 0.0
        double = 0.0
        for m in range(3):
            single += ESTIMATE[m] * WEIGHTS[m][c]
            for k in range(3):
                double += ESTIMATE[m] * WEIGHTS[m][k] * WEIGHTS[k][c]
        for i in range(n):
            add_row(error, i, h * h * double, slopes, n * c + i)
    for row in range(n):
        i = order[row]
        for k in range(columns):
            error[n + row, k] = 0.0
        for j in range(n):
            stiff = space.stiff[0, i, j]
            add_row(error, n + row, g * stiff, sigma, j)
            add_row(error, n + row, g * space.damp[0, i, j], nu, j)
            add_row(error, n + row, g * space.mass[0, i, j], space.alpha[0], j)
            add_row(error, n + row, g * stiff, error, j)
            for c in range(3):
                single = 0.0
                for m in range(3):
                    single += ESTIMATE[m] * WEIGHTS[m][c]
                add_row(error, n + row, h * single * space.mass[0, i, j], slopes, n * c + j)
    substitute(a, error[n:])
    worst = 0.0
    for i in range(n):
        add_row(error, i, g, error, n + i)
    for half in range(2):
        for i in range(n * half, n * half + n):
            for k in range(columns):
                scale = max(space.largest[i, k], wanted.floor[half, k])
                worst = max(worst, abs(error[i, k]) / scale)
    return worst / wanted.tolerance if isfinite(worst) else 1e300


@inlined
def at_fraction(x, h, tangent, space, angle, speed):
    """Derivatives of angles and speeds (n, P) at the fraction ``x`` of a step, on the polynomial through its nodes."""
    n = space.alpha.shape[1]
    sigma, nu = tangent[0], tangent[1]
    for i in range(n):
        for k in range(angle.shape[1]):
            angle[i, k] = sigma[i, k] + x * h * nu[i, k]
            speed[i, k] = nu[i, k]
    for c in range(3):
        r, s = NODES[(c + 1) % 3], NODES[(c + 2) % 3]
        scale = 1.0 / ((NODES[c] - r) * (NODES[c] - s))
        once = scale * x * (x * x / 3.0 - 0.5 * (r + s) * x + r * s)
        twice = scale * x * x * (x * x / 12.0 - (r + s) * x / 6.0 + 0.5 * r * s)
        for i in range(n):
            add_row(speed, i, h * once, space.slopes, n * c + i)
            add_row(angle, i, h * h * twice, space.slopes, n * c + i)
