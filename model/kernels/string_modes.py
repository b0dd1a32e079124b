"""A string of modes under a contact of the action: stages eliminate them; while nothing is near, they wait.

y_n is the part of mode n in the string's way at the hammer, u_n its rate: dy/dt = u, du/dt = g F - c u - k y. In a
stage they follow the change dF of the contact's force, which follows the joints and the modes' sums: one scalar
equation. While the hammer is too far away to touch, the modes stay as they were at the time ``SINCE``, and are carried
on in closed form at once when it comes near. ``z0`` is the place of the string's states in a row, ``o`` that of its
numbers in p. Derivation: docs/decisions/0192-string-in-the-action.md.
"""

from math import cos, exp, sin, sqrt

from model.kernels.compile import inlined
from model.kernels.laws import felt
from model.kernels.layout import RELEASED, SINCE, STRING_HEAD, STRING_STATES
from model.kernels.workspace import (
    MAX_STAGES,
    MOST_MEMORIES,
    MOST_MODES,
    NOW,
    S_BACK,
    S_COUNT,
    S_COUPLED,
    S_EASE,
    S_HARD,
    S_LOSSY,
    S_NUMBERS,
    S_REACH,
    S_SHARE,
    S_TURN,
    Z_U,
    Z_WEIGHT,
    Z,
)

AWAKE = -1e300  # in place of a time; a state between two of these is below half of it
NEAR, FAR = 2e-5, 5e-5  # m beyond the string's reach: nearer, its modes are stepped; farther, they wait
LASTING = 1e-4  # s, for which an error of the string's place is taken to act on the hammer
NEWTON_STEPS = 30


@inlined
def felt_on_string(x, rate, give, a, b, c, damping):
    """Force between felt and string, its derivatives by the way and its rate, and its part that a slow press takes.

    Felt and the modes left out, which give way by ``give`` times the slow force, are springs in a row; felt loses as in
    eq. 2.4, (1 + D dx/dt) times the slow force.
    """
    slow, hard, _ = felt(x, 0.0, a, b, c, 0.0)
    if give > 0.0 and slow > 0.0:
        f = 0.0
        for _ in range(NEWTON_STEPS):
            slow, hard, _ = felt(x - give * f, 0.0, a, b, c, 0.0)
            step = (slow - f) / (1.0 + give * hard)
            f += step
            if abs(step) <= 1e-14 * abs(f):
                break
        slow, hard, _ = felt(x - give * f, 0.0, a, b, c, 0.0)
        hard /= 1.0 + give * hard
    factor = 1.0 + damping * rate
    if slow <= 0.0 or factor <= 0.0:
        return 0.0, 0.0, 0.0, slow
    return slow * factor, hard * factor, slow * damping, slow


@inlined
def string_energy(row, w, p, o):
    """Energy (J) of modes whose places start at ``row`` of w."""
    n = int(p[o])
    energy = 0.0
    for i in range(n):
        y, u = w[row + i], w[row + n + i]
        g, k = p[o + STRING_HEAD + i], p[o + STRING_HEAD + n + i]
        energy += (u * u + k * y * y) / (2.0 * g)
    return energy


@inlined
def carry_on(w, p, o, z0, time):
    """Let free modes swing for ``time`` (s), in closed form."""
    n = int(p[o])
    for i in range(n):
        k, sigma = p[o + STRING_HEAD + n + i], 0.5 * p[o + STRING_HEAD + 2 * n + i]
        omega = sqrt(k - sigma * sigma)
        y, u = w[Z + z0 + STRING_STATES + i], w[Z + z0 + STRING_STATES + n + i]
        fade, c, s = exp(-sigma * time), cos(omega * time), sin(omega * time) / omega
        w[Z + z0 + STRING_STATES + i] = fade * (y * c + (u + sigma * y) * s)
        w[Z + z0 + STRING_STATES + n + i] = fade * (u * c - (sigma * u + k * y) * s)


@inlined
def _reach(w, p, o, z0):
    """How far the free string can get in the hammer's way (m)."""
    n = int(p[o])
    reach = 0.0
    for i in range(n):
        y, u = w[Z + z0 + STRING_STATES + i], w[Z + z0 + STRING_STATES + n + i]
        reach += abs(y) + abs(u) / sqrt(p[o + STRING_HEAD + n + i])
    return 1.1 * reach


@inlined
def string_at(w, p, o, z0, x):
    """Wake or rest the modes at the start of a step; ``x`` is the depth of the hammer under the string at rest.

    Returns the string's way, its rate (m, m/s), and 1 where the modes are to be stepped.
    """
    n = int(p[o])
    since = w[Z + z0 + SINCE]
    if since < 0.5 * AWAKE or w[S_COUNT] == 0.0:
        w[S_REACH] = _reach(w, p, o, z0)
    if w[S_COUNT] == 0.0:  # of a run
        w[S_COUNT] = p[o]
        for i in range(n):
            for k in range(3):
                w[S_NUMBERS + MOST_MODES * k + i] = p[o + STRING_HEAD + n * k + i]
    reach = w[S_REACH]
    if since < 0.5 * AWAKE and -x - reach > FAR:
        since = w[NOW]
        w[Z + z0 + SINCE] = since
        for i in range(STRING_STATES + 2 * n):
            w[Z_WEIGHT + z0 + i] = 0.0
            for m in range(MAX_STAGES):
                w[Z_U + MOST_MEMORIES * m + z0 + i] = 0.0
    if since >= 0.5 * AWAKE:
        if -x - reach > NEAR:
            return 0.0, 0.0, 0.0
        before = string_energy(Z + z0 + STRING_STATES, w, p, o)
        carry_on(w, p, o, z0, w[NOW] - since)
        w[Z + z0 + RELEASED] += before - string_energy(Z + z0 + STRING_STATES, w, p, o)
        w[Z + z0 + SINCE] = AWAKE
        w[S_REACH] = _reach(w, p, o, z0)
    sway, swing = 0.0, 0.0
    for i in range(n):
        sway += w[Z + z0 + STRING_STATES + i]
        swing += w[Z + z0 + STRING_STATES + n + i]
    return sway, swing, 1.0


@inlined
def weigh_string(w, p, o, z0, worth):
    """Note what errors of the modes are worth as errors of a speed; ``worth``: acceleration per m of the string."""
    n = int(p[o])
    for i in range(n):
        w[Z_WEIGHT + z0 + STRING_STATES + i] = worth * LASTING
        w[Z_WEIGHT + z0 + STRING_STATES + n + i] = worth * LASTING / sqrt(p[o + STRING_HEAD + n + i])


@inlined
def string_factors(w, inverse, gh):
    """Prepare the modes for the stages of a step; the share of a change of force that is left after they gave way."""
    give = 0.0
    for i in range(int(w[S_COUNT])):
        ease = 1.0 / (inverse + w[S_NUMBERS + 2 * MOST_MODES + i] + gh * w[S_NUMBERS + MOST_MODES + i])
        w[S_EASE + i] = ease
        give += ease * w[S_NUMBERS + i]
    share = 1.0 / (1.0 + (gh * w[S_HARD] + w[S_LOSSY]) * give)
    w[S_SHARE] = share
    return share


@inlined
def string_in_stage(w, p, o, z0, a, c, k, rate):
    """Modes at a stage, in their rows; the string's way and its rate there."""
    n = int(p[o])
    for i in range(2 * n):
        w[S_COUPLED + i] = 0.0
        w[S_TURN + i] = w[Z + z0 + STRING_STATES + i]
    for j in range(k):
        row = Z_U + MOST_MEMORIES * j + z0 + STRING_STATES
        aj, cj = a[MAX_STAGES * k + j], c[MAX_STAGES * k + j] * rate
        for i in range(2 * n):
            w[S_TURN + i] += aj * w[row + i]
            w[S_COUPLED + i] += cj * w[row + i]
    sway, swing = 0.0, 0.0
    for i in range(n):
        sway += w[S_TURN + i]
        swing += w[S_TURN + n + i]
    return sway, swing


@inlined
def string_known(w, p, o, force, gh):
    """Known sides of the modes' equations under the contact's ``force``; how much less force they leave to a stage."""
    n = int(p[o])
    ways, rates = 0.0, 0.0
    for i in range(n):
        g, k, c = p[o + STRING_HEAD + i], p[o + STRING_HEAD + n + i], p[o + STRING_HEAD + 2 * n + i]
        y, u = w[S_TURN + i], w[S_TURN + n + i]
        way = u + w[S_COUPLED + i]
        known = w[S_EASE + i] * (g * force - c * u - k * y + w[S_COUPLED + n + i] - gh * k * way)
        w[S_COUPLED + i] = way
        w[S_BACK + i] = known
        ways += way
        rates += known
    return gh * w[S_HARD] * (ways + rates) + w[S_LOSSY] * rates


@inlined
def string_stage(w, p, o, z0, k, more, gh):
    """Stages of the modes, once the change ``more`` of the contact's force is known."""
    n = int(p[o])
    row = Z_U + MOST_MEMORIES * k + z0 + STRING_STATES
    for i in range(n):
        u = w[S_BACK + i] + w[S_EASE + i] * p[o + STRING_HEAD + i] * more
        w[row + n + i] = u
        w[row + i] = gh * (w[S_COUPLED + i] + u)


@inlined
def string_losses(row, w, p, o):
    """Power (W) that modes lose."""
    n = int(p[o])
    lost = 0.0
    for i in range(n):
        u = w[row + n + i]
        lost += p[o + STRING_HEAD + 2 * n + i] * u * u / p[o + STRING_HEAD + i]
    return lost
