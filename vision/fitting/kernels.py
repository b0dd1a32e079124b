"""The compiled loops of the pose fit (numba).

Place in the data flow: `icgn` calls `fit_rigid` once per body and frame. Private to `vision`. They stay in
one file because numba's disk cache only notices changes of the file in which the cached function stands: a
jitted function called from another file would go stale without a word. The other compiled loops of this
package, `covering.mark_covered` and `synthetic.kernels.composite`, call nothing and stand alone.

Conventions: picture axes (x right, y down). A template pixel at offset ``(dx, dy)`` from the body's centre
``(cx, cy)`` lies in a frame at ``centre + (tx, ty) + R(phi) (dx, dy)``, ``R = [[cos, -sin], [sin, cos]]``.
Coefficients are those of `bspline`; failure is a status number.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

TUKEY = 4.685
"""Tukey's constant: 95 % efficiency on normal noise."""
SCALE_BINS = 512
FAST = {"reassoc", "contract", "arcp", "nsz"}
# module constants are frozen into the compiled code; they stand in this file, as the cache needs


@njit(cache=True, nogil=True)
def solve5(matrix: NDArray[np.float64], right: NDArray[np.float64], solution: NDArray[np.float64]) -> bool:
    """Solve a symmetric positive 5 x 5 system by Cholesky with Jacobi scaling; False when it is not
    positive."""
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
def warp_template(
    coefficient: NDArray[np.float32],
    origin_x: float,
    origin_y: float,
    offset: NDArray[np.float32],
    covered: NDArray[np.uint8],
    cx: float,
    cy: float,
    phi: float,
    gain_table: NDArray[np.float64],
    value: NDArray[np.float32],
    visible: NDArray[np.float32],
) -> float:
    """Sample the frame at every template pixel; ``visible`` is 1 or 0. Returns the mean noise gain of the
    samples."""
    height, width = coefficient.shape
    cosine, sine = math.cos(phi), math.sin(phi)
    dx, dy = offset[0], offset[1]
    gain_sum, gain_count = 0.0, 0
    base_x, base_y = cx - origin_x, cy - origin_y
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
        if i % 16 == 0:
            steps = gain_table.size - 1
            gain_sum += gain_table[int(fx * steps + 0.5)] * gain_table[int(fy * steps + 0.5)]
            gain_count += 1
    return gain_sum / gain_count if gain_count > 0 else 1.0


@njit(cache=True, nogil=True, fastmath=FAST)
def accumulate(
    columns: NDArray[np.float32],
    value: NDArray[np.float32],
    weight: NDArray[np.float32],
    visible: NDArray[np.float32],
    matrix: NDArray[np.float64],
    right: NDArray[np.float64],
) -> None:
    """Weighted normal equations of ``value = columns.T @ q[:4] + q[4]``."""
    at, ax, ay, ref = columns[0], columns[1], columns[2], columns[3]
    # fifteen named sums, so that the compiler keeps them in vector registers
    h00 = h01 = h02 = h03 = h04 = h11 = h12 = h13 = h14 = h22 = h23 = h24 = h33 = h34 = h44 = 0.0
    b0 = b1 = b2 = b3 = b4 = 0.0
    for i in range(at.size):
        w = np.float64(weight[i] * visible[i])
        a0, a1, a2, a3 = np.float64(at[i]), np.float64(ax[i]), np.float64(ay[i]), np.float64(ref[i])
        v = np.float64(value[i])
        w0, w1, w2, w3 = w * a0, w * a1, w * a2, w * a3
        h00 += w0 * a0
        h01 += w0 * a1
        h02 += w0 * a2
        h03 += w0 * a3
        h04 += w0
        h11 += w1 * a1
        h12 += w1 * a2
        h13 += w1 * a3
        h14 += w1
        h22 += w2 * a2
        h23 += w2 * a3
        h24 += w2
        h33 += w3 * a3
        h34 += w3
        h44 += w
        b0 += w0 * v
        b1 += w1 * v
        b2 += w2 * v
        b3 += w3 * v
        b4 += w * v
    upper = (h00, h01, h02, h03, h04, h11, h12, h13, h14, h22, h23, h24, h33, h34, h44)
    k = 0
    for i in range(5):
        for j in range(i, 5):
            matrix[i, j] = matrix[j, i] = upper[k]
            k += 1
    right[0], right[1], right[2], right[3], right[4] = b0, b1, b2, b3, b4


@njit(cache=True, nogil=True, fastmath=FAST)
def robust_scale(residual: NDArray[np.float32], visible: NDArray[np.float32], top: float) -> float:
    """1.4826 times the median of ``|residual|`` over the visible pixels, from a histogram up to ``top`` (0:
    none visible)."""
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


@njit(cache=True, nogil=True, fastmath=FAST)
def update_weights(
    columns: NDArray[np.float32],
    value: NDArray[np.float32],
    visible: NDArray[np.float32],
    q: NDArray[np.float64],
    scale_in: float,
    scale_floor: float,
    residual: NDArray[np.float32],
    weight: NDArray[np.float32],
    stats: NDArray[np.float64],
) -> float:
    """Residuals of the linear fit ``q``, their robust scale, Tukey weights, and sums over them. Returns the
    scale."""
    at, ax, ay, ref = columns[0], columns[1], columns[2], columns[3]
    q0, q1, q2 = np.float32(q[0]), np.float32(q[1]), np.float32(q[2])
    q3, q4 = np.float32(q[3]), np.float32(q[4])
    for i in range(at.size):
        residual[i] = value[i] - (q0 * at[i] + q1 * ax[i] + q2 * ay[i] + q3 * ref[i] + q4)
    top = 8.0 * max(scale_in, scale_floor)
    scale = robust_scale(residual, visible, top)
    for _ in range(8):
        if scale < 0.7 * top:
            break
        top *= 4.0
        scale = robust_scale(residual, visible, top)
    scale = max(scale, scale_floor)
    per = np.float32(1.0 / (TUKEY * scale))
    one, zero = np.float32(1.0), np.float32(0.0)
    near = np.float32((3.0 / TUKEY) ** 2)
    sum_w = sum_wr2 = inlier = seen = sum_wv = sum_wvv = 0.0
    for i in range(at.size):
        u = residual[i] * per
        u2 = u * u
        rest = max(one - u2, zero)
        w = rest * rest
        weight[i] = w
        seen_here = visible[i]
        wv = np.float64(w * seen_here)
        r = np.float64(residual[i])
        v = np.float64(value[i])
        sum_w += wv
        sum_wr2 += wv * r * r
        sum_wv += wv * v
        sum_wvv += wv * v * v
        inlier += seen_here * (one if u2 < near else zero)
        seen += seen_here
    stats[0], stats[1], stats[2], stats[3], stats[4], stats[5] = sum_w, sum_wr2, inlier, seen, sum_wv, sum_wvv
    return scale


@njit(cache=True, nogil=True)
def fit_rigid(
    coefficient: NDArray[np.float32],
    origin_x: float,
    origin_y: float,
    offset: NDArray[np.float32],
    columns: NDArray[np.float32],
    covered: NDArray[np.uint8],
    centre_x: float,
    centre_y: float,
    gain_table: NDArray[np.float64],
    scale_floor: float,
    tolerance_px: float,
    max_iterations: int,
    robust: bool,
    pose: NDArray[np.float64],
    weight: NDArray[np.float32],
    scale: float,
    q: NDArray[np.float64],
    matrix: NDArray[np.float64],
    stats: NDArray[np.float64],
) -> int:
    """Inverse-compositional Gauss-Newton fit of one body in one frame.

    ``offset`` (2, n) holds the template's pixels, ``columns`` (4, n) their sensitivities to turn, x, y and
    gain. ``pose`` (phi, tx, ty) and ``weight`` hold the start and receive the result; ``q`` receives (gain
    times the last step, gain, offset), ``matrix`` the weighted normal matrix, ``stats`` the sums of
    `update_weights`, then scale and noise gain. Returns the number of iterations, negative when the fit broke
    down.
    """
    n = offset.shape[1]
    value = np.empty(n, dtype=np.float32)
    visible = np.empty(n, dtype=np.float32)
    residual = np.empty(n, dtype=np.float32)
    right = np.empty(5)
    radius = 0.0
    for i in range(n):
        radius = max(radius, math.hypot(offset[0, i], offset[1, i]))
    for iteration in range(1, max_iterations + 1):
        x, y = centre_x + pose[1], centre_y + pose[2]
        gain = warp_template(
            coefficient, origin_x, origin_y, offset, covered, x, y, pose[0], gain_table, value, visible
        )
        accumulate(columns, value, weight, visible, matrix, right)
        if not solve5(matrix, right, q) or abs(q[3]) < 1e-3:
            return -iteration
        scale = update_weights(columns, value, visible, q, scale, scale_floor, residual, weight, stats)
        if not robust:
            weight[:] = 1.0
        turn, step_x, step_y = q[0] / q[3], q[1] / q[3], q[2] / q[3]
        if not (abs(turn) < 1.0 and abs(step_x) < 100.0 and abs(step_y) < 100.0):
            return -iteration
        # compose with the inverse of the template's own motion
        pose[0] -= turn
        cosine, sine = math.cos(pose[0]), math.sin(pose[0])
        pose[1] -= cosine * step_x - sine * step_y
        pose[2] -= sine * step_x + cosine * step_y
        stats[6], stats[7] = scale, gain
        # one round at least in which the weights follow from this frame's own residuals
        small = max(abs(turn) * radius, max(abs(step_x), abs(step_y))) < tolerance_px
        if small and (iteration > 1 or not robust):
            return iteration
    return -max_iterations
