"""What is known before a step is tried: surfaces about to touch or part, friction about to turn, the action at rest.

A step that ends just after a kink of the forces, or just before friction turns round, is rarely rejected; one that runs
across is nearly always. Each event counts only where it would cost more than the tolerance. All estimates are of
second order at most and only ever shorten a step.
"""

from math import sqrt

from model.kernels.compile import inlined, uncounted
from model.kernels.layout import BODY_SIZE, GLOBALS, JF_A, OMEGA_T, V_T
from model.kernels.workspace import (
    ACC,
    GAP,
    GAP_ACC,
    GAP_RATE,
    GRIP,
    KICK,
    M_DIAG,
    M_UP,
    SLIDE,
    SLIDE_RATE,
    STIFF,
    WIDTH,
    V,
)

# found with work and error of five blows at 13 tolerances: fewer rejections at no more work for the same error
LAYER = 4.0  # threshold speeds from zero at which friction begins to turn round
TURN = 3.0  # threshold speeds a step may turn where friction changes a speed within a threshold's time by the tolerance
LEAST_TURN = 0.8  # threshold speeds a step may turn always
KINK = 0.5  # share of the tolerance of a speed that a kink within a step may cost


@inlined
def time_to_zero(x, rate, acc, most):
    """First time in (0, most) at which x + rate t + acc t^2 / 2 changes sign; ``most`` where there is none."""
    if x < 0.0:
        x, rate, acc = -x, -rate, -acc
    if x + most * (min(rate, 0.0) + 0.5 * most * min(acc, 0.0)) > 0.0:
        return most
    square = rate * rate - 2.0 * acc * x
    if square <= 0.0:
        return most
    down = -rate + sqrt(square)
    if down <= 0.0:
        return most
    return min(most, 2.0 * x / down)


@inlined
def fit_to_turn(step, z, rate, strength, tolerance_v):
    """Shorten ``step`` for friction whose scaled speed z runs through zero at ``rate`` (1/s): they have unlike signs.

    Outside the layer |z| < LAYER the step ends at its edge; inside, a step turns z by no more than the tolerance of a
    speed bears: ``strength`` is the acceleration that friction gives (rad/s^2).
    """
    pace = abs(rate)
    left = abs(z) - LAYER
    if left > 0.01:
        if left < step * pace and strength * (step - left / pace) > tolerance_v:
            return left / pace
        return step
    return min(step, max(LEAST_TURN, TURN * sqrt(sqrt(tolerance_v * pace / strength))) / pace)


@uncounted
def fit_to_events(step, w, scene, tolerance_v):
    """Shorten ``step`` (s) to the first event that it cannot cross."""
    p = scene.parameters
    for i in range(scene.parent.shape[0]):
        law = p[GLOBALS + BODY_SIZE * i + JF_A]
        if law != 0.0 and w[V + i] * w[ACC + i] < 0.0:
            scale = p[OMEGA_T]
            step = fit_to_turn(step, w[V + i] / scale, w[ACC + i] / scale, law / w[M_DIAG + i], tolerance_v)
    for c in range(scene.n_contacts):
        until = time_to_zero(w[GAP + c], w[GAP_RATE + c], w[GAP_ACC + c], step)
        if until < step:
            # the force's slope jumps there by stiffness times speed; the Jacobian at the start does not know it
            jump = w[KICK + c] * abs(w[GAP_RATE + c] + until * w[GAP_ACC + c])
            past = step - until
            if 0.5 * jump * past * past > KINK * tolerance_v:
                step = until + sqrt(2.0 * KINK * tolerance_v / jump)
        if w[SLIDE_RATE + c] * w[SLIDE + c] < 0.0 and w[GRIP + c] > 0.0:
            scale = p[V_T]
            step = fit_to_turn(step, w[SLIDE + c] / scale, w[SLIDE_RATE + c] / scale, w[GRIP + c], tolerance_v)
    return step


@uncounted
def at_rest(w, parent, parts, limit):
    """True where no coordinate can ever move by more than ``limit`` (rad) while the input stays as it is.

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
