"""The compiled loops of the pose fit (numba); `fit_rigid` is called once per body and frame.

All loops and the named tuples they take stay in one file, because numba's disk cache only notices changes of the file
that holds the cached function: a compiled function called from another file would go stale silently. The other compiled
loops of this package, `mark_covered` and `composite`, call no compiled function.

Conventions: picture axes (x right, y down). A template pixel at offset (dx, dy) from the body's centre lies in a frame
at ``centre + (tx, ty) + R(phi) (dx, dy)``, ``R = [[cos, -sin], [sin, cos]]``. Failure is a status number.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

TUKEY = 4.685
"""Tukey's constant: 95 % efficiency on normal noise."""
SCALE_BINS = 512
F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
FAST = {"reassoc", "contract", "arcp", "nsz"}
# module constants are frozen into the compiled code, so they are defined in this file, as the cache needs


class Region(NamedTuple):
    """Part of a frame as B-spline coefficients; its first pixel lies at (``origin_x``, ``origin_y``) of the frame."""

    coefficient: F32
    origin_x: float
    origin_y: float


class Subset(NamedTuple):
    """Pixels of the template: ``offset`` (2, n), ``columns`` (4, n) their sensitivities to turn, x, y and gain, and
    ``covered`` (n), 1 for those another body hides; the centre of the body in the reference."""

    offset: F32
    columns: F32
    covered: NDArray[np.uint8]
    centre_x: float
    centre_y: float


class Settings(NamedTuple):
    """How the fit weights and when it stops: ``stop_u`` in standard uncertainties; ``gain_table`` is
    `bspline.noise_gain`."""

    gain_table: F64
    scale_floor: float
    tolerance_px: float
    stop_u: float
    max_iterations: int


class ResidualSums(NamedTuple):
    """Sums over the visible pixels, with their Tukey weights w: of w, w r^2, w v and w v^2 (residual r, grey value v);
    the pixels within three times the robust ``scale``, and the visible ones."""

    scale: float
    weight: float
    squares: float
    inlier: float
    seen: float
    value: float
    value2: float


class RigidFit(NamedTuple):
    """``iterations``, negative where the fit broke down; gain; weighted normal matrix (5, 5); mean noise gain."""

    iterations: int
    gain: float
    normal: F64
    sums: ResidualSums
    noise_gain: float


@njit(cache=True, nogil=True)
def solve5(matrix: F64, right: F64, solution: F64) -> bool:
    """Solve a symmetric positive 5 x 5 system by Cholesky with Jacobi scaling; False when it is not positive."""
    scale = np.empty(5)
    factor = np.zeros((5, 5))
    for i in range(5):
        if not matrix[i, i] > 0.0:
            return False
        scale[i] = 1.0 / math.sqrt(matrix[i, i])
    for i in range(5):
        for j in range(i + 1):
            total = matrix[i, j] * scale[i] * scale[j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > 1e-10:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    for i in range(5):
        total = right[i] * scale[i]
        for k in range(i):
            total -= factor[i, k] * solution[k]
        solution[i] = total / factor[i, i]
    for i in range(4, -1, -1):
        total = solution[i]
        for k in range(i + 1, 5):
            total -= factor[k, i] * solution[k]
        solution[i] = total / factor[i, i]
    for i in range(5):
        solution[i] *= scale[i]
    return True


@njit(cache=True, nogil=True, fastmath=FAST)
def warp_template(region: Region, subset: Subset, pose: F64, gain_table: F64, value: F32, visible: F32) -> float:
    """Sample the frame at every template pixel; ``visible`` is 1 or 0. Returns the mean noise gain of the samples."""
    coefficient, offset, covered = region.coefficient, subset.offset, subset.covered
    cx, cy, phi = subset.centre_x + pose[1], subset.centre_y + pose[2], pose[0]
    height, width = coefficient.shape
    cosine, sine = math.cos(phi), math.sin(phi)
    dx, dy = offset[0], offset[1]
    gain_sum, gain_count = 0.0, 0
    base_x, base_y = cx - region.origin_x, cy - region.origin_y
    for i in range(dx.size):
        x = base_x + cosine * dx[i] - sine * dy[i]
        y = base_y + sine * dx[i] + cosine * dy[i]
        if covered[i] != 0 or not (x >= 1.0 and y >= 1.0 and x < width - 2 and y < height - 2):
            value[i] = 0.0
            visible[i] = 0.0
            continue
        ix, iy = int(x), int(y)
        fx, fy = np.float32(x - ix), np.float32(y - iy)
        one, four, three, six = np.float32(1.0), np.float32(4.0), np.float32(3.0), np.float32(6.0)
        sixth = np.float32(1.0 / 6.0)
        gx, gy = one - fx, one - fy
        x0, x3 = gx * gx * gx * sixth, fx * fx * fx * sixth
        x1 = (four - fx * fx * (six - three * fx)) * sixth
        x2 = one - x0 - x1 - x3
        y0, y3 = gy * gy * gy * sixth, fy * fy * fy * sixth
        y1 = (four - fy * fy * (six - three * fy)) * sixth
        y2 = one - y0 - y1 - y3
        r0, r1, r2, r3 = coefficient[iy - 1], coefficient[iy], coefficient[iy + 1], coefficient[iy + 2]
        a = x0 * r0[ix - 1] + x1 * r0[ix] + x2 * r0[ix + 1] + x3 * r0[ix + 2]
        b = x0 * r1[ix - 1] + x1 * r1[ix] + x2 * r1[ix + 1] + x3 * r1[ix + 2]
        c = x0 * r2[ix - 1] + x1 * r2[ix] + x2 * r2[ix + 1] + x3 * r2[ix + 2]
        d = x0 * r3[ix - 1] + x1 * r3[ix] + x2 * r3[ix + 1] + x3 * r3[ix + 2]
        value[i] = y0 * a + y1 * b + y2 * c + y3 * d
        visible[i] = one
        if math.isnan(value[i]):  # a saturated pixel is among the sixteen
            value[i] = visible[i] = 0.0
        if i % 16 == 0:
            steps = gain_table.size - 1
            gain_sum += gain_table[int(fx * steps + 0.5)] * gain_table[int(fy * steps + 0.5)]
            gain_count += 1
    return gain_sum / gain_count if gain_count > 0 else 1.0


@njit(cache=True, nogil=True, fastmath=FAST)
def accumulate(columns: F32, value: F32, weight: F32, visible: F32, matrix: F64, right: F64) -> None:
    """Weighted normal equations of ``value = columns.T @ q[:4] + q[4]``."""
    at, ax, ay, ref = columns[0], columns[1], columns[2], columns[3]
    # named sums, so that the compiler keeps them in vector registers
    h00 = h01 = h02 = h03 = h04 = h11 = h12 = h13 = h14 = h22 = h23 = h24 = h33 = h34 = h44 = 0.0
    b0 = b1 = b2 = b3 = b4 = 0.0
    for i in range(at.size):
        w = np.float64(weight[i] * visible[i])
        a0, a1, a2 = np.float64(at[i]), np.float64(ax[i]), np.float64(ay[i])
        a3, v = np.float64(ref[i]), np.float64(value[i])
        w0, w1, w2, w3 = w * a0, w * a1, w * a2, w * a3
        h00, h01, h02, h03, h04 = h00 + w0 * a0, h01 + w0 * a1, h02 + w0 * a2, h03 + w0 * a3, h04 + w0
        h11, h12, h13, h14 = h11 + w1 * a1, h12 + w1 * a2, h13 + w1 * a3, h14 + w1
        h22, h23, h24, h33, h34, h44 = h22 + w2 * a2, h23 + w2 * a3, h24 + w2, h33 + w3 * a3, h34 + w3, h44 + w
        b0, b1, b2, b3, b4 = b0 + w0 * v, b1 + w1 * v, b2 + w2 * v, b3 + w3 * v, b4 + w * v
    upper = (h00, h01, h02, h03, h04, h11, h12, h13, h14, h22, h23, h24, h33, h34, h44)
    k = 0
    for i in range(5):
        for j in range(i, 5):
            matrix[i, j], matrix[j, i], k = upper[k], upper[k], k + 1
    right[0], right[1], right[2], right[3], right[4] = b0, b1, b2, b3, b4


@njit(cache=True, nogil=True, fastmath=FAST)
def robust_scale(residual: F32, visible: F32, top: float) -> float:
    """1.4826 times the median of ``|residual|`` over the visible pixels, from a histogram up to ``top``."""
    bins = np.zeros(SCALE_BINS, dtype=np.int64)
    per_grey = np.float32(SCALE_BINS / top)
    count = 0
    for i in range(residual.size):
        if visible[i] > 0.0:
            k = int(abs(residual[i]) * per_grey)
            bins[min(k, SCALE_BINS - 1)] += 1
            count += 1
    if count == 0:
        return 0.0
    below, half = 0, 0.5 * count
    for k in range(SCALE_BINS):
        if below + bins[k] >= half:
            return 1.4826 * (k + (half - below) / bins[k]) / per_grey
        below += bins[k]
    return 1.4826 * top


# These store: where arrays lie decides between vector and scalar loop, which without fast arithmetic give the same bits
@njit(cache=True, nogil=True)
def residuals(columns: F32, value: F32, q: F64, residual: F32) -> None:
    """Grey values less the linear fit ``q``."""
    at, ax, ay, ref = columns[0], columns[1], columns[2], columns[3]
    q0, q1, q2, q3, q4 = np.float32(q[0]), np.float32(q[1]), np.float32(q[2]), np.float32(q[3]), np.float32(q[4])
    for i in range(at.size):
        residual[i] = value[i] - (q0 * at[i] + q1 * ax[i] + q2 * ay[i] + q3 * ref[i] + q4)


@njit(cache=True, nogil=True)
def tukey_weights(residual: F32, scale: float, weight: F32) -> None:
    """Weights of residuals of the given scale."""
    per, one, zero = np.float32(1.0 / (TUKEY * scale)), np.float32(1.0), np.float32(0.0)
    for i in range(residual.size):
        u = residual[i] * per
        rest = max(one - u * u, zero)
        weight[i] = rest * rest


@njit(cache=True, nogil=True, fastmath=FAST)
def weighted_sums(residual: F32, weight: F32, value: F32, visible: F32, scale: float) -> ResidualSums:
    """Sums over the visible pixels."""
    near, one, zero = np.float32(3.0 * scale), np.float32(1.0), np.float32(0.0)
    sum_w = sum_wr2 = inlier = seen = sum_wv = sum_wvv = 0.0
    for i in range(residual.size):
        seen_here = visible[i]
        wv, r, v = np.float64(weight[i] * seen_here), np.float64(residual[i]), np.float64(value[i])
        sum_w += wv
        sum_wr2 += wv * r * r
        sum_wv += wv * v
        sum_wvv += wv * v * v
        inlier += seen_here * (one if abs(residual[i]) < near else zero)
        seen += seen_here
    return ResidualSums(scale, sum_w, sum_wr2, inlier, seen, sum_wv, sum_wvv)


@njit(cache=True, nogil=True)
def step_in_u(matrix: F64, q: F64, sums: ResidualSums, right: F64, column: F64) -> float:
    """Largest of turn, x and y of a step, each over its standard uncertainty."""
    largest = 0.0
    for k in range(3):
        right[:] = 0.0
        right[k] = 1.0
        if not solve5(matrix, right, column):
            return np.inf
        largest = max(largest, abs(q[k]) / math.sqrt(max(column[k] * sums.squares / max(sums.weight, 1.0), 1e-30)))
    return largest


@njit(cache=True, nogil=True)
def fit_rigid(
    region: Region, subset: Subset, settings: Settings, pose: F64, weight: F32, work: F32, scale: float
) -> RigidFit:
    """Inverse-compositional Gauss-Newton fit of one body in one frame.

    Starts from ``pose`` (phi, tx, ty), ``weight`` and the residuals' robust ``scale``; pose and weight receive the
    result, ``work`` (3, n) grey values, visible pixels and residuals.
    """
    value, visible, residual = work[0], work[1], work[2]
    # q: gain times the step (turn, x, y), gain, offset
    matrix, right, q, column = np.zeros((5, 5)), np.empty(5), np.zeros(5), np.zeros(5)
    sums, noise_gain = ResidualSums(scale, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0
    radius, before, rate = 0.0, np.inf, 0.0
    for i in range(weight.size):
        radius = max(radius, math.hypot(subset.offset[0, i], subset.offset[1, i]))
    for iteration in range(1, settings.max_iterations + 1):
        noise_gain = warp_template(region, subset, pose, settings.gain_table, value, visible)
        accumulate(subset.columns, value, weight, visible, matrix, right)
        if not solve5(matrix, right, q) or abs(q[3]) < 1e-3:
            return RigidFit(-iteration, q[3], matrix, sums, noise_gain)
        residuals(subset.columns, value, q, residual)
        top, found = 8.0 * max(sums.scale, settings.scale_floor), np.inf
        while found >= 0.175 * top and top < 1e7:
            found, top = robust_scale(residual, visible, top), 4.0 * top
        found = max(found, settings.scale_floor)
        tukey_weights(residual, found, weight)
        sums = weighted_sums(residual, weight, value, visible, found)
        turn, step_x, step_y = q[0] / q[3], q[1] / q[3], q[2] / q[3]
        if not (abs(turn) < 1.0 and max(abs(step_x), abs(step_y)) < 100.0):
            return RigidFit(-iteration, q[3], matrix, sums, noise_gain)
        # compose with the inverse of the template's own motion
        pose[0] -= turn
        cosine, sine = math.cos(pose[0]), math.sin(pose[0])
        pose[1] -= cosine * step_x - sine * step_y
        pose[2] -= sine * step_x + cosine * step_y
        # what is left if the next steps shrink as this one did; once at least with weights of this frame's residuals
        step = step_in_u(matrix, q, sums, right, column)
        rate = max(min(step / before, 0.95), 0.7 * rate)
        before = step
        small = max(abs(turn) * radius, max(abs(step_x), abs(step_y))) < settings.tolerance_px
        left = step * (1.0 if iteration == settings.max_iterations else rate / (1.0 - rate))
        if (small or (step < 1.0 and left < settings.stop_u)) and iteration > 1:
            return RigidFit(iteration, q[3], matrix, sums, noise_gain)
    return RigidFit(-settings.max_iterations, q[3], matrix, sums, noise_gain)
