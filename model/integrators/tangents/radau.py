"""One step of Radau's method of order five for the tangents of a motion, and the estimate of its error.

With sigma = dq/dp and nu = dv/dp the motion's equations M a = f give, linear in both and exact along the motion,

    sigma' = nu,    M nu' = K sigma + D nu + M alpha,    alpha = da/dp at a fixed state.

The three values of nu' of a step solve one linear system, the same for all parameters, which stand side by side in
lanes. Method and error estimate: Hairer and Wanner, Solving Ordinary Differential Equations II, Sections IV.5, IV.8.
"""

from math import isfinite, sqrt
from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.tangents.nodes import LANES, SPACE
from model.kernels.compile import inlined, step_loop
from model.kernels.lanes.operations import filled, rows

R6 = sqrt(6.0)
NODES = np.array([(4.0 - R6) / 10.0, (4.0 + R6) / 10.0, 1.0])
ONCE = np.array(
    [
        [(88.0 - 7.0 * R6) / 360.0, (296.0 - 169.0 * R6) / 1800.0, (-2.0 + 3.0 * R6) / 225.0],
        [(296.0 + 169.0 * R6) / 1800.0, (88.0 + 7.0 * R6) / 360.0, (-2.0 - 3.0 * R6) / 225.0],
        [(16.0 - R6) / 36.0, (16.0 + R6) / 36.0, 1.0 / 9.0],
    ]
)  # weights of nu' in nu at the nodes
TWICE = ONCE @ ONCE  # and in sigma
FILTER = 0.2748888295956774  # the inverse of the real eigenvalue of the inverse of ONCE
_ESTIMATE = FILTER / 3.0 * np.array([-13.0 - 7.0 * R6, -13.0 + 7.0 * R6, -1.0])
ESTIMATE_RISE = FILTER + float(_ESTIMATE @ NODES)
ESTIMATE_ONCE, ESTIMATE_TWICE = _ESTIMATE @ ONCE, _ESTIMATE @ TWICE


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
AT_FRACTION = types.void(_f, _f, _cube, SPACE, _table, _table)


@inlined
def factor(a, n, order):
    """Factors of the first ``n`` rows and columns in place, rows exchanged as ``order`` says; False where singular."""
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
                x = a[i, k] * a[k, k]
                a[i, k] = x
                for j in range(k + 1, n):
                    a[i, j] -= x * a[k, j]
    return True


@inlined
def substitute(a, n, x, first, blocks):
    """Solve with the factors ``a`` for ``n`` rows of lanes, ``blocks`` apart, in place and in the factors' order."""
    for i in range(n):
        sum_ = x[first + i * blocks]
        for j in range(i):
            sum_ = sum_ - a[i, j] * x[first + j * blocks]
        x[first + i * blocks] = sum_
    for i in range(n - 1, -1, -1):
        sum_ = x[first + i * blocks]
        for j in range(i + 1, n):
            sum_ = sum_ - a[i, j] * x[first + j * blocks]
        x[first + i * blocks] = sum_ * a[i, i]


@step_loop(SOLVE_STEP)
def solve_step(h, tangent, space):
    """Fill ``space.slopes`` with nu' at the three nodes of a step of ``h`` from ``tangent``; False where it cannot."""
    n = tangent.shape[1]
    blocks = tangent.shape[2] // LANES
    a, order = space.matrix, space.order
    for m in range(3):
        for c in range(3):
            once, twice = -h * ONCE[m, c], -h * h * TWICE[m, c]
            for i in range(n):
                for j in range(n):
                    x = once * space.damp[m + 1, i, j] + twice * space.stiff[m + 1, i, j]
                    a[n * m + i, n * c + j] = x + space.mass[m + 1, i, j] if c == m else x
    if not factor(a, 3 * n, order):
        return False
    sigma, alpha, slopes = rows(tangent, LANES), rows(space.alpha, LANES), rows(space.slopes, LANES)
    nu = n * blocks
    for row in range(3 * n):
        m, i = order[row] // n, order[row] % n
        at_alpha = (m + 1) * n * blocks
        for b in range(blocks):
            sum_ = filled(0.0, sigma[b])
            for j in range(n):
                stiff, damp, mass = space.stiff[m + 1, i, j], space.damp[m + 1, i, j], space.mass[m + 1, i, j]
                k = j * blocks + b
                if stiff != 0.0 or damp != 0.0:
                    sum_ = sum_ + stiff * sigma[k] + (stiff * h * NODES[m] + damp) * sigma[nu + k]
                if mass != 0.0:
                    sum_ = sum_ + mass * alpha[at_alpha + k]
            slopes[row * blocks + b] = sum_
    for b in range(blocks):
        substitute(a, 3 * n, slopes, b, blocks)
    return True


@step_loop(ESTIMATED_ERROR)
def estimated_error(h, tangent, wanted, space):
    """The error of a step, of what is allowed in any column: the difference from a method of order three."""
    n = tangent.shape[1]
    blocks = tangent.shape[2] // LANES
    a, order = space.matrix, space.order
    g = FILTER * h
    for i in range(n):
        for j in range(n):
            a[i, j] = space.mass[0, i, j] - g * space.damp[0, i, j] - g * g * space.stiff[0, i, j]
    if not factor(a, n, order):
        return 1e300
    sigma, alpha, slopes = rows(tangent, LANES), rows(space.alpha, LANES), rows(space.slopes, LANES)
    error, floor, largest = rows(space.error, LANES), rows(wanted.floor, LANES), rows(space.largest, LANES)
    nu = n * blocks
    worst = filled(0.0, sigma[0])
    for b in range(blocks):
        # of angles in the upper half; in the lower M times that of speeds, solved for below
        for i in range(n):
            rise = h * ESTIMATE_RISE * sigma[nu + i * blocks + b]
            for c in range(3):
                rise = rise + h * h * ESTIMATE_TWICE[c] * slopes[(n * c + i) * blocks + b]
            error[i * blocks + b] = rise
        for row in range(n):
            i = order[row]
            sum_ = filled(0.0, worst)
            for j in range(n):
                k = j * blocks + b
                stiff, damp, mass = space.stiff[0, i, j], space.damp[0, i, j], space.mass[0, i, j]
                if stiff != 0.0 or damp != 0.0:
                    sum_ = sum_ + (g * stiff) * (sigma[k] + error[k]) + (g * damp) * sigma[nu + k]
                if mass != 0.0:
                    sum_ = sum_ + (g * mass) * alpha[k]
                    for c in range(3):
                        sum_ = sum_ + (h * mass * ESTIMATE_ONCE[c]) * slopes[(n * c + j) * blocks + b]
            error[(n + row) * blocks + b] = sum_
        substitute(a, n, error, n * blocks + b, blocks)
        for i in range(n):
            k = i * blocks + b
            angle = error[k] + g * error[nu + k]
            worst = max(worst, abs(angle) / max(largest[k], floor[b]))
            worst = max(worst, abs(error[nu + k]) / max(largest[nu + k], floor[blocks + b]))
    error[0] = worst
    out = 0.0
    for lane in range(LANES):
        x = space.error.ravel()[lane]
        out = max(out, x) if isfinite(x) else 1e300
    return out / wanted.tolerance


@step_loop(AT_FRACTION)
def at_fraction(x, h, tangent, space, angle, speed):
    """Derivatives of angles and speeds (n, P) at the fraction ``x`` of a step, on the polynomial through its nodes."""
    n = tangent.shape[1]
    blocks = tangent.shape[2] // LANES
    sigma, slopes = rows(tangent, LANES), rows(space.slopes, LANES)
    out_angle, out_speed = rows(angle, LANES), rows(speed, LANES)
    weights = np.empty((3, 2))
    for c in range(3):
        r, s = NODES[(c + 1) % 3], NODES[(c + 2) % 3]
        scale = h / ((NODES[c] - r) * (NODES[c] - s))
        weights[c, 0] = scale * x * (x * x / 3.0 - 0.5 * (r + s) * x + r * s)
        weights[c, 1] = scale * h * x * x * (x * x / 12.0 - (r + s) * x / 6.0 + 0.5 * r * s)
    for i in range(n):
        for b in range(blocks):
            k = i * blocks + b
            nu = sigma[n * blocks + k]
            sum_angle = sigma[k] + (x * h) * nu
            sum_speed = nu
            for c in range(3):
                slope = slopes[(n * c + i) * blocks + b]
                sum_speed = sum_speed + weights[c, 0] * slope
                sum_angle = sum_angle + weights[c, 1] * slope
            out_angle[k] = sum_angle
            out_speed[k] = sum_speed
