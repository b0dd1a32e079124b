"""Step-size control: where a run begins, where a step must end, and how long the next one is.

Inlined into the compiled step loops. A step ends where the input jumps, just past events
(``model.kernels.stepping.events``) and where the input's kinks would cost more than the tolerance.
"""

from model.kernels.compile import inlined
from model.kernels.workspace import ACC, ALLOWANCE, WIDTH, Q, V

DONE, STEP_TOO_SMALL, NOT_FINITE, TOO_MANY_STEPS = 0, 1, 2, 3

SAFETY = 0.75
GROW = 5.0
SHRINK = 0.15
SMALLEST_STEP = 1e-12


@inlined
def begin(span, out, w):
    """Put the state into ``w`` and fill the outputs wanted up to the start; returns how many."""
    for i in range(span.angle.shape[0]):
        w[Q + i] = span.angle[i]
        w[V + i] = span.speed[i]
    k_out = 0
    while k_out < out.time.shape[0] and out.time[k_out] <= span.time:
        for i in range(span.angle.shape[0]):  # rows one by one would compile a message about their shapes, for 1.5 s
            out.angle[k_out, i] = span.angle[i]
            out.speed[k_out, i] = span.speed[i]
        for i in range(span.memory.shape[0]):
            out.memory[k_out, i] = span.memory[i]
        k_out += 1
    return k_out


@inlined
def next_stop(t, end, k_in, drive):
    """The time that no step from ``t`` may pass: the end of the run, or the next jump of a held input."""
    if drive.held and k_in + 1 < drive.time.shape[0] and t < drive.time[k_in + 1] < end:
        return drive.time[k_in + 1]
    return end


@inlined
def ending_at(stop, t, step):
    """A ``step`` that takes what is left before ``stop`` whole, or half of it, rather than leave a sliver."""
    if t + 1.01 * step >= stop:
        return stop - t
    if t + 2.0 * step > stop:
        return 0.5 * (stop - t)
    return step


@inlined
def allow(w, step):
    """How far each coordinate may move within the step before a contact that was left out must be evaluated."""
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
