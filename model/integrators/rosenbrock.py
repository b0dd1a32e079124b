"""The compiled step loop of every Rosenbrock method: error control, events, rest, dense output, counters.

State y = (q, v) with dq/dt = v. Eliminating the q part of each stage leaves, with W = 1/(gamma h),
(W M - D - K/W) U_v = M r_v + K r_q / W and U_q = (r_q + U_v) / W: one n x n factorisation a step. The loop calls the
four kernels of the scene (see ``model.kernels.codegen.step_kernels``) and keeps all numbers of a step in one array.
On failure the loop stops and says why with a status; the state is the last accepted one.
"""

from math import isfinite

import numpy as np

from model.integrators.stepping import (
    DONE,
    NOT_FINITE,
    SMALLEST_STEP,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    after_step,
    allow,
    begin,
    plan,
    shortened,
)
from model.kernels.compile import kernel, step_loop
from model.kernels.layout import N_CONTACT, N_JACOBIAN, N_REJECTED, N_RESTS, N_RHS, N_SKIPPED, N_STEPS
from model.kernels.signatures import INTEGRATE
from model.kernels.stepping.events import at_rest
from model.kernels.stepping.inputs import constant_until, input_at
from model.kernels.workspace import AUDIT_Q, AUDIT_V, POWER_IN, Q1, SIZE, V1, WIDTH, Q, U, V

WAKING_STEP = 1e-5
STAGE = 2 * WIDTH
GAUSS, WEIGHT = (-0.3872983346207417, 0.0, 0.3872983346207417), (5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0)


@kernel
def fill_outputs(w, dense, x, n, s, row_q, row_v):
    """State at the fraction ``x`` of the step whose stages are in ``w``."""
    for i in range(n):
        dq = 0.0
        dv = 0.0
        for m in range(dense.shape[0] - 1, -1, -1):
            hq = 0.0
            hv = 0.0
            for j in range(s):
                hq += dense[m, j] * w[U + STAGE * j + i]
                hv += dense[m, j] * w[U + STAGE * j + WIDTH + i]
            dq = hq + x * dq
            dv = hv + x * dv
        row_q[i] = (1.0 - x) * w[Q + i] + x * (w[Q1 + i] + (1.0 - x) * dq)
        row_v[i] = (1.0 - x) * w[V + i] + x * (w[V1 + i] + (1.0 - x) * dv)


@step_loop(INTEGRATE)
def integrate(
    t, t_end, h, q, v, table_t, table_u, held, out_t, out_q, out_v, p, parent, linearise, prepare, skip, stage,
    n_contacts, a_, c_, b_, node, d_, dense, gamma, tolerance_q, tolerance_v, exponent, rest_limit, h_max, max_steps,
    counters, times, energy, audit,
):  # fmt: skip
    """Advance (q, v) in place from ``t`` to ``t_end``; fill rows of ``out_q``, ``out_v`` at ``out_t``.

    Adds the time spent at rest to ``times[0]`` and, where ``audit`` (6,) is not empty, work put in and energies lost
    (J) to it, by Gauss's rule along each step's dense output. Returns the time reached, the next step to try, a status.
    """
    n = q.shape[0]
    s = b_.shape[0]
    w = np.zeros(SIZE)
    parts = np.zeros((n, n + 1))
    k_in = 0
    k_out = begin(t, q, v, w, out_t, out_q, out_v)
    n_out = out_t.shape[0]
    status = TOO_MANY_STEPS
    fresh = True
    rejected = False
    u0 = 0.0
    slope = 0.0
    for _ in range(max_steps):
        if t >= t_end:
            break
        if fresh:
            u0, slope, k_in = input_at(t, k_in, table_t, table_u, held)
            linearise(w, p, u0)
            counters[N_RHS] += 1
            counters[N_JACOBIAN] += 1
            counters[N_CONTACT] += n_contacts
            fresh = False
            fastest = 0.0
            for i in range(n):
                fastest = max(fastest, abs(w[V + i]))
            if slope == 0.0 and fastest * h < rest_limit:
                quiet = constant_until(t, k_in, t_end, table_t, table_u, held)
                if quiet > t and at_rest(w, parent, parts, rest_limit):
                    for i in range(n):
                        w[V + i] = 0.0
                    while k_out < n_out and out_t[k_out] <= quiet:
                        out_q[k_out] = w[Q : Q + n]
                        out_v[k_out] = 0.0
                        k_out += 1
                    times[0] += quiet - t
                    counters[N_RESTS] += 1
                    t = quiet
                    h = WAKING_STEP
                    fresh = True
                    continue
        h = min(h, h_max)
        step, fitted, stop = plan(
            t, t_end, h, u0, k_in, held, table_t, table_u, w, p, n, n_contacts, tolerance_q, tolerance_v
        )
        gh = gamma * step
        error = 0.0
        ok = prepare(w, gh) == 1
        if ok:
            # contacts are left out only while every stage stays within these allowances: the answer is the same
            allow(w, step)
            mask = skip(w, p)
            looked_at = n_contacts
            bits = mask
            while bits:
                bits &= bits - 1
                looked_at -= 1
            u = u0
            for m in range(s):
                if m > 0 and not held:
                    u, _, k_in = input_at(t + node[m] * step, k_in, table_t, table_u, held)
                all_of_them = stage(w, p, a_, c_, m, gh, step, u, step * d_[m] * slope, mask) == 1
                if m > 0:
                    counters[N_CONTACT] += n_contacts if all_of_them else looked_at
                    counters[N_SKIPPED] += 0 if all_of_them else n_contacts - looked_at
            counters[N_RHS] += s - 1
            for i in range(STAGE):
                x = w[Q + i]
                for m in range(s):
                    x += b_[m] * w[U + STAGE * m + i]
                w[Q1 + i] = x
            last = U + STAGE * (s - 1)
            for i in range(n):
                eq = abs(w[last + i]) / tolerance_q
                ev = abs(w[last + WIDTH + i]) / tolerance_v
                if not (isfinite(eq) and isfinite(ev)):
                    ok = False
                error = max(error, eq, ev)
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
        while k_out < n_out and out_t[k_out] <= t1:
            fill_outputs(w, dense, (out_t[k_out] - t) / step, n, s, out_q[k_out], out_v[k_out])
            k_out += 1
        if audit.shape[0] > 0:
            for g in range(3):
                x = 0.5 + GAUSS[g]
                fill_outputs(w, dense, x, n, s, w[AUDIT_Q : AUDIT_Q + n], w[AUDIT_V : AUDIT_V + n])
                u, _, k_in = input_at(t + x * step, k_in, table_t, table_u, held)
                energy(w, p, u0 if held else u)
                for j in range(audit.shape[0]):
                    audit[j] += step * WEIGHT[g] * w[POWER_IN + j]
        h = after_step(step, error, exponent, rejected, fitted, h)
        rejected = False
        for i in range(STAGE):
            w[Q + i] = w[Q1 + i]
        t = t1
        fresh = True
    if t >= t_end:
        status = DONE
    for i in range(n):
        q[i] = w[Q + i]
        v[i] = w[V + i]
    return t, h, status
