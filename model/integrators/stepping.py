"""What every step loop does around its stages: begin, plan a step, judge it, choose the next one.

Called by the compiled loops of ``rosenbrock``, ``diagonal`` and ``coupled``, inlined into each. A step ends where the
input jumps, just past events (``model.kernels.stepping.events``) and where the input's kinks would cost more than the
tolerance.
"""

from model.kernels.compile import inlined
from model.kernels.stepping.events import fit_to_events
from model.kernels.stepping.inputs import fit_to_input
from model.kernels.workspace import ACC, ALLOWANCE, WIDTH, Q, V

DONE, STEP_TOO_SMALL, NOT_FINITE, TOO_MANY_STEPS = 0, 1, 2, 3

SAFETY = 0.75
GROW = 5.0
SHRINK = 0.15
SMALLEST_STEP = 1e-12


@inlined
def begin(t, q, v, w, out_t, out_q, out_v):
    """Put the state into ``w`` and fill the outputs wanted up to ``t``; returns how many."""
    for i in range(q.shape[0]):
        w[Q + i] = q[i]
        w[V + i] = v[i]
    k_out = 0
    while k_out < out_t.shape[0] and out_t[k_out] <= t:
        out_q[k_out] = q
        out_v[k_out] = v
        k_out += 1
    return k_out


@inlined
def plan(t, t_end, h, u0, k_in, held, table_t, table_u, w, p, n, n_contacts, tolerance_q, tolerance_v):
    """The step to take where ``h`` is wanted, ``h`` fitted to events, and the time that no step may pass."""
    stop = t_end
    if held and k_in + 1 < table_t.shape[0] and t < table_t[k_in + 1] < stop:
        stop = table_t[k_in + 1]
    fitted = fit_to_events(h, w, p, n, n_contacts, tolerance_v)
    step = fitted
    # take a last step whole rather than leave a sliver
    if t + 1.01 * step >= stop:
        step = stop - t
    elif t + 2.0 * step > stop:
        step = 0.5 * (stop - t)
    if not held:
        step = fit_to_input(t, step, u0, k_in, table_t, table_u, w, n, tolerance_q, tolerance_v)
    return step, fitted, stop


@inlined
def allow(w, step):
    """How far each coordinate may move within the step before a contact that was left out must be looked at."""
    for i in range(WIDTH):  # prescribed coordinates too
        w[ALLOWANCE + i] = 1.5 * step * abs(w[V + i]) + step * step * abs(w[ACC + i]) + 1e-7


@inlined
def shortened(step, error, exponent):
    """The step to try again with after an error (of the tolerance) above 1."""
    return step * max(SHRINK, SAFETY * error ** (-exponent))


@inlined
def after_step(step, error, exponent, rejected, fitted, h):
    """The step to want next."""
    factor = GROW if error == 0.0 else min(GROW, max(SHRINK, SAFETY * error ** (-exponent)))
    if rejected:
        factor = min(factor, 1.0)
    # a step cut short by its end says little about the next one, one cut short by an event does
    return max(step * factor, h if step < fitted == h and factor >= 1.0 else 0.0)
