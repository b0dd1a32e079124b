"""Where a step must end because surfaces are about to touch or part, or friction about to turn, lane by lane.

The same estimates as in `model.kernels.stepping.events`, whose limits it shares.
"""

from model.kernels.compile import inlined, uncounted
from model.kernels.lanes.operations import any_of, root, where
from model.kernels.layout import BODY_SIZE, GLOBALS, JF_A, OMEGA_T, V_T
from model.kernels.stepping.events import KINK, LAYER, LEAST_TURN, TURN
from model.kernels.workspace import ACC, GAP, GAP_ACC, GAP_RATE, GRIP, KICK, M_DIAG, SLIDE, SLIDE_RATE, V


@inlined
def time_to_zero(x, rate, acc, most):
    """First time in (0, most) at which x + rate t + acc t^2 / 2 changes sign; ``most`` where there is none."""
    below = x < 0.0
    x = abs(x)
    rate = where(below, -rate, rate)
    acc = where(below, -acc, acc)
    reached = x + most * (min(rate, 0.0) + 0.5 * most * min(acc, 0.0)) <= 0.0
    until = most
    if any_of(reached):
        square = rate * rate - 2.0 * acc * x
        real = reached & (square > 0.0)
        down = root(where(real, square, 0.0)) - rate
        until = where(real & (down > 0.0), min(most, 2.0 * x / down), most)
    return until


@inlined
def fit_to_turn(step, counts, speed, change, per, strength, tolerance_v):
    """Shorten ``step`` in the lanes of ``counts`` for friction whose ``speed`` runs through zero.

    ``per`` is one over its threshold, ``change`` that of the speed (1/s), ``strength`` as there.
    """
    turning = counts & (speed * change < 0.0)
    if any_of(turning):
        pace = abs(change * per)
        left = abs(speed * per) - LAYER
        outside = left > 0.01
        until = left / pace
        ends = outside & (left < step * pace) & (strength * (step - until) > tolerance_v)
        slow = min(step, max(LEAST_TURN, TURN * root(root(tolerance_v * pace / strength))) / pace)
        step = where(turning & ends, until, where(turning & ~outside, slow, step))
    return step


@uncounted
def fit_to_events(step, w, p, n, n_contacts, tolerance_v):
    """Shorten ``step`` (s) to the first event that it cannot cross; of ``n`` coordinates and ``n_contacts``."""
    per = 1.0 / p[OMEGA_T]
    for i in range(n):
        law = p[GLOBALS + BODY_SIZE * i + JF_A]
        rubs = law != 0.0
        if any_of(rubs):
            step = fit_to_turn(step, rubs, w[V + i], w[ACC + i], per, law / w[M_DIAG + i], tolerance_v)
    per = 1.0 / p[V_T]
    for c in range(n_contacts):
        rate = w[GAP_RATE + c]
        acc = w[GAP_ACC + c]
        until = time_to_zero(w[GAP + c], rate, acc, step)
        meets = until < step
        if any_of(meets):
            # the force's slope jumps there by stiffness times speed; the Jacobian at the start does not know it
            jump = w[KICK + c] * abs(rate + until * acc)
            past = step - until
            costly = meets & (0.5 * jump * past * past > KINK * tolerance_v)
            step = where(costly, until + root(2.0 * KINK * tolerance_v / jump), step)
        slide_rate = w[SLIDE_RATE + c]
        grip = w[GRIP + c]
        rubs = (slide_rate != 0.0) & (grip > 0.0)
        if any_of(rubs):
            step = fit_to_turn(step, rubs, w[SLIDE + c], slide_rate, per, grip, tolerance_v)
    return step
