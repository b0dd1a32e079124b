"""The compiled step loop of collocation methods with three coupled stages (Radau IIA): for comparison.

Z_i = h sum_j a_ij F(y + Z_j) is solved by Newton's method with the Jacobian of the step's start, for W = T^-1 Z: one
real and one complex system, each n x n after dq/dt = v is eliminated (Hairer and Wanner II, IV.8). The scene's
``stage`` kernel gives M F_v alone: its factors are set to one, its gamma h to zero; ``prepare`` is not called.
Iterations start from the last step's polynomial. Events and input as in ``rosenbrock``; no energy audit, and rest is
stepped.
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
from model.kernels.compile import kernel, step_loop
from model.kernels.inputs import fit_to_input, input_at
from model.kernels.layout import N_CONTACT, N_JACOBIAN, N_REJECTED, N_RHS, N_STEPS
from model.kernels.signatures import INTEGRATE
from model.kernels.workspace import ACC, DAMP, FITTED, LU, M_DIAG, M_UP, SIZE, SPEED_LIMIT, STIFF, WIDTH, Q, U, V

PAIR = 2 * WIDTH
MOST_ITERATIONS = 10
SOLVED = 0.02  # of the tolerance: what the iteration may leave
DIVERGING = 0.9
FARTHEST = 5.0  # lengths of the last step that its polynomial is trusted to reach


@kernel
def inertia_times(w, parent, n, x, out):
    """M x, with the mass matrix of the step's start."""
    for i in range(n):
        out[i] = w[M_DIAG + i] * x[i]
    for i in range(n):
        j = parent[i]
        if 0 <= j < n:
            out[i] += w[M_UP + i] * x[j]
            out[j] += w[M_UP + i] * x[i]


@kernel
def factorise(w, parent, n, scale, lu, pivot):
    """LU of scale M - D - K / scale with row exchanges; False where it is singular or not finite."""
    for i in range(n):
        for j in range(n):
            lu[i, j] = -w[DAMP + WIDTH * i + j] - w[STIFF + WIDTH * i + j] / scale
        lu[i, i] += scale * w[M_DIAG + i]
    for i in range(n):
        j = parent[i]
        if 0 <= j < n:
            lu[i, j] += scale * w[M_UP + i]
            lu[j, i] += scale * w[M_UP + i]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(lu[i, k]) > abs(lu[best, k]):
                best = i
        pivot[k] = best
        if not (abs(lu[best, k]) > 0.0 and isfinite(abs(lu[best, k]))):
            return False
        for j in range(n):
            lu[k, j], lu[best, j] = lu[best, j], lu[k, j]
        for i in range(k + 1, n):
            lu[i, k] /= lu[k, k]
            for j in range(k + 1, n):
                lu[i, j] -= lu[i, k] * lu[k, j]
    return True


@kernel
def solve(w, n, scale, lu, pivot, x_q, x_v):
    """(scale - J) x = r in place: r_q in ``x_q``, M r_v in ``x_v``."""
    for i in range(n):
        for j in range(n):
            x_v[i] += w[STIFF + WIDTH * i + j] * x_q[j] / scale
    for k in range(n):
        x_v[k], x_v[pivot[k]] = x_v[pivot[k]], x_v[k]
    for i in range(n):
        for j in range(i):
            x_v[i] -= lu[i, j] * x_v[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x_v[i] -= lu[i, j] * x_v[j]
        x_v[i] /= lu[i, i]
    for i in range(n):
        x_q[i] = (x_q[i] + x_v[i]) / scale


@step_loop(INTEGRATE)
def integrate_coupled(span, drive, out, scene, kernels, method, limits, account):
    """As ``rosenbrock.integrate``, without rest and energy audit; ``dense`` as in ``CoupledTableau``."""
    t, t_end, h, q, v, _ = span
    p, parent, n_contacts = scene
    linearise, skip, stage, fit = kernels.linearise, kernels.skip, kernels.stage, kernels.fit
    counters, _, _ = account
    n, gamma, dense = q.shape[0], method.gamma, method.dense
    w = np.zeros(SIZE)
    w[SPEED_LIMIT] = limits.speed
    to_z, to_w, polynomial, estimate = dense[0:3], dense[3:6], dense[6:9], dense[9]
    pair = complex(dense[10, 0], dense[10, 1])
    z = np.zeros((3, PAIR))
    z_w = np.zeros((3, PAIR))  # T^-1 Z
    f = np.zeros((3, PAIR))  # F_q, M F_v
    course = np.zeros((3, PAIR))  # polynomial of the last accepted step
    course_step = 0.0
    u_at = np.zeros(3)
    lu = np.zeros((n, n))
    lu2 = np.zeros((n, n), np.complex128)
    pivot = np.zeros(n, np.int64)
    pivot2 = np.zeros(n, np.int64)
    x_q, x_v, e_q, e_v = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    y_q, y_v = np.zeros(n, np.complex128), np.zeros(n, np.complex128)
    turned = np.zeros(n, np.complex128)
    heavy = np.zeros(n, np.complex128)
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
        error = 0.0
        real, two = gamma / step, pair / step
        ok = factorise(w, parent, n, real, lu, pivot) and factorise(w, parent, n, two, lu2, pivot2)
        if ok:
            allow(w, step)
            for i in range(WIDTH):
                for j in range(WIDTH):
                    w[LU + WIDTH * i + j] = 1.0 if i == j else 0.0
            mask = skip(w, p)
            known = course_step > 0.0 and step <= FARTHEST * course_step
            for m in range(3):
                u_at[m] = u0
                if not drive.held:
                    u_at[m], _, k_in = input_at(t + method.node[m] * step, k_in, drive)
                s = 1.0 + method.node[m] * step / course_step if known else 0.0
                for i in range(n):
                    if known:
                        for o in (i, WIDTH + i):
                            z[m, o] = (s - 1.0) * course[0, o] + (s * s - 1.0) * course[1, o]
                            z[m, o] += (s * s * s - 1.0) * course[2, o]
                    else:
                        z[m, i] = method.node[m] * step * w[V + i]
                        z[m, WIDTH + i] = method.node[m] * step * w[ACC + i]
            for m in range(3):
                for i in range(PAIR):
                    z_w[m, i] = to_w[m, 0] * z[0, i] + to_w[m, 1] * z[1, i] + to_w[m, 2] * z[2, i]
            before = 0.0
            solved = False
            for iteration in range(MOST_ITERATIONS):
                for m in range(3):
                    for i in range(PAIR):
                        w[U + i] = z[m, i]
                    stage(w, p, method.a, method.c, 2, 0.0, 1.0, u_at[m], 0.0, mask)
                    for i in range(n):
                        f[m, i] = w[V + i] + z[m, WIDTH + i]
                        f[m, WIDTH + i] = w[U + 2 * PAIR + WIDTH + i]
                counters[N_RHS] += 3
                counters[N_CONTACT] += 3 * n_contacts
                for i in range(n):
                    e_v[i] = real * z_w[0, WIDTH + i]
                    turned[i] = two * complex(z_w[1, WIDTH + i], z_w[2, WIDTH + i])
                inertia_times(w, parent, n, e_v, x_v)
                inertia_times(w, parent, n, turned, heavy)
                for i in range(n):
                    x_q[i] = -real * z_w[0, i]
                    x_v[i] = -x_v[i]
                    y_q[i] = -two * complex(z_w[1, i], z_w[2, i])
                    y_v[i] = -heavy[i]
                    for m in range(3):
                        x_q[i] += to_w[0, m] * f[m, i]
                        x_v[i] += to_w[0, m] * f[m, WIDTH + i]
                        y_q[i] += complex(to_w[1, m], to_w[2, m]) * f[m, i]
                        y_v[i] += complex(to_w[1, m], to_w[2, m]) * f[m, WIDTH + i]
                solve(w, n, real, lu, pivot, x_q, x_v)
                solve(w, n, two, lu2, pivot2, y_q, y_v)
                change = 0.0
                sound = True
                for i in range(n):
                    for o, x, y, tolerance in ((i, x_q, y_q, limits.angle), (WIDTH + i, x_v, y_v, limits.speed)):
                        z_w[0, o] += x[i]
                        z_w[1, o] += y[i].real
                        z_w[2, o] += y[i].imag
                        for m in range(3):
                            dz = to_z[m, 0] * x[i] + to_z[m, 1] * y[i].real + to_z[m, 2] * y[i].imag
                            z[m, o] += dz
                            change = max(change, abs(dz) / tolerance)
                            sound = sound and isfinite(dz)
                if not sound:
                    break
                rate = change / before if iteration > 0 and before > 0.0 else 0.5
                if rate >= DIVERGING:
                    break
                if change * rate / (1.0 - rate) <= SOLVED:
                    solved = True
                    break
                before = change
            ok = solved
            if ok:
                for i in range(n):
                    x_q[i] = w[V + i]
                    e_v[i] = w[ACC + i]
                    for m in range(3):
                        x_q[i] += estimate[m] * z[m, i] / step
                        e_v[i] += estimate[m] * z[m, WIDTH + i] / step
                inertia_times(w, parent, n, e_v, x_v)
                solve(w, n, real, lu, pivot, x_q, x_v)
                for i in range(n):
                    error = max(error, abs(x_q[i]) / limits.angle, abs(x_v[i]) / limits.speed)
                if error > 1.0 and (rejected or course_step == 0.0):
                    # once more through the filter: what is stiff and has died out counts no longer
                    for i in range(PAIR):
                        w[U + i] = 0.0
                    for i in range(n):
                        w[U + i] = x_q[i]
                        w[U + WIDTH + i] = x_v[i]
                    stage(w, p, method.a, method.c, 2, 0.0, 1.0, u0, 0.0, mask)
                    counters[N_RHS] += 1
                    counters[N_CONTACT] += n_contacts
                    for i in range(n):
                        e_q[i] = w[V + i] + x_v[i]
                        e_v[i] = 0.0
                        for m in range(3):
                            e_q[i] += estimate[m] * z[m, i] / step
                            e_v[i] += estimate[m] * z[m, WIDTH + i] / step
                    inertia_times(w, parent, n, e_v, x_v)
                    error = 0.0
                    for i in range(n):
                        x_q[i] = e_q[i]
                        x_v[i] += w[U + 2 * PAIR + WIDTH + i]
                    solve(w, n, real, lu, pivot, x_q, x_v)
                    for i in range(n):
                        error = max(error, abs(x_q[i]) / limits.angle, abs(x_v[i]) / limits.speed)
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
        for m in range(3):
            for i in range(PAIR):
                course[m, i] = polynomial[m, 0] * z[0, i] + polynomial[m, 1] * z[1, i] + polynomial[m, 2] * z[2, i]
        course_step = step if t1 < stop else 0.0  # starts anew after a stop, as a run in pieces does: same bits
        while k_out < out.time.shape[0] and out.time[k_out] <= t1:
            x = (out.time[k_out] - t) / step
            for i in range(n):
                for o, row in ((0, out.angle), (WIDTH, out.speed)):
                    rise = course[0, o + i] + x * (course[1, o + i] + x * course[2, o + i])
                    row[k_out, i] = w[Q + o + i] + x * rise
            k_out += 1
        h = after_step(step, error, method.exponent, rejected, fitted, h)
        rejected = False
        for i in range(n):
            w[Q + i] += z[2, i]  # stiffly accurate
            w[V + i] += z[2, WIDTH + i]
        t = t1
        fresh = True
    if t >= t_end:
        status = DONE
    for i in range(n):
        q[i] = w[Q + i]
        v[i] = w[V + i]
    return t, h, status
