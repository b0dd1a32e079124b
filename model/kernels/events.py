"""What is known before a step is tried: contacts about to close, sliding and joints about to stop, the action at rest.

A step that ends just after a surface touches, or just before friction turns round, is rarely rejected; one that runs
across is nearly always. All estimates are of first order and only ever shorten a step.
"""

from math import sqrt

from .compile import kernel
from .layout import BODY_SIZE, GLOBALS, JF_A, OMEGA_T, V_T
from .workspace import (
    ACC,
    CLOSING,
    M_DIAG,
    M_UP,
    ROOM,
    SLIDE,
    SLIDE_RATE,
    STIFF,
    WIDTH,
    V,
)

PAST_TOUCH = 0.02  # a step that ends at a touch goes on by this share, so that the next one knows the felt's stiffness
LAYER = 2.0  # threshold speeds from zero at which friction begins to turn round
WORTH = 0.05  # a shorter share of the planned step is not worth a step of its own
SLOWEST_CLOSING = 1e-3  # m/s


@kernel
def fit_to_events(step, w, p, n, n_contacts):
    """Shorten ``step`` (s) to the first expected touch or turn of friction."""
    planned = step
    for i in range(n):
        v = w[V + i]
        a = w[ACC + i]
        left = abs(v) - LAYER * p[OMEGA_T]
        rubs = p[GLOBALS + BODY_SIZE * i + JF_A] != 0.0
        if rubs and v * a < 0.0 and left > 0.0 and WORTH * planned * abs(a) < left < step * abs(a):
            step = left / abs(a)
    for c in range(n_contacts):
        if w[CLOSING + c] > SLOWEST_CLOSING:
            until = (1.0 + PAST_TOUCH) * w[ROOM + c] / w[CLOSING + c]
            if WORTH * planned < until < step:
                step = until
        rate = w[SLIDE_RATE + c]
        if rate != 0.0:
            v = w[SLIDE + c]
            left = abs(v) - LAYER * p[V_T]
            if v * rate < 0.0 and left > 0.0 and WORTH * planned * abs(rate) < left < step * abs(rate):
                step = left / abs(rate)
    return step


@kernel
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
