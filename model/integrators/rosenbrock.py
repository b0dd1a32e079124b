"""Step loop of the Rosenbrock methods: error control, events, rest, dense output, work counters.

State y = (q, v) with dq/dt = v, and what felt remembers, which the kernels eliminate. Eliminating the q part of each
stage leaves, with W = 1/(gamma h), (W M - D - K/W) U_v = M r_v + K r_q / W and U_q = (r_q + U_v) / W: one n x n
factorisation a step. The loop calls the four kernels of the scene (see `model.codegen.step_programs`) and
keeps all numbers of a step in one array.
On failure the loop stops and says why with a status; the state is the last accepted one.
"""

import numpy as np
from numba import int64

from model.integrators.step_control import (
    DONE,
    FAILED,
    FIRST_STEP,
    FULL,
    NOT_FINITE,
    SMALLEST_STEP,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    fit_to_stop,
    inverse_power,
    is_at_rest,
    load_start,
    next_step_size,
    next_stop,
    rejected_step_size,
    set_motion_bounds,
)
from model.kernels.compile import inlined, step_loop, uncounted
from model.kernels.inputs import constant_until, fit_to_input, interpolate_own_input
from model.kernels.layout import N_CONTACT, N_JACOBIAN, N_REJECTED, N_RESTS, N_RHS, N_SKIPPED, N_STEPS
from model.kernels.signatures import INTEGRATE
from model.kernels.workspace import (
    ANGLE_LIMIT,
    AUDIT_Q,
    AUDIT_V,
    AUDIT_Z,
    DENSE,
    ERROR,
    FITTED,
    FRACTION,
    MOST_MEMORIES,
    NOW,
    POWER_IN,
    Q1,
    SIZE,
    SPEED_LIMIT,
    V1,
    WIDTH,
    WITH_MEMORY,
    Z1,
    Z_DENSE,
    Q,
    V,
    Z,
)

STAGE = 2 * WIDTH
GAUSS_NODES = (-0.3872983346207417, 0.0, 0.3872983346207417)
GAUSS_WEIGHTS = (5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0)


@inlined
def fill_rest_outputs(until, k_out, out, w, n):
    """Set all speeds to zero and fill the outputs from number ``k_out`` up to the time ``until``; return the number of
    the next."""
    for i in range(n):
        w[V + i] = 0.0
    while k_out < out.time.shape[0] and out.time[k_out] <= until:
        for i in range(n):
            out.angle[k_out, i] = w[Q + i]
            out.speed[k_out, i] = 0.0
        k_out += 1
    return k_out


@inlined
def count_bits(mask):
    count = 0
    while mask:
        mask &= mask - 1
        count += 1
    return count


@uncounted
def record_step(w, n_dense, n, n_z, row):
    """Copy a step's ends and dense output, angles, speeds and internal variables, to a row of the record."""
    size = 2 * n + n_z
    for i in range(n):
        row[i], row[n + i] = w[Q + i], w[V + i]
        row[size + i], row[size + n + i] = w[Q1 + i], w[V1 + i]
        for m in range(n_dense):
            at = DENSE + STAGE * m + i
            row[(2 + m) * size + i], row[(2 + m) * size + n + i] = w[at], w[at + WIDTH]
    for i in range(n_z):
        row[2 * n + i], row[size + 2 * n + i] = w[Z + i], w[Z1 + i]
        for m in range(n_dense):
            row[(2 + m) * size + 2 * n + i] = w[Z_DENSE + MOST_MEMORIES * m + i]


@step_loop(INTEGRATE)
def integrate(span, drive, out, scene, kernels, method, limits, account):
    """Advance the state of ``span`` in place to its end under the input ``drive``, fill rows of ``out`` at its times,
    count in ``account``; return the time reached, s, the next step to try, s, and a status, `DONE` or why it stopped.

    Adds the time spent at rest to ``account`` and, where its ``energies`` (6,) are not empty, work put in and energies
    lost (J), by Gauss's rule along each step's dense output. The counter of steps tells which rows of ``out.steps`` are
    filled.
    """
    t, t_end, h, q, v, z = span
    p, parent, n_contacts = scene
    linearise, prepare, skip, stage, fit, end, dense_sums, inside, energy = kernels
    a, c, b, node, d, dense, gamma, exponent = method
    out_t, out_q, out_v, out_z, steps = out
    counters, times, energies = account
    n = q.shape[0]
    s = b.shape[0]
    n_z = z.shape[0]
    w = np.zeros(SIZE if n_z == 0 else WITH_MEMORY)
    for i in range(n_z):
        w[Z + i] = z[i]
    parts = np.zeros((n, n + 1))
    n_dense = dense.shape[0]
    w[ANGLE_LIMIT], w[SPEED_LIMIT] = limits.angle, limits.speed
    k_in = int64(0)  # a plain 0 would be a type of its own, for which what takes it is compiled once more
    k_out = load_start(span, out, w)
    kept = int64(0)
    recorded = steps.shape[0] > 0
    status = TOO_MANY_STEPS
    fresh = True
    rejected = False
    u0 = 0.0
    slope = 0.0
    quiet = t
    for _ in range(limits.most_steps):
        if t >= t_end:
            break
        if recorded and kept == steps.shape[0]:
            status = FULL
            break
        if fresh:
            u0, slope, k_in = interpolate_own_input(t, k_in, drive)
            if n_z > 0:
                w[NOW] = t
            linearise(w, p, u0)
            counters[N_RHS] += 1
            counters[N_JACOBIAN] += 1
            counters[N_CONTACT] += n_contacts
            fresh = False
            fastest = 0.0
            for i in range(n):
                fastest = max(fastest, abs(w[V + i]))
            # felt that remembers may still creep: what it will do, the bound on rest does not know
            if n_z == 0 and slope == 0.0 and fastest * h < limits.rest:
                last = drive.time.shape[0] - 1
                if quiet <= t:
                    quiet = constant_until(t, k_in, t_end, 0, last, drive)
                if quiet > t and is_at_rest(w, parent, parts, limits.rest):
                    k_out = fill_rest_outputs(quiet, k_out, out, w, n)
                    times[0] += quiet - t
                    counters[N_RESTS] += 1
                    t = quiet
                    h = FIRST_STEP
                    fresh = True
                    continue
        h = min(h, limits.longest_step)
        stop = next_stop(t, t_end, k_in, drive)
        w[FITTED] = h
        fit(w, p)
        fitted = w[FITTED]
        step = fit_to_stop(stop, t, fitted)
        if not drive.held:
            step = fit_to_input(t, step, u0, k_in, drive, w, n, limits)
        gh = gamma * step
        error = 0.0
        ok = prepare(w, gh) == 1
        if ok:
            # contacts are left out only while every stage stays within these allowances: the answer is the same
            set_motion_bounds(w, step)
            mask = skip(w, p)
            evaluated = n_contacts - count_bits(mask)
            rate = 1.0 / step
            u = u0
            for m in range(s):
                if m > 0 and not drive.held and (m == 1 or node[m] != node[m - 1]):
                    u, _, k_in = interpolate_own_input(t + node[m] * step, k_in, drive)
                exceeded = stage(w, p, a, c, m, gh, rate, u, step * d[m] * slope, mask) == 1
                if m > 0:
                    counters[N_CONTACT] += n_contacts if exceeded else evaluated
                    counters[N_SKIPPED] += 0 if exceeded else n_contacts - evaluated
            counters[N_RHS] += s - 1
            ok = end(w, b, s, n_z) == 1
            error = w[ERROR]
        power = inverse_power(error, exponent)
        if not ok or error > 1.0:
            counters[N_REJECTED] += 1
            rejected = True
            h = rejected_step_size(step, power) if ok else FAILED * step
            if h < SMALLEST_STEP:
                status = STEP_TOO_SMALL if ok else NOT_FINITE
                break
            continue
        counters[N_STEPS] += 1
        t1 = stop if step == stop - t else t + step
        audited = energies.shape[0] > 0
        if audited or recorded or (k_out < out_t.shape[0] and out_t[k_out] <= t1):
            dense_sums(w, dense, n_dense, s, n_z)
        if recorded:
            steps[kept, 0], steps[kept, 1] = t, step
            record_step(w, n_dense, n, n_z, steps[kept, 2:])
            kept += 1
        while k_out < out_t.shape[0] and out_t[k_out] <= t1:
            w[FRACTION] = (out_t[k_out] - t) / step
            inside(w, n_dense, n_z)
            for i in range(n):
                out_q[k_out, i] = w[AUDIT_Q + i]
                out_v[k_out, i] = w[AUDIT_V + i]
            for i in range(n_z):
                out_z[k_out, i] = w[AUDIT_Z + i]
            k_out += 1
        if audited:
            for g in range(3):
                w[FRACTION] = 0.5 + GAUSS_NODES[g]
                inside(w, n_dense, n_z)
                u, _, k_in = interpolate_own_input(t + w[FRACTION] * step, k_in, drive)
                energy(w, p, u0 if drive.held else u)
                for j in range(energies.shape[0]):
                    energies[j] += step * GAUSS_WEIGHTS[g] * w[POWER_IN + j]
        h = next_step_size(step, power, rejected, fitted, h)
        rejected = False
        for i in range(STAGE):
            w[Q + i] = w[Q1 + i]
        for i in range(n_z):
            w[Z + i] = w[Z1 + i]
        t = t1
        fresh = True
    if t >= t_end:
        status = DONE
    for i in range(n):
        q[i] = w[Q + i]
        v[i] = w[V + i]
    for i in range(n_z):
        z[i] = w[Z + i]
    return t, h, status
