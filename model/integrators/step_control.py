"""Step-size control: initial step, kinks and end of the run, next step from the error norm, detection of rest."""

from math import sqrt

from model.kernels.compile import inlined, uncounted
from model.kernels.workspace import ACC, ALLOWANCE, M_DIAG, M_UP, STIFF, WIDTH, Q, V

DONE, STEP_TOO_SMALL, NOT_FINITE, TOO_MANY_STEPS = 0, 1, 2, 3
FULL = 9  # the rows for steps are used up: go on with others

WHOLE = 1.01  # of a step that a stop may be away and be reached by it
SAFETY = 0.75  # of the step that the error norm permits
GROW = 5.0  # largest factor from step to step
SHRINK = 0.15  # smallest factor from step to step
FAILED = 0.2  # factor after a step whose equations have no solution
BOUND_SLACK = 1e-7  # rad or m, beyond the bound on a motion: a coordinate at rest has room too
FIRST_STEP = 1e-5  # s, of an action that was at rest
SMALLEST_STEP = 1e-12  # s; below it a run ends with an error


@inlined
def load_start(span, out, w):
    """Copy the state to ``w`` and fill the outputs up to the start; return how many are filled."""
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
def fit_to_stop(stop, t, step):
    """A ``step`` that takes what is left before ``stop`` whole, or half of it, rather than leave a sliver."""
    if t + WHOLE * step >= stop:
        return stop - t
    if t + 2.0 * step > stop:
        return 0.5 * (stop - t)
    return step


@inlined
def set_motion_bounds(w, step):
    """How far each coordinate may move within the step before a contact that was left out must be evaluated."""
    for i in range(WIDTH):  # prescribed coordinates too
        w[ALLOWANCE + i] = 1.5 * step * abs(w[V + i]) + step * step * abs(w[ACC + i]) + BOUND_SLACK


@inlined
def inverse_power(error, exponent):
    """``error`` to minus the exponent; of a method of order four by roots, which the processor has."""
    return 1.0 / sqrt(sqrt(error)) if exponent == 0.25 else error ** (-exponent)


@inlined
def rejected_step_size(step, power):
    """The step to try again with after an error (of the tolerance) above 1, to minus the exponent ``power``."""
    return step * max(SHRINK, SAFETY * power)


@inlined
def next_step_size(step, power, rejected, fitted, h):
    """The step to want next, where the estimated error to minus the exponent is ``power``; infinite for none."""
    factor = min(GROW, max(SHRINK, SAFETY * power))
    if rejected:
        factor = min(factor, 1.0)
    # a step cut short by its end says little about the next one, one cut short by an event does
    return max(step * factor, h if step < fitted == h and factor >= 1.0 else 0.0)


@uncounted
def is_at_rest(w, parent, parts, limit):
    """Return whether no coordinate can ever move by more than ``limit`` (rad) while the input stays as it is; ``parts``
    is scratch.

    Near a balance the energy E = v M v / 2 + d S d / 2 cannot grow: S is the stiffness, d = S^-1 f the way left to the
    balance, friction and felt only take energy. Hence |d_i| <= sqrt(2 E S^-1_ii) for all later times. A hammer that
    creeps under friction has far to go to its balance, or none (S not positive), and is not at rest.
    ``parts`` is (n, n + 1) scratch.
    """
    n = parent.shape[0]
    energy = 0.0
    for i in range(n):
        energy += w[M_DIAG + i] * w[V + i] * w[V + i]
        if parent[i] >= 0:
            energy += 2.0 * w[M_UP + i] * w[V + i] * w[V + parent[i]]
    for i in range(n):
        # the generalised force that is left: M a
        force = w[M_DIAG + i] * w[ACC + i]
        for j in range(n):
            if parent[i] == j:
                force += w[M_UP + i] * w[ACC + j]
            elif parent[j] == i:
                force += w[M_UP + j] * w[ACC + j]
        parts[i, n] = force
        for j in range(n):
            parts[i, j] = -0.5 * (w[STIFF + WIDTH * i + j] + w[STIFF + WIDTH * j + i])
    # Cholesky factor in the lower triangle, then y = L^-1 f, so that f S^-1 f = y y
    for j in range(n):
        for k in range(j):
            parts[j, j] -= parts[j, k] * parts[j, k]
        if not parts[j, j] > 0.0:
            return False
        parts[j, j] = sqrt(parts[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                parts[i, j] -= parts[i, k] * parts[j, k]
            parts[i, j] /= parts[j, j]
        for k in range(j):
            parts[j, n] -= parts[j, k] * parts[k, n]
        parts[j, n] /= parts[j, j]
        energy += parts[j, n] * parts[j, n]
    for i in range(n):
        # (S^-1)_ii = |L^-1 e_i|^2
        compliance = 0.0
        for j in range(i, n):
            x = 1.0 if j == i else 0.0
            for k in range(i, j):
                x -= parts[j, k] * parts[k, n]
            parts[j, n] = x / parts[j, j]
            compliance += parts[j, n] * parts[j, n]
        if not energy * compliance < limit * limit:
            return False
    return True
