"""The input table of a run: its value, how far it stays constant, and how a step copes with its kinks.

A table is linear between its points, or held; a held input jumps, so each of its points ends a step. A linear
input has kinks only: steps cross them where an a-priori bound says that the tolerance can bear it.
"""

from model.kernels.compile import kernel
from model.kernels.workspace import F_U, M_DIAG

# What a method loses at a kink inside a step, as a share of the bound on the kink's effect; measured with
# benchmarks/tolerance.py on noisy tables: less rejects more steps, more lands on too many points.
KINK_SHARE = 0.5
# Points of a linear table closer than this (s) are a jump; no step is taken inside it.
JUMP = 1e-10


@kernel
def input_at(t, k, table_t, table_u, held):
    """Input at ``t`` and its slope; ``k`` is a start for the search. Returns u, slope, k."""
    last = table_t.shape[0] - 1
    early = 0.0 if held else JUMP
    while k < last - 1 and t >= table_t[k + 1] - early:
        k += 1
    while k > 0 and t < table_t[k] - early:
        k -= 1
    if held:
        return table_u[last] if t >= table_t[last] else table_u[k], 0.0, k
    if t <= table_t[0]:
        return table_u[0], 0.0, k
    if t >= table_t[last] - early:
        return table_u[last], 0.0, k
    slope = (table_u[k + 1] - table_u[k]) / (table_t[k + 1] - table_t[k])
    return table_u[k] + slope * (t - table_t[k]), slope, k


@kernel
def constant_until(t, k, t_end, table_t, table_u, held):
    """Time up to which the input keeps exactly the value it has at ``t``; ``k`` as found by `input_at`."""
    last = table_t.shape[0] - 1
    if t < table_t[0]:
        return min(t_end, table_t[0])
    if t >= table_t[last]:
        return t_end
    value = table_u[k]
    j = k
    while j < last and table_u[j + 1] == value:
        j += 1
    if j == last:
        return t_end
    return min(t_end, max(t, table_t[j + 1] if held else table_t[j]))


@kernel
def fit_to_input(t, step, u0, k, table_t, table_u, w, n, tolerance_q, tolerance_v):
    """Shorten ``step`` so that no kink of the table inside it can do harm.

    A kink of strength s, a time r before the end of the step, which began with the slope before it, bends the
    speed by at most |f_u| / M * s r^2 / 2. Where too much of that would be lost the step ends at the kink. Many weak
    kinks add up to a departure from the chord, which is bounded likewise.
    """
    gain = 0.0
    for i in range(n):
        if w[F_U + i] != 0.0:
            gain = max(gain, abs(w[F_U + i]) / w[M_DIAG + i])
    gain *= KINK_SHARE
    last = table_t.shape[0] - 1
    while True:
        end = t + step
        u1, _, _ = input_at(end, k, table_t, table_u, False)
        bend = 0.0
        j = k + 1
        while j < last and table_t[j] < end:
            before = (table_u[j] - table_u[j - 1]) / (table_t[j] - table_t[j - 1])
            after = (table_u[j + 1] - table_u[j]) / (table_t[j + 1] - table_t[j])
            reach = end - table_t[j]
            if gain * abs(after - before) * reach * reach > tolerance_v and table_t[j] - t > 1e-9:
                return table_t[j] - t
            bend = max(bend, abs(table_u[j] - (u0 + (u1 - u0) * (table_t[j] - t) / step)))
            j += 1
        if step < 1e-6 or gain * bend * step <= max(tolerance_v, tolerance_q / step):
            return step
        step *= 0.5
