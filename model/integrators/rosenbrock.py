"""The compiled step loop of every Rosenbrock method: error control, events, rest, dense output, counters.

State y = (q, v) with dq/dt = v, and what felt remembers, which the kernels eliminate. Eliminating the q part of each
stage leaves, with W = 1/(gamma h), (W M - D - K/W) U_v = M r_v + K r_q / W and U_q = (r_q + U_v) / W: one n x n
factorisation a step. The loop calls the four kernels of the scene (see `model.derived.step`) and
keeps all numbers of a step in one array.
On failure the loop stops and says why with a status; the state is the last accepted one.
"""

from math import isfinite

import numpy as np
from numba import int64

from model.integrators.step_control import (
    DONE,
    NOT_FINITE,
    SMALLEST_STEP,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    after_step,
    allow,
    begin,
    ending_at,
    next_stop,
    shortened,
)
from model.kernels.compile import inlined, step_loop, uncounted
from model.kernels.layout import N_CONTACT, N_JACOBIAN, N_REJECTED, N_RESTS, N_RHS, N_SKIPPED, N_STEPS
from model.kernels.signatures import INTEGRATE
from model.kernels.stepping.events import at_rest, fit_to_events
from model.kernels.stepping.inputs import constant_until, fit_to_input, input_at
from model.kernels.workspace import (
    AUDIT_Q,
    AUDIT_V,
    AUDIT_Z,
    MOST_MEMORIES,
    NOW,
    POWER_IN,
    Q1,
    SIZE,
    V1,
    WIDTH,
    WITH_MEMORY,
    Z1,
    Z_U,
    Z_WEIGHT,
    Q,
    U,
    V,
    Z,
)

WAKING_STEP = 1e-5
STAGE = 2 * WIDTH
GAUSS, WEIGHT = (-0.3872983346207417, 0.0, 0.3872983346207417), (5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0)


@uncounted
def fill_dense(w, dense, within):
    """What the state inside the step whose stages are in ``w`` is made of: rows of ``within``, for `fill_outputs`."""
    for m in range(dense.shape[0]):
        for i in range(STAGE):
            within[m, i] = 0.0
        for j in range(dense.shape[1]):
            weight = dense[m, j]
            for i in range(STAGE):
                within[m, i] += weight * w[U + STAGE * j + i]


@uncounted
def fill_outputs(w, within, x, n, row_q, row_v):
    """State at the fraction ``x`` of the step."""
    last = within.shape[0] - 1
    for i in range(n):
        dq = within[last, i]
        dv = within[last, WIDTH + i]
        for m in range(last - 1, -1, -1):
            dq = within[m, i] + x * dq
            dv = within[m, WIDTH + i] + x * dv
        row_q[i] = (1.0 - x) * w[Q + i] + x * (w[Q1 + i] + (1.0 - x) * dq)
        row_v[i] = (1.0 - x) * w[V + i] + x * (w[V1 + i] + (1.0 - x) * dv)


@inlined
def stay(until, k_out, out, w, n):
    """Stop all motion and fill the outputs wanted up to ``until``; returns how many are filled."""
    for i in range(n):
        w[V + i] = 0.0
    while k_out < out.time.shape[0] and out.time[k_out] <= until:
        for i in range(n):
            out.angle[k_out, i] = w[Q + i]
            out.speed[k_out, i] = 0.0
        k_out += 1
    return k_out


@inlined
def bits_of(mask):
    """How many bits of ``mask`` are set."""
    count = 0
    while mask:
        mask &= mask - 1
        count += 1
    return count


@inlined
def advance_to_end(w, b):
    """The state at the end of the step from its stages."""
    for i in range(STAGE):
        w[Q1 + i] = w[Q + i]
    for m in range(b.shape[0]):
        for i in range(STAGE):  # innermost, so that it becomes vector instructions
            w[Q1 + i] += b[m] * w[U + STAGE * m + i]


@inlined
def embedded_error(w, stage, n, limits):
    """Whether the estimate, the ``stage`` that serves as one, is finite, and its size against the tolerances."""
    last = U + STAGE * stage
    finite = True
    largest_q = 0.0
    largest_v = 0.0
    for i in range(n):
        eq = abs(w[last + i])
        ev = abs(w[last + WIDTH + i])
        if not (isfinite(eq) and isfinite(ev)):
            finite = False
        largest_q = max(largest_q, eq)
        largest_v = max(largest_v, ev)
    error = max(largest_q / limits.angle, largest_v / limits.speed)
    return finite and isfinite(error), error


@uncounted
def fill_memories(w, dense, x, n, row):
    """Memories at the fraction ``x`` of the step whose stages are in ``w``."""
    for i in range(n):
        inside = 0.0
        for m in range(dense.shape[0] - 1, -1, -1):
            part = 0.0
            for j in range(dense.shape[1]):
                part += dense[m, j] * w[Z_U + MOST_MEMORIES * j + i]
            inside = part + x * inside
        row[i] = (1.0 - x) * w[Z + i] + x * (w[Z1 + i] + (1.0 - x) * inside)


@inlined
def end_memories(w, b, n, limits, error):
    """Memories at the end of the step; the larger of ``error`` and theirs, not finite where one is."""
    s = b.shape[0]
    for i in range(n):
        end = w[Z + i]
        for m in range(s):
            end += b[m] * w[Z_U + MOST_MEMORIES * m + i]
        w[Z1 + i] = end
        wrong = abs(w[Z_U + MOST_MEMORIES * (s - 1) + i]) * w[Z_WEIGHT + i] / limits.speed
        error = wrong if not wrong <= error else error
    return error


@step_loop(INTEGRATE)
def integrate(span, drive, out, scene, kernels, method, limits, account):
    """Advance the state of ``span`` in place to its end; fill the rows of ``out``.

    Adds the time spent at rest to ``account`` and, where its ``energies`` (6,) are not empty, work put in and energies
    lost (J), by Gauss's rule along each step's dense output. Returns the time reached, the next step to try, a status.
    """
    t, t_end, h, q, v, z = span
    p, parent, n_contacts = scene
    linearise, prepare, skip, stage, energy = kernels
    a, c, b, node, d, dense, gamma, exponent = method
    out_t, out_q, out_v, out_z = out
    counters, times, energies = account
    n = q.shape[0]
    s = b.shape[0]
    n_z = z.shape[0]
    w = np.zeros(SIZE if n_z == 0 else WITH_MEMORY)
    for i in range(n_z):
        w[Z + i] = z[i]
    parts = np.zeros((n, n + 1))
    within = np.zeros((dense.shape[0], STAGE))
    k_in = int64(0)  # a plain 0 would be a type of its own, for which what takes it is compiled once more
    k_out = begin(span, out, w)
    status = TOO_MANY_STEPS
    fresh = True
    rejected = False
    u0 = 0.0
    slope = 0.0
    for _ in range(limits.most_steps):
        if t >= t_end:
            break
        if fresh:
            u0, slope, k_in = input_at(t, k_in, drive)
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
                quiet = constant_until(t, k_in, t_end, 0, last, drive.time, drive.value, drive.held)
                if quiet > t and at_rest(w, parent, parts, limits.rest):
                    k_out = stay(quiet, k_out, out, w, n)
                    times[0] += quiet - t
                    counters[N_RESTS] += 1
                    t = quiet
                    h = WAKING_STEP
                    fresh = True
                    continue
        h = min(h, limits.longest_step)
        stop = next_stop(t, t_end, k_in, drive)
        fitted = fit_to_events(h, w, scene, limits.speed)
        step = ending_at(stop, t, fitted)
        if not drive.held:
            step = fit_to_input(t, step, u0, k_in, drive, w, n, limits)
        gh = gamma * step
        error = 0.0
        ok = prepare(w, gh) == 1
        if ok:
            # contacts are left out only while every stage stays within these allowances: the answer is the same
            allow(w, step)
            mask = skip(w, p)
            evaluated = n_contacts - bits_of(mask)
            rate = 1.0 / step
            u = u0
            for m in range(s):
                if m > 0 and not drive.held and (m == 1 or node[m] != node[m - 1]):
                    u, _, k_in = input_at(t + node[m] * step, k_in, drive)
                exceeded = stage(w, p, a, c, m, gh, rate, u, step * d[m] * slope, mask) == 1
                if m > 0:
                    counters[N_CONTACT] += n_contacts if exceeded else evaluated
                    counters[N_SKIPPED] += 0 if exceeded else n_contacts - evaluated
            counters[N_RHS] += s - 1
            advance_to_end(w, b)
            ok, error = embedded_error(w, s - 1, n, limits)
            if n_z > 0:
                error = end_memories(w, b, n_z, limits, error)
                ok = ok and isfinite(error)
        if not ok or error > 1.0:
            counters[N_REJECTED] += 1
            rejected = True
            h = shortened(step, error, exponent) if ok else 0.2 * step
            if h < SMALLEST_STEP:
                status = STEP_TOO_SMALL if ok else NOT_FINITE
                break
            continue
        counters[N_STEPS] += 1
        t1 = stop if step == stop - t else t + step
        audited = energies.shape[0] > 0
        if audited or (k_out < out_t.shape[0] and out_t[k_out] <= t1):
            fill_dense(w, dense, within)
        while k_out < out_t.shape[0] and out_t[k_out] <= t1:
            x = (out_t[k_out] - t) / step
            fill_outputs(w, within, x, n, out_q[k_out], out_v[k_out])
            if n_z > 0:
                fill_memories(w, dense, x, n_z, out_z[k_out])
            k_out += 1
        if audited:
            for g in range(3):
                x = 0.5 + GAUSS[g]
                fill_outputs(w, within, x, n, w[AUDIT_Q : AUDIT_Q + n], w[AUDIT_V : AUDIT_V + n])
                if n_z > 0:
                    fill_memories(w, dense, x, n_z, w[AUDIT_Z : AUDIT_Z + n_z])
                u, _, k_in = input_at(t + x * step, k_in, drive)
                energy(w, p, u0 if drive.held else u)
                for j in range(energies.shape[0]):
                    energies[j] += step * WEIGHT[g] * w[POWER_IN + j]
        h = after_step(step, error, exponent, rejected, fitted, h)
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
