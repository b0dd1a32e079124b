"""The compiled step loop of every Rosenbrock method: error control, input table, dense output, counters.

State y = (q, v) with dq/dt = v. Eliminating the q part of each stage leaves, with W = 1/(gamma h),
(W M - D - K/W) U_v = M r_v + K r_q / W and U_q = (r_q + U_v) / W: one n x n factorisation a step.
The input u(t) is a table, linear between its points or held; a held input jumps, so each of its points
ends a step. A linear input has kinks only: steps cross them, and an a-priori bound shortens a step in which
the table departs from its chord by more than the tolerance can bear.
On failure the loop stops and says why with a status; the state is the last accepted one.
"""

from math import isfinite

from model.kernels.compile import kernel
from model.kernels.dynamics import acceleration
from model.kernels.jacobian import linearise
from model.kernels.layout import N_JACOBIAN, N_REJECTED, N_RHS, N_STEPS

from .linear import factorise, solve, workspace

DONE, STEP_TOO_SMALL, NOT_FINITE, TOO_MANY_STEPS = 0, 1, 2, 3

SAFETY = 0.9
GROW = 5.0
SHRINK = 0.15
SMALLEST_STEP = 1e-12


@kernel
def input_at(t, k, table_t, table_u, held):
    """Input at ``t`` and its slope; ``k`` is a start for the search. Returns u, slope, k."""
    last = table_t.shape[0] - 1
    while k < last - 1 and t >= table_t[k + 1]:
        k += 1
    while k > 0 and t < table_t[k]:
        k -= 1
    if held:
        return table_u[last] if t >= table_t[last] else table_u[k], 0.0, k
    if t <= table_t[0]:
        return table_u[0], 0.0, k
    if t >= table_t[last]:
        return table_u[last], 0.0, k
    slope = (table_u[k + 1] - table_u[k]) / (table_t[k + 1] - table_t[k])
    return table_u[k] + slope * (t - table_t[k]), slope, k


@kernel
def fit_to_input(t, step, u0, k, table_t, table_u, f_u, m_diag, tolerance_q, tolerance_v):
    """Shorten ``step`` so that no kink of the table inside it can do harm.

    A kink of strength s, a distance r from the nearer end of the step, bends the speed by at most
    |f_u| / M * s r^2 / 2; the stages see most of it, a tenth is left. Where that passes the tolerance the step
    ends at the kink. Many weak kinks add up to a departure from the chord, which is bounded likewise.
    """
    gain = 0.0
    for i in range(f_u.shape[0]):
        gain = max(gain, abs(f_u[i]) / m_diag[i])
    last = table_t.shape[0] - 1
    while True:
        end = t + step
        u1, _, _ = input_at(end, k, table_t, table_u, False)
        bend = 0.0
        j = k + 1
        while j < last and table_t[j] < end:
            before = (table_u[j] - table_u[j - 1]) / (table_t[j] - table_t[j - 1])
            after = (table_u[j + 1] - table_u[j]) / (table_t[j + 1] - table_t[j])
            reach = min(table_t[j] - t, end - table_t[j])
            if 0.1 * gain * abs(after - before) * reach * reach > tolerance_v and table_t[j] - t > 1e-9:
                return table_t[j] - t
            bend = max(bend, abs(table_u[j] - (u0 + (u1 - u0) * (table_t[j] - t) / step)))
            j += 1
        if step < 1e-6 or 0.1 * gain * bend * step <= max(tolerance_v, tolerance_q / step):
            return step
        step *= 0.5


@kernel
def integrate(
    t,
    t_end,
    h,
    q,
    v,
    table_t,
    table_u,
    held,
    out_t,
    out_q,
    out_v,
    p,
    tables,
    a_,
    c_,
    b_,
    node,
    d_,
    dense,
    gamma,
    tolerance_q,
    tolerance_v,
    exponent,
    h_max,
    max_steps,
    counters,
):
    """Advance (q, v) in place from ``t`` to ``t_end``; fill rows of ``out_q``, ``out_v`` at ``out_t``.

    Returns the time reached, the next step to try and a status.
    """
    n = q.shape[0]
    s = b_.shape[0]
    pose, uq, uv, scratch, stiff, damp, system, work, pivot = workspace(n, s)
    f0 = scratch[0]
    f = scratch[1]
    acc = scratch[2]
    m_diag = scratch[3]
    m_up = scratch[4]
    f_u = scratch[5]
    qs = scratch[6]
    vs = scratch[7]
    q1 = scratch[8]
    v1 = scratch[9]
    rq = scratch[10]
    rv = scratch[11]
    md = scratch[12]
    mu = scratch[13]
    acc0 = scratch[14]
    parent = tables.parent
    k_in = 0
    k_out = 0
    n_out = out_t.shape[0]
    while k_out < n_out and out_t[k_out] <= t:
        for i in range(n):
            out_q[k_out, i] = q[i]
            out_v[k_out, i] = v[i]
        k_out += 1
    fresh = True
    rejected = False
    u0 = 0.0
    slope = 0.0
    for _ in range(max_steps):
        if t >= t_end:
            return t, h, DONE
        if fresh:
            u0, slope, k_in = input_at(t, k_in, table_t, table_u, held)
            acceleration(q, v, u0, p, tables, pose, m_diag, m_up, f0, acc0, counters)
            linearise(v, u0, acc0, p, tables, pose, work, stiff, damp, f_u)
            counters[N_RHS] += 1
            counters[N_JACOBIAN] += 1
            fresh = False
        if h > h_max:
            h = h_max
        stop = t_end
        if held and k_in + 1 < table_t.shape[0] and t < table_t[k_in + 1] < stop:
            stop = table_t[k_in + 1]
        step = h
        # take a last step whole rather than leave a sliver
        if t + 1.01 * step >= stop:
            step = stop - t
        elif t + 2.0 * step > stop:
            step = 0.5 * (stop - t)
        if not held:
            step = fit_to_input(t, step, u0, k_in, table_t, table_u, f_u, m_diag, tolerance_q, tolerance_v)
        w = 1.0 / (gamma * step)
        for i in range(n):
            for j in range(n):
                system[i, j] = -damp[i, j] - stiff[i, j] / w
            system[i, i] += w * m_diag[i]
            if parent[i] >= 0:
                system[i, parent[i]] += w * m_up[i]
                system[parent[i], i] += w * m_up[i]
        ok = factorise(system, pivot)
        if ok:
            for stage in range(s):
                if stage == 0:
                    for i in range(n):
                        rq[i] = v[i]
                        rv[i] = f0[i] + step * d_[0] * f_u[i] * slope
                else:
                    for i in range(n):
                        sq = q[i]
                        sv = v[i]
                        cq = 0.0
                        cv = 0.0
                        for j in range(stage):
                            sq += a_[stage, j] * uq[j, i]
                            sv += a_[stage, j] * uv[j, i]
                            cq += c_[stage, j] * uq[j, i]
                            cv += c_[stage, j] * uv[j, i]
                        qs[i] = sq
                        vs[i] = sv
                        rq[i] = sv + cq / step
                        rv[i] = cv / step
                    us, _, k_in = input_at(t + node[stage] * step, k_in, table_t, table_u, held)
                    if held:
                        us = u0
                    acceleration(qs, vs, us, p, tables, pose, md, mu, f, acc, counters)
                    counters[N_RHS] += 1
                    for i in range(n):
                        acc[i] += rv[i]
                        rv[i] = step * d_[stage] * f_u[i] * slope
                    for i in range(n):
                        rv[i] += m_diag[i] * acc[i]
                        if parent[i] >= 0:
                            rv[i] += m_up[i] * acc[parent[i]]
                            rv[parent[i]] += m_up[i] * acc[i]
                for i in range(n):
                    x = 0.0
                    for j in range(n):
                        x += stiff[i, j] * rq[j]
                    acc[i] = rv[i] + x / w
                solve(system, pivot, acc)
                for i in range(n):
                    uv[stage, i] = acc[i]
                    uq[stage, i] = (rq[i] + acc[i]) / w
        error = 0.0
        if ok:
            for i in range(n):
                sq = q[i]
                sv = v[i]
                for j in range(s):
                    sq += b_[j] * uq[j, i]
                    sv += b_[j] * uv[j, i]
                q1[i] = sq
                v1[i] = sv
                eq = abs(uq[s - 1, i]) / tolerance_q
                ev = abs(uv[s - 1, i]) / tolerance_v
                if not (isfinite(eq) and isfinite(ev)):
                    ok = False
                error = max(error, eq, ev)
        if not ok:
            counters[N_REJECTED] += 1
            rejected = True
            h = 0.2 * step
            if h < SMALLEST_STEP:
                return t, h, NOT_FINITE
            continue
        factor = GROW if error == 0.0 else SAFETY * error ** (-exponent)
        factor = min(GROW, max(SHRINK, factor))
        if error > 1.0:
            counters[N_REJECTED] += 1
            rejected = True
            h = step * factor
            if h < SMALLEST_STEP:
                return t, h, STEP_TOO_SMALL
            continue
        counters[N_STEPS] += 1
        t1 = stop if step == stop - t else t + step
        while k_out < n_out and out_t[k_out] <= t1:
            x = (out_t[k_out] - t) / step
            for i in range(n):
                dq = 0.0
                dv = 0.0
                for m in range(dense.shape[0] - 1, -1, -1):
                    hq = 0.0
                    hv = 0.0
                    for j in range(s):
                        hq += dense[m, j] * uq[j, i]
                        hv += dense[m, j] * uv[j, i]
                    dq = hq + x * dq
                    dv = hv + x * dv
                out_q[k_out, i] = (1.0 - x) * q[i] + x * (q1[i] + (1.0 - x) * dq)
                out_v[k_out, i] = (1.0 - x) * v[i] + x * (v1[i] + (1.0 - x) * dv)
            k_out += 1
        if rejected:
            factor = min(factor, 1.0)
        # a step cut short by its end says little about the next one: never shrink the plan for that
        h = max(step * factor, h if step < h and factor >= 1.0 else 0.0)
        rejected = False
        for i in range(n):
            q[i] = q1[i]
            v[i] = v1[i]
        t = t1
        fresh = True
    return t, h, DONE if t >= t_end else TOO_MANY_STEPS
