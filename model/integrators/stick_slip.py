"""One blow by time-stepping with set-valued friction: bodies stick exactly, no threshold speed.

Moreau's midpoint scheme: positions half a step on, forces there, then speeds and friction impulses together. With
w = D^T v the sliding and joint speeds at the end of a step and r the impulses, each r lies in its Coulomb interval,
w = 0 inside it and w opposes r at its ends; the intervals come from the felt forces of the step, so the problem is
convex and projected Gauss-Seidel solves it. A pair that stuck holds up to the static coefficient, one that slid up to
the kinetic one. Felt, inertia, springs and drive are the scene's with friction taken out (`Watched.marched`).
Source: J. J. Moreau, "Unilateral contact and dry friction in finite freedom dynamics" (1988); thesis eqs 2.8, 2.9.
"""

from typing import NamedTuple

import numpy as np

from model.kernels.compile import kernel
from model.kernels.layout import BODY_SIZE, CONTACT_SIZE, GLOBALS, JF_A, MU_A

SWEEPS = 300
PATIENCE = 6  # sweeps between two tries to stop all pairs at once
SOFT = 1e-10
CLOSE = 1e-9  # change of a sliding or joint speed by an impulse, m/s or rad/s, at which the sweeps end


class Forcing(NamedTuple):
    """Inputs (k,) at the midpoints of k steps of ``step`` s; every ``every``-th end of a step is kept."""

    value: np.ndarray
    step: float
    every: int


class FrictionLimits(NamedTuple):
    """Parameter vector, the same with all friction taken out, static over kinetic value of contacts, then joints.

    ``start`` is where the contacts' numbers begin.
    """

    parameters: np.ndarray
    frictionless: np.ndarray
    static_ratio: np.ndarray
    start: int


class Places(NamedTuple):
    """Where a state row has each coordinate (n,) and its speed (n,); how many bodies and where memories begin.

    ``memories`` is how many numbers felt remembers there. Of a string: gains 1/kg, stiffnesses 1/s^2 and dampings 1/s
    of its ``modes`` (3, k), which are empty without one, where their ``ways`` and rates begin, and its contact.
    """

    angle: np.ndarray
    speed: np.ndarray
    bodies: int
    first: int
    memories: int
    modes: np.ndarray
    ways: int
    struck: int


class Pairs(NamedTuple):
    """Contacts, then joints: rows of D^T and (M^-1 D)^T (k, n), own effect, bound and impulse (k,), 1 where stuck."""

    along: np.ndarray
    given: np.ndarray
    own: np.ndarray
    bound: np.ndarray
    impulse: np.ndarray
    sticks: np.ndarray


class Rows(NamedTuple):
    """What is kept: states (m, x) as `Watched.marched` takes them; 1 where a contact or joint (m, c + b) sticks."""

    state: np.ndarray
    sticks: np.ndarray


@kernel
def swing(modes, time):
    """What free modes do in a time: (4, k) of way by way and rate, of rate by way and rate."""
    out = np.zeros((4, modes.shape[1]))
    for i in range(modes.shape[1]):
        stiffness, sigma = modes[1, i], 0.5 * modes[2, i]
        omega = np.sqrt(stiffness - sigma * sigma)
        fade, c, s = np.exp(-sigma * time), np.cos(omega * time), np.sin(omega * time) / omega
        out[0, i], out[1, i] = fade * (c + sigma * s), fade * s
        out[2, i], out[3, i] = -fade * stiffness * s, fade * (c - sigma * s)
    return out


@kernel
def swung(modes, by, force, before, after):
    """Ways and rates ``after`` of modes under a constant force; ``by`` as `swing` says."""
    k = modes.shape[1]
    for i in range(k):
        rest = modes[0, i] * force / modes[1, i]
        away, rate = before[i] - rest, before[k + i]
        after[i] = rest + by[0, i] * away + by[1, i] * rate
        after[k + i] = by[2, i] * away + by[3, i] * rate


@kernel
def grown(rate, slope, time):
    """Change of a memory in a time, whose rate is linear in it."""
    x = slope * time
    return rate * time * (1.0 + 0.5 * x if abs(x) < 1e-6 else np.expm1(x) / x)


@kernel
def sweep_once(along, given, own, bound, impulse, change):
    """Give each pair in turn the impulse that stops it, within its bound; return the largest speed that changed."""
    worst = 0.0
    for j in range(bound.shape[0]):
        if bound[j] <= 0.0:
            continue
        w = 0.0
        for i in range(change.shape[0]):
            w += along[j, i] * change[i]
        new = min(max(impulse[j] - w / own[j], -bound[j]), bound[j])
        step = new - impulse[j]
        if step != 0.0:
            impulse[j] = new
            for i in range(change.shape[0]):
                change[i] += given[j, i] * step
            worst = max(worst, abs(step) * own[j])
    return worst


@kernel
def stick_together(along, given, bound, impulse, change):
    """Stop all pairs inside their bounds at once: what many sweeps creep towards where light and heavy bodies stick.

    Where an impulse would pass its bound it ends there, and the others go on without it.
    """
    for _ in range(bound.shape[0]):
        free = np.flatnonzero((bound > 0.0) & (np.abs(impulse) < bound))
        m = free.shape[0]
        if m == 0:
            return
        system, right = np.zeros((m, m)), np.zeros(m)
        for x in range(m):
            right[x] = -np.dot(along[free[x]], change)
            for y in range(m):
                system[x, y] = np.dot(along[free[x]], given[free[y]])
        for x in range(m):
            system[x, x] *= 1.0 + SOFT  # more pairs than coordinates: the impulses share the load
        step = np.linalg.solve(system, right)
        share, last = 1.0, -1
        for x in range(m):
            j = free[x]
            room = bound[j] - impulse[j] if step[x] > 0.0 else bound[j] + impulse[j]
            if abs(step[x]) * share > room:
                share, last = room / abs(step[x]), x
        for x in range(m):
            j = free[x]
            new = impulse[j] + share * step[x]
            if x == last:
                new = bound[j] if step[x] > 0.0 else -bound[j]
            change += given[j] * (new - impulse[j])
            impulse[j] = new
        if last < 0:
            return


@kernel
def bounded(pairs, pressed, inverse, h, limits):
    """Directions of all pairs and bounds of their impulses in a step, from what the contacts press with."""
    p, _, static_ratio, start = limits
    along, given, own, bound, impulse, sticks = pairs
    n, c = along.shape[1], pressed.shape[0]
    for j in range(along.shape[0]):
        bound[j] = 0.0
        if j < c:
            mu = p[start + CONTACT_SIZE * j + MU_A]
            if mu == 0.0:
                continue
            fn = pressed[j, 0]
            if fn <= 0.0:
                sticks[j] = 0
                impulse[j] = 0.0
                continue
            bound[j] = h * mu * fn
            along[j] = pressed[j, 1:]
        else:
            bound[j] = h * p[GLOBALS + BODY_SIZE * (j - c) + JF_A]
            along[j] = 0.0
            along[j, j - c] = 1.0
        bound[j] *= static_ratio[j] if sticks[j] else 1.0
        own[j] = 0.0
        for i in range(n):
            given[j, i] = 0.0
            for other in range(n):
                given[j, i] += inverse[i, other] * along[j, other]
            own[j] += along[j, i] * given[j, i]


@kernel
def stopped(pairs, change):
    """Impulses of all pairs and the speeds that they leave; how many sweeps that took."""
    along, given, own, bound, impulse, _ = pairs
    for j in range(bound.shape[0]):
        impulse[j] = min(max(impulse[j], -bound[j]), bound[j])
        for i in range(change.shape[0]):
            change[i] += given[j, i] * impulse[j] if bound[j] > 0.0 else 0.0
    sweep = 0
    while sweep < SWEEPS:
        sweep += 1
        if sweep % PATIENCE == 0:
            stick_together(along, given, bound, impulse, change)
        if sweep_once(along, given, own, bound, impulse, change) < CLOSE:
            break
    return sweep


@kernel
def step_along(state, forcing, limits, marched, places, rows):
    """March from a state row, which changes, and fill ``rows``; ``marched`` is the scene's kernel of that name.

    Memories of felt follow in closed form at the depth and rate of a step's middle, modes of a string at the force.
    Returns the largest number of sweeps that a step needed; SWEEPS where one did not converge.
    """
    u, h, every = forcing
    smooth = limits.frictionless
    at_q, at_v, bodies, first, memories, modes, ways, struck = places
    n, c, k_modes = at_q.shape[0], limits.static_ratio.shape[0] - bodies, modes.shape[1]
    count, last = c + bodies, n + n * n + c * (1 + n)
    given_input, found = np.zeros(1), np.zeros(last + 3 * memories)
    a, inverse, pressed = found[:n], found[n : n + n * n].reshape(n, n), found[n + n * n : last].reshape(c, 1 + n)
    one = np.zeros(count)
    rubbing, table = np.ones(count, dtype=np.int64), np.zeros((count, n))
    pairs = Pairs(table, table.copy(), one, one.copy(), one.copy(), rubbing)
    q, v = state[at_q], state[at_v]
    middle, free, mean, change = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    z, z_end = state[first : first + memories].copy(), np.zeros(memories)
    string, string_end = state[ways : ways + 2 * k_modes].copy(), np.zeros(2 * k_modes)
    half, whole = swing(modes, 0.5 * h), swing(modes, h)
    force = 0.0
    most_sweeps = 0
    for k in range(u.shape[0]):
        for i in range(n):
            middle[i] = q[i] + 0.5 * h * v[i]
            mean[i] = v[i]
            free[i] = v[i]
        swung(modes, half, force, string, state[ways : ways + 2 * k_modes])
        for _ in range(2):  # once more with the mean speed of the step, for felt that damps
            given_input[0] = u[k]
            state[at_q] = middle
            state[at_v] = mean
            marched(state, given_input, smooth, found)
            for m in range(memories):
                now, rate, slope = found[last + 3 * m], found[last + 3 * m + 1], found[last + 3 * m + 2]
                if now != state[first + m]:  # open: starts anew
                    z[m], rate, slope = now, 0.0, 0.0
                rate += slope * (z[m] - now)
                state[first + m] = z[m] + grown(rate, slope, 0.5 * h)
                z_end[m] = z[m] + grown(rate, slope, h)
            if k_modes > 0:
                force = pressed[struck, 0]
                swung(modes, half, force, string, state[ways : ways + 2 * k_modes])
                swung(modes, whole, force, string, string_end)
            bounded(pairs, pressed, inverse, h, limits)
            for i in range(n):
                change[i] = v[i] + h * a[i]
            most_sweeps = max(most_sweeps, stopped(pairs, change))
            for i in range(n):
                free[i] = change[i]
                mean[i] = 0.5 * (v[i] + free[i])
        for j in range(count):
            pairs.sticks[j] = 1 if pairs.bound[j] > 0.0 and abs(pairs.impulse[j]) < pairs.bound[j] else 0
        for i in range(n):
            q[i] = middle[i] + 0.5 * h * free[i]
            v[i] = free[i]
        z[:] = z_end
        string[:] = string_end
        if (k + 1) % every == 0:
            m = (k + 1) // every - 1
            rows.state[m] = state
            rows.state[m][at_q] = q
            rows.state[m][at_v] = v
            rows.state[m, first : first + memories] = z
            rows.state[m, ways : ways + 2 * k_modes] = string
            rows.sticks[m] = pairs.sticks
        state[first : first + memories] = z
    return most_sweeps
