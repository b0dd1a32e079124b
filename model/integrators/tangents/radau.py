"""One Radau IIA step of the tangents, and its error estimate.

With sigma = dq/dp and nu = dv/dp the motion's equations M a = f give, linear in both and exact along the motion,

    sigma' = nu,    M nu' = K sigma + D nu + load,    load = d(f - M a)/dp at a fixed motion.

The values of nu' at the nodes of a step solve one linear system, the same for all parameters, which stand side by side
in lanes; what felt and string remember is eliminated from it (`channels`).
Of five nodes, order nine: chosen by error against time (docs/explanation/sensitivities.md).
"""

from math import isfinite
from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.tangents.channels import (
    METHOD,
    STAGES,
    add_channel_coupling,
    add_known_forces,
    channel_start,
    predict_free_channels,
    prepare_channels,
)
from model.integrators.tangents.linearised_nodes import SPACE
from model.kernels.compile import inlined, uncounted_loop
from model.kernels.lanes import LANES, broadcast_like, rows


@inlined
def factor(space, n):
    """Factor the first ``n`` rows and columns of ``space.matrix`` into LU; return False where it is singular.

    The upper one in place, inverses of the diagonal and the lower one in ``lower``, exchanges of rows in ``order``.
    """
    a, lower, order = space.matrix, space.lower, space.order
    width = a.shape[1] // LANES
    used = -(-n // LANES)
    row = rows(a, LANES)
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
            for j in range(k):
                lower[k, j], lower[best, j] = lower[best, j], lower[k, j]
            for j in range(k // LANES, used):
                row[k * width + j], row[best * width + j] = row[best * width + j], row[k * width + j]
        inverse = 1.0 / a[k, k]
        lower[k, k] = inverse
        for i in range(k + 1, n):
            x = a[i, k] * inverse
            lower[i, k] = x
            if x != 0.0:
                for j in range(k // LANES, used):
                    row[i * width + j] = row[i * width + j] - x * row[k * width + j]
                a[i, k] = 0.0  # what is left of the pivot in row k stays zero, so that whole lanes can be taken
    return True


@inlined
def substitute(space, n, x, first, blocks):
    """Replace ``n`` rows of ``x`` from ``first`` on, ``blocks`` apart, in the factors' order, by the solution with the
    factors."""
    a, lower = space.matrix, space.lower
    for i in range(n):
        sum_ = x[first + i * blocks]
        for j in range(i):
            sum_ = sum_ - lower[i, j] * x[first + j * blocks]
        x[first + i * blocks] = sum_
    for i in range(n - 1, -1, -1):
        sum_ = x[first + i * blocks]
        for j in range(i + 1, n):
            sum_ = sum_ - a[i, j] * x[first + j * blocks]
        x[first + i * blocks] = sum_ * lower[i, i]


@inlined
def substitute_four(space, n, x, first, blocks):
    """Replace four blocks of ``n`` rows of ``x`` from ``first`` on by their solutions with the factors, computed
    together for speed."""
    a, lower = space.matrix, space.lower
    for i in range(n):
        k = first + i * blocks
        s0, s1, s2, s3 = x[k], x[k + 1], x[k + 2], x[k + 3]
        for j in range(i):
            k = first + j * blocks
            y = lower[i, j]
            s0, s1, s2, s3 = s0 - y * x[k], s1 - y * x[k + 1], s2 - y * x[k + 2], s3 - y * x[k + 3]
        k = first + i * blocks
        x[k], x[k + 1], x[k + 2], x[k + 3] = s0, s1, s2, s3
    for i in range(n - 1, -1, -1):
        k = first + i * blocks
        s0, s1, s2, s3 = x[k], x[k + 1], x[k + 2], x[k + 3]
        for j in range(i + 1, n):
            k = first + j * blocks
            y = a[i, j]
            s0, s1, s2, s3 = s0 - y * x[k], s1 - y * x[k + 1], s2 - y * x[k + 2], s3 - y * x[k + 3]
        k = first + i * blocks
        y = lower[i, i]
        x[k], x[k + 1], x[k + 2], x[k + 3] = s0 * y, s1 * y, s2 * y, s3 * y


NODES, LAGRANGE, ONCE, TWICE, FILTER, ESTIMATE_RISE, ESTIMATE_ONCE, ESTIMATE_TWICE = METHOD


class TangentOutputs(NamedTuple):
    """Increasing times (m,) of the outputs, where each goes in ``angle`` and ``speed`` (m, n, P); what errors are
    measured by; longest step.

    ``floor`` (2, P') is the least value that counts, of angles' and of speeds' derivatives; ``channel`` (m, C, P') is
    for those of what felt and string remember, or (0, C, P'): P' are columns filled up to lanes.
    """

    time: np.ndarray
    row: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    channel: np.ndarray
    tolerance: float
    floor: np.ndarray
    stride: int  # steps of the motion that one may span


_f, _i = types.float64, types.int64
_numbers, _table, _cube = (types.Array(_f, k, "C") for k in (1, 2, 3))
WANTED = types.NamedTuple([_numbers, types.Array(_i, 1, "C"), *[_cube] * 3, _f, _table, _i], TangentOutputs)
SOLVE_STEP = types.boolean(_f, _cube, SPACE)
ESTIMATED_ERROR = _f(_f, _cube, WANTED, SPACE)
AT_FRACTION = types.void(_f, _f, _cube, SPACE, _table, _table)


@uncounted_loop(SOLVE_STEP)
def solve_step(h, tangent, space):
    """Fill ``space.slopes`` with the accelerations' derivatives by the parameters at the nodes of a step of ``h``, s,
    from ``tangent`` (2, n, P); False where the matrix is singular."""
    n = tangent.shape[1]
    blocks = tangent.shape[2] // LANES
    a, order = space.matrix, space.order
    for m in range(STAGES):
        for c in range(STAGES):
            once, twice = -h * ONCE[m, c], -h * h * TWICE[m, c]
            for i in range(n):
                for j in range(n):
                    x = once * space.damp[m + 1, i, j] + twice * space.stiff[m + 1, i, j]
                    a[n * m + i, n * c + j] = x + space.mass[m + 1, i, j] if c == m else x
    channels = space.channels
    if channels.many.shape[0] > 0:
        prepare_channels(h, channels)
        add_channel_coupling(h, n, a, channels)
        predict_free_channels(h, tangent, space.carried, channels)
    if not factor(space, STAGES * n):
        return False
    sigma, load, slopes = rows(tangent, LANES), rows(space.load, LANES), rows(space.slopes, LANES)
    nu = n * blocks
    for row in range(STAGES * n):
        m, i = order[row] // n, order[row] % n
        for b in range(blocks):
            sum_ = load[((m + 1) * n + i) * blocks + b]
            for j in range(n):
                stiff, damp = space.stiff[m + 1, i, j], space.damp[m + 1, i, j]
                k = j * blocks + b
                if stiff != 0.0 or damp != 0.0:
                    sum_ = sum_ + stiff * sigma[k] + (stiff * h * NODES[m] + damp) * sigma[nu + k]
            slopes[row * blocks + b] = sum_
    if channels.many.shape[0] > 0:
        for row in range(STAGES * n):
            space.row_of[order[row]] = row
        add_known_forces(n, space.row_of, space.slopes, channels)
    whole = blocks - blocks % 4
    for b in range(0, whole, 4):
        substitute_four(space, STAGES * n, slopes, b, blocks)
    for b in range(whole, blocks):
        substitute(space, STAGES * n, slopes, b, blocks)
    return True


@uncounted_loop(ESTIMATED_ERROR)
def estimate_error(h, tangent, wanted, space):
    """Return the largest error of a step ``h``, s, in any column of ``tangent`` over its tolerance, by a method of
    lower order, 1e300 where that cannot be solved; overwrites the factors in ``space``, whose ``slopes`` are those of
    the step."""
    n = tangent.shape[1]
    blocks = tangent.shape[2] // LANES
    a, order = space.matrix, space.order
    g = FILTER * h
    for i in range(n):
        for j in range(n):
            a[i, j] = space.mass[0, i, j] - g * space.damp[0, i, j] - g * g * space.stiff[0, i, j]
    if not factor(space, n):
        return 1e300
    sigma, load, slopes = rows(tangent, LANES), rows(space.load, LANES), rows(space.slopes, LANES)
    error, floor, largest = rows(space.error, LANES), rows(wanted.floor, LANES), rows(space.largest, LANES)
    nu = n * blocks
    worst = broadcast_like(0.0, sigma[0])
    for b in range(blocks):
        # of angles in the upper half; in the lower M times that of speeds, solved for below
        for i in range(n):
            rise = h * ESTIMATE_RISE * sigma[nu + i * blocks + b]
            for c in range(STAGES):
                rise = rise + h * h * ESTIMATE_TWICE[c] * slopes[(n * c + i) * blocks + b]
            error[i * blocks + b] = rise
        for row in range(n):
            i = order[row]
            sum_ = g * load[i * blocks + b]
            for j in range(n):
                k = j * blocks + b
                stiff, damp, mass = space.stiff[0, i, j], space.damp[0, i, j], space.mass[0, i, j]
                if stiff != 0.0 or damp != 0.0:
                    sum_ = sum_ + (g * stiff) * (sigma[k] + error[k]) + (g * damp) * sigma[nu + k]
                if mass != 0.0:
                    for c in range(STAGES):
                        sum_ = sum_ + (h * mass * ESTIMATE_ONCE[c]) * slopes[(n * c + j) * blocks + b]
            for c in range(space.channels.many.shape[0]):
                for k in range(space.channels.many[c]):
                    if space.channels.links[c, k] == i and space.channels.push[0, c, k] != 0.0:
                        sum_ = sum_ + (g * space.channels.push[0, c, k]) * channel_start(c, b, space.channels)
            error[(n + row) * blocks + b] = sum_
        substitute(space, n, error, n * blocks + b, blocks)
        for i in range(n):
            k = i * blocks + b
            angle = error[k] + g * error[nu + k]
            worst = max(worst, abs(angle) / max(largest[k], floor[b]))
            worst = max(worst, abs(error[nu + k]) / max(largest[nu + k], floor[blocks + b]))
    error[0] = worst
    out = 0.0
    for lane in range(LANES):
        x = space.error[0, lane]
        out = max(out, x) if isfinite(x) else 1e300
    return out / wanted.tolerance


@uncounted_loop(AT_FRACTION)
def interpolate_step(x, h, tangent, space, angle, speed):
    """Fill ``angle``, ``speed`` (n, P) with their derivatives by the parameters at the share ``x`` (0 to 1) of a step;
    overwrite ``space.weights``.

    ``h`` is the step, s. ``tangent`` (2, n, P) holds the derivatives at its start, ``space.slopes`` those of the
    accelerations at its nodes, as `solve_step` left them.
    """
    n = tangent.shape[1]
    blocks = tangent.shape[2] // LANES
    sigma, slopes = rows(tangent, LANES), rows(space.slopes, LANES)
    out_angle, out_speed = rows(angle, LANES), rows(speed, LANES)
    weights = space.weights
    for c in range(STAGES):
        once = 0.0
        twice = 0.0
        for k in range(STAGES - 1, -1, -1):
            once = once * x + LAGRANGE[c, k] / (k + 1.0)
            twice = twice * x + LAGRANGE[c, k] / ((k + 1.0) * (k + 2.0))
        weights[c, 0] = h * x * once
        weights[c, 1] = h * h * x * x * twice
    for i in range(n):
        for b in range(blocks):
            k = i * blocks + b
            nu = sigma[n * blocks + k]
            sum_angle = sigma[k] + (x * h) * nu
            sum_speed = nu
            for c in range(STAGES):
                slope = slopes[(n * c + i) * blocks + b]
                sum_speed = sum_speed + weights[c, 0] * slope
                sum_angle = sum_angle + weights[c, 1] * slope
            out_angle[k] = sum_angle
            out_speed[k] = sum_speed
