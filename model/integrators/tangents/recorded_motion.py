"""The motion of a scene with everything that its tangents need: the state at any time, and where the forces have kinks.

`record` is the step loop of ``model.integrators.rosenbrock`` without rest and energies; it keeps each step's dense
output and notes the regime of the contacts. `state_at` reads it. `find_kinks` finds, to a picosecond, when a contact
begins or ceases to push, passes from the arc of a surface to its tangent, or slides the other way: there the Jacobian
jumps, or turns within a layer so thin that a step could pass over it unseen.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.rosenbrock import STAGE
from model.integrators.step_control import (
    DONE,
    NOT_FINITE,
    SMALLEST_STEP,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    after_step,
    allow,
    ending_at,
    next_stop,
    shortened,
)
from model.kernels.compile import inlined, step_loop
from model.kernels.inputs import fit_to_input, input_at
from model.kernels.kernel_value import KernelType
from model.kernels.layout import N_CONTACT, N_JACOBIAN, N_REJECTED, N_RHS, N_STEPS
from model.kernels.regimes import REGIME
from model.kernels.signatures import INTEGRATE, LINEARISE
from model.kernels.workspace import ANGLE_LIMIT, DENSE, ERROR, FITTED, Q1, SIZE, SPEED_LIMIT, V1, WIDTH, Q, V

FULL = 9  # status: the rows are used up; go on with more of them
NARROW = 1e-12  # s, between the two sides of a kink


class Motion(NamedTuple):
    """Steps of a run, (k, ...): start and length, dense output, bits of the contacts' `model.derived.slopes` regime."""

    time: np.ndarray  # (k, 2)
    state: np.ndarray  # (k, 4 + 2 dense, n): q0, v0, q1, v1, then angle and speed parts of each row of the dense output
    regime: np.ndarray  # (k,)


class Log(NamedTuple):
    """What `record` fills: steps, and counters of work (see `model.kernels.layout.COUNTERS`)."""

    motion: Motion
    counters: np.ndarray


_f, _i = types.float64, types.int64
_integers, _table = types.Array(_i, 1, "C"), types.Array(_f, 2, "C")
_numbers = types.Array(_f, 1, "C")
SPAN, DRIVE, _, NUMBERS, KERNELS, METHOD, LIMITS, _ = INTEGRATE.args
MOTION = types.NamedTuple([_table, types.Array(_f, 3, "C"), _integers], Motion)
LOG = types.NamedTuple([MOTION, _integers], Log)
_REGIME = KernelType(REGIME)
RECORD = types.Tuple((_f, _f, _i, _i))(
    SPAN, DRIVE, NUMBERS, KERNELS, _REGIME, METHOD, LIMITS, LOG
)  # time reached, next step to try, status, rows filled
STATES_ALONG = types.void(MOTION, _numbers, _table, _table)
FIND_KINKS = _i(MOTION, DRIVE, _numbers, KernelType(LINEARISE), _REGIME, _table)


@inlined
def keep_step(w, row):
    """Copy the ends of a step and what its dense output is made of."""
    for i in range(row.shape[1]):
        row[0, i] = w[Q + i]
        row[1, i] = w[V + i]
        row[2, i] = w[Q1 + i]
        row[3, i] = w[V1 + i]
        for m in range((row.shape[0] - 4) // 2):
            row[4 + 2 * m, i] = w[DENSE + STAGE * m + i]
            row[5 + 2 * m, i] = w[DENSE + STAGE * m + WIDTH + i]


@step_loop(RECORD)
def record(span, drive, scene, kernels, regime, method, limits, log):
    """Advance the state of ``span`` in place, one row of the log a step.

    Returns the time reached, the next step to try, a status, how many rows were filled.
    """
    t, t_end, h, q, v, _ = span
    p, parent, n_contacts = scene
    a, c, b, node, d, dense, gamma, exponent = method
    motion, counters = log
    n = q.shape[0]
    s = b.shape[0]
    w = np.zeros(SIZE)
    w[ANGLE_LIMIT], w[SPEED_LIMIT] = limits.angle, limits.speed
    for i in range(n):
        w[Q + i] = q[i]
        w[V + i] = v[i]
    k_in = 0
    rows = 0
    status = TOO_MANY_STEPS
    fresh = True
    rejected = False
    u0 = 0.0
    slope = 0.0
    now = 0
    for _ in range(limits.most_steps):
        if t >= t_end:
            break
        if rows == motion.time.shape[0]:
            status = FULL
            break
        if fresh:
            u0, slope, k_in = input_at(t, k_in, drive)
            kernels.linearise(w, p, u0)
            counters[N_RHS] += 1
            counters[N_JACOBIAN] += 1
            counters[N_CONTACT] += n_contacts
            now = regime(w, p)
            fresh = False
        h = min(h, limits.longest_step)
        stop = next_stop(t, t_end, k_in, drive)
        w[FITTED] = h
        kernels.fit(w, p)
        fitted = w[FITTED]
        step = fit_to_input(t, ending_at(stop, t, fitted), u0, k_in, drive, w, n, limits)
        gh = gamma * step
        error = 0.0
        ok = kernels.prepare(w, gh) == 1
        if ok:
            allow(w, step)
            mask = kernels.skip(w, p)
            u, rate = u0, 1.0 / step
            for m in range(s):
                if m > 0:
                    u, _, k_in = input_at(t + node[m] * step, k_in, drive)
                kernels.stage(w, p, a, c, m, gh, rate, u, step * d[m] * slope, mask)
            counters[N_RHS] += s - 1
            counters[N_CONTACT] += n_contacts * (s - 1)
            ok = kernels.end(w, b, s, 0) == 1
            error = w[ERROR]
        if not ok or error > 1.0:
            counters[N_REJECTED] += 1
            rejected = True
            h = shortened(step, error, exponent) if ok else 0.2 * step
            if h < SMALLEST_STEP:
                status = STEP_TOO_SMALL if ok else NOT_FINITE
                break
            continue
        counters[N_STEPS] += 1
        motion.time[rows, 0] = t
        motion.time[rows, 1] = step
        motion.regime[rows] = now
        kernels.dense(w, dense, dense.shape[0], s)
        keep_step(w, motion.state[rows])
        rows += 1
        t = stop if step == stop - t else t + step
        h = after_step(step, error, exponent, rejected, fitted, h)
        rejected = False
        for i in range(STAGE):
            w[Q + i] = w[Q1 + i]
        fresh = True
    if t >= t_end:
        status = DONE
    for i in range(n):
        q[i] = w[Q + i]
        v[i] = w[V + i]
    return t, h, status, rows


@inlined
def state_at(t, k, motion, w):
    """Put the state at ``t`` into ``w``; ``k`` is a start for the search of the step. Returns the step."""
    last = motion.time.shape[0] - 1
    while k < last and t >= motion.time[k + 1, 0]:
        k += 1
    while k > 0 and t < motion.time[k, 0]:
        k -= 1
    x = (t - motion.time[k, 0]) / motion.time[k, 1]
    row = motion.state[k]
    for i in range(row.shape[1]):
        dq = 0.0
        dv = 0.0
        for m in range(row.shape[0] - 2, 3, -2):
            dq = row[m, i] + x * dq
            dv = row[m + 1, i] + x * dv
        w[Q + i] = (1.0 - x) * row[0, i] + x * (row[2, i] + (1.0 - x) * dq)
        w[V + i] = (1.0 - x) * row[1, i] + x * (row[3, i] + (1.0 - x) * dv)
    return k


@step_loop(STATES_ALONG)
def states_along(motion, times, angle, speed):
    """Fill ``angle`` and ``speed`` (m, n) with the states at ``times`` (m,)."""
    w = np.zeros(SIZE)
    k = 0
    for m in range(times.shape[0]):
        k = state_at(times[m], k, motion, w)
        for i in range(angle.shape[1]):
            angle[m, i] = w[Q + i]
            speed[m, i] = w[V + i]


@step_loop(FIND_KINKS)
def find_kinks(motion, drive, p, linearise, regime, kinks):
    """Fill ``kinks`` (m, 2) with the last time before and the first after each kink; returns how many."""
    w = np.zeros(SIZE)
    found = 0
    k_in = 0
    for k in range(motion.time.shape[0] - 1):
        before = motion.regime[k]
        left = motion.time[k, 0]
        end = motion.time[k + 1, 0]
        while before != motion.regime[k + 1] and found < kinks.shape[0]:
            right = end
            while right - left > max(NARROW, 8e-16 * abs(right)):
                middle = 0.5 * (left + right)
                state_at(middle, k, motion, w)
                u, _, k_in = input_at(middle, k_in, drive)
                linearise(w, p, u)
                if regime(w, p) == before:
                    left = middle
                else:
                    right = middle
            kinks[found, 0] = left
            kinks[found, 1] = right
            found += 1
            if not right < end:
                break
            state_at(right, k, motion, w)
            u, _, k_in = input_at(right, k_in, drive)
            linearise(w, p, u)
            before = regime(w, p)
            left = right
    return found
