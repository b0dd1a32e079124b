"""The compiled loops of the pose fit (numba); `fit_rigid` is called once per body and frame.

All loops and the named tuples they take stay in one file, because numba's disk cache only notices changes of the file
that holds the cached function: a compiled function called from another file would go stale silently. The other compiled
loops of this package, `mark_covered` and `composite`, call no compiled function.

Conventions: picture axes (x right, y down). A template pixel at offset (dx, dy) from the body's centre lies in a frame
at ``centre + (tx, ty) + R(phi) (dx, dy)``, ``R = [[cos, -sin], [sin, cos]]``. Failure is a status number.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from vision.fitting.template import MOST_CONDITION, TUKEY
from vision.kernel_cache import cached_njit, inner_njit

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]


class Region(NamedTuple):
    """Part of a frame as B-spline coefficients; its first pixel lies at (``origin_x``, ``origin_y``) of the frame."""

    coefficient: F32
    origin_x: float
    origin_y: float


class Subset(NamedTuple):
    """Pixels of the template: ``offset`` (2, n), ``columns`` (4, n) their sensitivities to turn, x, y and gain, and
    ``covered`` (n), 1 for those another body hides; the centre of the body in the reference, and the largest offset."""

    offset: F32
    columns: F32
    covered: NDArray[np.uint8]
    centre_x: float
    centre_y: float
    radius: float


class State(NamedTuple):
    """What a fit starts from and leaves behind: ``pose`` (turn, x, y), ``weight`` (n) and the residuals' robust
    ``scale``; ``work`` (5, n): grey values, visible pixels (1 or 0), residuals, and with ``at`` (n) the `Places`."""

    pose: F64
    weight: F32
    work: F32
    at: I32
    scale: float


class Places(NamedTuple):
    """Where template pixels lie in a region: fractions (n) of a pixel past the coefficient that is one row and one
    column after that of index ``at`` (n)."""

    fx: F32
    fy: F32
    at: I32


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


TOP_SIGMA, INSIDE = 8.0, 0.175  # end of the histogram over the scale before, and of it the largest scale it tells
SCALE_BINS = 512  # of the residuals' histogram: a median within 0.2 % of its end
FAST = {"reassoc", "contract", "arcp", "nsz"}
"""For sums over pixels alone: other operations would be ordered anew in each caller that they are compiled into."""
SIXTH, THIRD = 1.0 / 6.0, 2.0 / 3.0
BASIS = ((-SIXTH, 0.5, -0.5, SIXTH), (0.5, -1.0, 0.5, 0.0), (-0.5, 0.0, 0.5, 0.0), (SIXTH, THIRD, SIXTH, 0.0))
"""Cubic B-splines of the four coefficients around a point, times the fraction's cube, its square, itself and one."""
# module constants are frozen into the compiled code, so they are defined in this file, as the cache needs


@cached_njit(nogil=True)
def solve5(matrix: F64, rhs: F64, solution: F64) -> bool:
    """Fill ``solution`` of a symmetric positive 5 x 5 system by Cholesky, scaled; False when it is not positive."""
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
                if not total > 1.0 / MOST_CONDITION:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    for i in range(5):
        total = rhs[i] * scale[i]
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


@intrinsic
def spline_sample(typing: Any, flat: Any, at: Any, width: Any, fx: Any, fy: Any) -> Any:
    """Numba intrinsic: value of the spline of coefficients ``flat`` (rows of ``width``) at fractions (fx, fy) past the
    second of the four by four that begin at ``at``. Four rows at once: scalar code is four times slower."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        picture, index, step, along, across = args
        four, lanes = ir.VectorType(ir.FloatType(), 4), ir.VectorType(ir.IntType(32), 4)
        free, fused = ir.Constant(four, ir.Undefined), {"flags": ("contract",)}

        def shuffle(vector: Any, order: list[int]) -> Any:
            return builder.shuffle_vector(vector, free, ir.Constant(lanes, order))

        def basis(fraction: Any) -> Any:
            f = shuffle(builder.insert_element(free, fraction, ir.Constant(ir.IntType(32), 0)), [0] * 4)
            total = ir.Constant(four, list(BASIS[0]))
            for row in BASIS[1:]:
                total = builder.fadd(builder.fmul(total, f, **fused), ir.Constant(four, list(row)), **fused)
            return total

        data = context.make_array(signature.args[0])(context, builder, picture).data
        by, total = basis(across), ir.Constant(four, [0.0] * 4)
        for row in range(4):
            line = builder.load(builder.bitcast(builder.gep(data, [index]), four.as_pointer()), align=4)
            total = builder.fadd(total, builder.fmul(shuffle(by, [row] * 4), line, **fused), **fused)
            index = builder.add(index, step)
        total = builder.fmul(total, basis(along))
        for order in ([2, 3, 0, 1], [1, 0, 3, 2]):
            total = builder.fadd(total, shuffle(total, order))
        return builder.extract_element(total, ir.Constant(ir.IntType(32), 0))

    return types.float32(flat, types.int64, types.int64, types.float32, types.float32), code


@cached_njit(nogil=True)
def place_pixels(region: Region, subset: Subset, pose: F64, places: Places, visible: F32) -> None:
    """Fill ``places`` with where each template pixel lies in the region at ``pose``, and ``visible`` (n,) with 1 where
    it is inside and not covered, else 0."""
    height, width = region.coefficient.shape
    cosine, sine = np.float32(math.cos(pose[0])), np.float32(math.sin(pose[0]))
    centre_x = subset.centre_x + pose[1] - region.origin_x
    centre_y = subset.centre_y + pose[2] - region.origin_y
    # whole pixels apart, so that single precision is enough
    left, top = np.int32(math.floor(centre_x)), np.int32(math.floor(centre_y))
    rest_x, rest_y = np.float32(centre_x - left), np.float32(centre_y - top)
    last_x, last_y, step = np.int32(width - 3), np.int32(height - 3), np.int32(width)
    dx, dy, covered = subset.offset[0], subset.offset[1], subset.covered
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(dx.size):
        x, y = rest_x + (cosine * dx[i] - sine * dy[i]), rest_y + (sine * dx[i] + cosine * dy[i])
        whole_x, whole_y = np.floor(x), np.floor(y)
        places.fx[i], places.fy[i] = x - whole_x, y - whole_y
        ix, iy = np.int32(left + np.int32(whole_x)), np.int32(top + np.int32(whole_y))
        inside = (covered[i] == 0) & (ix >= 1) & (iy >= 1) & (ix <= last_x) & (iy <= last_y)
        visible[i] = one if inside else zero
        places.at[i] = np.int32(iy - 1) * step + np.int32(ix - 1) if inside else np.int32(0)


@cached_njit(nogil=True)
def sample_frame(region: Region, places: Places, value: F32, visible: F32) -> None:
    """Fill ``value`` (n,) with the frame's grey values at the visible template pixels, else 0; ``visible`` (n,) becomes
    0 where a value is not a number."""
    flat, width = region.coefficient.reshape(-1), region.coefficient.shape[1]
    zero = np.float32(0.0)
    for i in range(value.size):
        at, fx, fy = np.int64(places.at[i]), places.fx[i], places.fy[i]
        v = np.float32(spline_sample(flat, at, np.int64(width), fx, fy))  # type: ignore[call-arg]  # mypy sees `typing`
        known = (visible[i] > zero) & (v == v)  # a saturated pixel among the sixteen is not a number
        value[i] = v if known else zero
        visible[i] = np.float32(1.0) if known else zero


@cached_njit(nogil=True)
def mean_noise_gain(places: Places, visible: F32, gain_table: F64) -> float:
    """Mean gain of the interpolation on noise, over every sixteenth visible pixel; 1 where none is."""
    total, count, steps = 0.0, 0, np.float32(gain_table.size - 1)
    half = np.float32(0.5)
    for i in range(0, visible.size, 16):
        if visible[i] > 0.0:
            total += gain_table[int(places.fx[i] * steps + half)] * gain_table[int(places.fy[i] * steps + half)]
            count += 1
    return total / count if count > 0 else 1.0


@cached_njit(nogil=True, fastmath=FAST)
def normal_equations(columns: F32, value: F32, weight: F32, visible: F32, matrix: F64, rhs: F64) -> None:
    """Fill normal ``matrix`` (5, 5) and ``rhs`` (5,) of the fit of ``value`` (n,) by ``columns`` (4, n; turn, x, y,
    gain) and a constant, each pixel weighted by ``weight`` (n,) times ``visible`` (n,)."""
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
    rhs[0], rhs[1], rhs[2], rhs[3], rhs[4] = b0, b1, b2, b3, b4


@cached_njit(nogil=True)
def robust_scale(residual: F32, visible: F32, top: float, bin_of: I32) -> float:
    """1.4826 times the median of ``|residual|`` over the visible pixels, from a histogram up to ``top``; ``bin_of``
    (n,) is work space."""
    n, per_grey, last = residual.size, np.float32(SCALE_BINS / top), np.float32(SCALE_BINS - 1)
    for i in range(n):
        at = np.int32(min(abs(residual[i]) * per_grey, last))
        bin_of[i] = at if visible[i] > 0.0 else np.int32(SCALE_BINS)
    # in turns, since adding to one bin twice in a row waits for the first
    several = np.zeros((4, SCALE_BINS + 1), dtype=np.int64)
    for i in range(0, n - 3, 4):
        several[0, bin_of[i]] += 1
        several[1, bin_of[i + 1]] += 1
        several[2, bin_of[i + 2]] += 1
        several[3, bin_of[i + 3]] += 1
    for i in range(n - n % 4, n):
        several[0, bin_of[i]] += 1
    bins = several[0]
    for k in range(SCALE_BINS + 1):
        bins[k] += several[1, k] + several[2, k] + several[3, k]
    count = n - bins[SCALE_BINS]
    if count == 0:
        return 0.0
    below, half = 0, 0.5 * count
    for k in range(SCALE_BINS):
        if below + bins[k] >= half:
            return 1.4826 * (k + (half - below) / bins[k]) / per_grey
        below += bins[k]
    return 1.4826 * top


# These store: where arrays lie decides between vector and scalar loop, which without fast arithmetic give the same bits
@inner_njit()
def linear_residuals(columns: F32, value: F32, q: F64, residual: F32) -> None:
    at, ax, ay, ref = columns[0], columns[1], columns[2], columns[3]
    q0, q1, q2, q3, q4 = np.float32(q[0]), np.float32(q[1]), np.float32(q[2]), np.float32(q[3]), np.float32(q[4])
    for i in range(at.size):
        residual[i] = value[i] - (q0 * at[i] + q1 * ax[i] + q2 * ay[i] + q3 * ref[i] + q4)


@cached_njit(nogil=True)
def tukey_weights(residual: F32, scale: float, weight: F32) -> None:
    per, one, zero = np.float32(1.0 / (TUKEY * scale)), np.float32(1.0), np.float32(0.0)
    for i in range(residual.size):
        u = residual[i] * per
        rest = max(one - u * u, zero)
        weight[i] = rest * rest


@cached_njit(nogil=True, fastmath=FAST)
def weighted_sums(residual: F32, weight: F32, value: F32, visible: F32, scale: float) -> ResidualSums:
    """Weighted sums of residuals and values over the visible pixels; an inlier lies within three ``scale``."""
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


@inner_njit()
def step_over_uncertainty(matrix: F64, step: F64, sums: ResidualSums, rhs: F64, column: F64) -> float:
    """Largest component (turn, x, y) of a fit's ``step`` (5,) over its standard uncertainty; ``matrix`` (5, 5) is the
    normal one, ``rhs`` and ``column`` (5,) are work space."""
    largest = 0.0
    for k in range(3):
        rhs[:] = 0.0
        rhs[k] = 1.0
        if not solve5(matrix, rhs, column):
            return np.inf
        largest = max(largest, abs(step[k]) / math.sqrt(max(column[k] * sums.squares / max(sums.weight, 1.0), 1e-30)))
    return largest


@cached_njit(nogil=True)
def fit_rigid(region: Region, subset: Subset, settings: Settings, state: State) -> RigidFit:
    """Inverse-compositional Gauss-Newton fit of one body in one frame, from pose, weights and scale of ``state``, whose
    arrays receive the result; a breakdown is a negative number of iterations."""
    pose, weight, value, visible, residual = state.pose, state.weight, state.work[0], state.work[1], state.work[2]
    places = Places(state.work[3], state.work[4], state.at)
    # q: gain times the step (turn, x, y), gain, offset
    matrix, right, q, column = np.zeros((5, 5)), np.empty(5), np.zeros(5), np.zeros(5)
    sums = ResidualSums(state.scale, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    before, rate = np.inf, 0.0
    for iteration in range(1, settings.max_iterations + 1):
        place_pixels(region, subset, pose, places, visible)
        sample_frame(region, places, value, visible)
        normal_equations(subset.columns, value, weight, visible, matrix, right)
        if not solve5(matrix, right, q) or abs(q[3]) < 1e-3:
            return RigidFit(-iteration, q[3], matrix, sums, 1.0)
        linear_residuals(subset.columns, value, q, residual)
        # the histogram is widened until the scale lies well inside it, so that nothing that counts is cut off
        top, found = TOP_SIGMA * max(sums.scale, settings.scale_floor), np.inf
        while found >= INSIDE * top and top < 1e9:
            found, top = robust_scale(residual, visible, top, state.at), 4.0 * top
        found = max(found, settings.scale_floor)
        tukey_weights(residual, found, weight)
        sums = weighted_sums(residual, weight, value, visible, found)
        turn, step_x, step_y = q[0] / q[3], q[1] / q[3], q[2] / q[3]
        if not (abs(turn) < 1.0 and max(abs(step_x), abs(step_y)) < 100.0):
            return RigidFit(-iteration, q[3], matrix, sums, 1.0)
        # compose with the inverse of the template's own motion
        pose[0] -= turn
        cosine, sine = math.cos(pose[0]), math.sin(pose[0])
        pose[1] -= cosine * step_x - sine * step_y
        pose[2] -= sine * step_x + cosine * step_y
        # what is left if the next steps shrink as this one did; once at least with weights of this frame's residuals
        step = step_over_uncertainty(matrix, q, sums, right, column)
        rate = max(min(step / before, 0.95), 0.7 * rate)  # of convergence: at most 0.95, and no sudden fall
        before = step
        small = max(abs(turn) * subset.radius, max(abs(step_x), abs(step_y))) < settings.tolerance_px
        left = step * (1.0 if iteration == settings.max_iterations else rate / (1.0 - rate))
        if (small or (step < 1.0 and left < settings.stop_u)) and iteration > 1:
            return RigidFit(iteration, q[3], matrix, sums, mean_noise_gain(places, visible, settings.gain_table))
    return RigidFit(-settings.max_iterations, q[3], matrix, sums, 1.0)
