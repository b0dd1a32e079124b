"""The compiled step loop of diagonally implicit methods with an explicit first stage (ESDIRK): for comparison.

Stage i solves Y = y + h sum_j<i a_ij k_j + h gamma F(Y) by Newton's method with the factors of the step's start.
The scene's ``stage`` kernel does one iteration: with Z = Y - y in slot 0 and S = h sum a_ij k_j in slot 1 it solves
(1/(gamma h) - J) D = F(y + Z) + (S - Z) / (gamma h). Events and input as in ``rosenbrock``; no energy audit, and
rest is stepped.
"""

from math import isfinite

import numpy as np

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
from model.kernels.compile import step_loop
from model.kernels.inputs import fit_to_input, input_at
from model.kernels.layout import N_CONTACT, N_JACOBIAN, N_REJECTED, N_RHS, N_STEPS
from model.kernels.signatures import INTEGRATE
from model.kernels.workspace import ACC, FITTED, Q1, SIZE, SPEED_LIMIT, WIDTH, Q, U, V

PAIR = 2 * WIDTH
MOST_ITERATIONS = 8
SOLVED = 0.02  # of the tolerance: what the iteration may leave
DIVERGING = 0.9


@step_loop(INTEGRATE)
def integrate_diagonal(span, drive, out, scene, kernels, method, limits, account):
    """As ``rosenbrock.integrate``, without rest and energy audit; ``dense`` holds a and the error's weights."""
    t, t_end, h, q, v, _ = span
    p, _, n_contacts = scene
    linearise, prepare, skip, stage, fit = kernels.linearise, kernels.prepare, kernels.skip, kernels.stage, kernels.fit
    counters, _, _ = account
    n, s, gamma, dense = q.shape[0], method.b.shape[0], method.gamma, method.dense
    w = np.zeros(SIZE)
    w[SPEED_LIMIT] = limits.speed
    slope_of = np.zeros((s, PAIR))  # h k of each stage
    k_in = 0
    k_out = begin(span, out, w)
    status = TOO_MANY_STEPS
    fresh = True
    rejected = False
    u0 = 0.0
    for _ in range(limits.most_steps):
        if t >= t_end:
            break
        if fresh:
            u0, _, k_in = input_at(t, k_in, drive)
            linearise(w, p, u0)
            counters[N_RHS] += 1
            counters[N_JACOBIAN] += 1
            counters[N_CONTACT] += n_contacts
            fresh = False
        h = min(h, limits.longest_step)
        stop = next_stop(t, t_end, k_in, drive)
        w[FITTED] = h
        fit(w, p)
        fitted = w[FITTED]
        step = ending_at(stop, t, fitted)
        if not drive.held:
            step = fit_to_input(t, step, u0, k_in, drive, w, n, limits)
        gh = gamma * step
        error = 0.0
        ok = prepare(w, gh) == 1
        if ok:
            allow(w, step)
            mask = skip(w, p)
            for i in range(n):
                slope_of[0, i] = step * w[V + i]
                slope_of[0, WIDTH + i] = step * w[ACC + i]
            for m in range(1, s):
                u = u0
                if not drive.held:
                    u, _, k_in = input_at(t + method.node[m] * step, k_in, drive)
                for i in range(PAIR):
                    x = 0.0
                    for j in range(m):
                        x += dense[m, j] * slope_of[j, i]
                    w[U + PAIR + i] = x
                    w[U + i] = x + gamma * slope_of[m - 1, i]
                before = 0.0
                solved = False
                for iteration in range(MOST_ITERATIONS):
                    stage(w, p, method.a, method.c, 2, gh, 1.0 / step, u, 0.0, mask)
                    counters[N_RHS] += 1
                    counters[N_CONTACT] += n_contacts
                    change = 0.0
                    for i in range(n):
                        dq = w[U + 2 * PAIR + i]
                        dv = w[U + 2 * PAIR + WIDTH + i]
                        change = max(change, abs(dq) / limits.angle, abs(dv) / limits.speed)
                        w[U + i] += dq
                        w[U + WIDTH + i] += dv
                    if not isfinite(change):
                        break
                    rate = change / before if iteration > 0 and before > 0.0 else 0.5
                    if rate >= DIVERGING:
                        break
                    if change * rate / (1.0 - rate) <= SOLVED:
                        solved = True
                        break
                    before = change
                if not solved:
                    ok = False
                    break
                for i in range(PAIR):
                    slope_of[m, i] = (w[U + i] - w[U + PAIR + i]) / gamma
            if ok:
                for i in range(PAIR):
                    w[Q1 + i] = w[Q + i] + w[U + i]  # stiffly accurate
                for i in range(n):
                    eq = 0.0
                    ev = 0.0
                    for m in range(s):
                        eq += dense[s, m] * slope_of[m, i]
                        ev += dense[s, m] * slope_of[m, WIDTH + i]
                    error = max(error, abs(eq) / limits.angle, abs(ev) / limits.speed)
        if not ok or not error <= 1.0:
            counters[N_REJECTED] += 1
            rejected = True
            h = shortened(step, error, method.exponent) if ok and isfinite(error) else 0.3 * step
            if h < SMALLEST_STEP:
                status = STEP_TOO_SMALL if ok else NOT_FINITE
                break
            continue
        counters[N_STEPS] += 1
        t1 = stop if step == stop - t else t + step
        while k_out < out.time.shape[0] and out.time[k_out] <= t1:
            x = (out.time[k_out] - t) / step
            for i in range(n):
                for o, row in ((0, out.angle), (WIDTH, out.speed)):
                    rise = w[Q1 + o + i] - w[Q + o + i]
                    left = slope_of[0, o + i] - rise
                    right = slope_of[s - 1, o + i] - rise
                    row[k_out, i] = w[Q + o + i] + x * (rise + (1.0 - x) * (left * (1.0 - x) - right * x))
            k_out += 1
        h = after_step(step, error, method.exponent, rejected, fitted, h)
        rejected = False
        for i in range(PAIR):
            w[Q + i] = w[Q1 + i]
        t = t1
        fresh = True
    if t >= t_end:
        status = DONE
    for i in range(n):
        q[i] = w[Q + i]
        v[i] = w[V + i]
    return t, h, status
