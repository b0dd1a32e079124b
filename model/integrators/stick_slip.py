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
    """Parameter vector, the same with all friction taken out, and static over kinetic coefficient (c,) of contacts.

    ``start`` is where the contacts' numbers begin.
    """

    parameters: np.ndarray
    frictionless: np.ndarray
    static_ratio: np.ndarray
    start: int


class Rows(NamedTuple):
    """What is kept: angles and speeds (m, n); 1 where a contact or joint (m, c + n) sticks, 0 elsewhere."""

    angle: np.ndarray
    speed: np.ndarray
    sticks: np.ndarray


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
def step_along(q, v, forcing, limits, marched, rows):
    """March from (q, v), which change, and fill ``rows``; ``marched`` is the scene's kernel of that name.

    Returns the largest number of sweeps that a step needed; SWEEPS where one did not converge.
    """
    u, h, every = forcing
    p, smooth, static_ratio, start = limits
    angle, speed, held = rows
    n, c = q.shape[0], static_ratio.shape[0]
    state, given_input, found = np.zeros(2 * n), np.zeros(1), np.zeros(n + n * n + c * (1 + n))
    a, inverse, pressed = found[:n], found[n : n + n * n].reshape(n, n), found[n + n * n :].reshape(c, 1 + n)
    along = np.zeros((c + n, n))  # rows of D^T
    given = np.zeros((c + n, n))  # rows of (M^-1 D)^T
    bound, impulse, own = np.zeros(c + n), np.zeros(c + n), np.zeros(c + n)
    sticks = np.ones(c + n, dtype=np.int64)
    middle, free, mean, change = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    most_sweeps = 0
    for k in range(u.shape[0]):
        for i in range(n):
            middle[i] = q[i] + 0.5 * h * v[i]
            mean[i] = v[i]
            free[i] = v[i]
        for _ in range(2):  # once more with the mean speed of the step, for felt that damps
            given_input[0] = u[k]
            state[:n] = middle
            state[n:] = mean
            marched(state, given_input, smooth, found)
            for j in range(c + n):
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
                    bound[j] = h * mu * fn * (static_ratio[j] if sticks[j] else 1.0)
                    for i in range(n):
                        along[j, i] = pressed[j, 1 + i]
                else:
                    bound[j] = h * p[GLOBALS + BODY_SIZE * (j - c) + JF_A]
                    for i in range(n):
                        along[j, i] = 1.0 if i == j - c else 0.0
                own[j] = 0.0
                for i in range(n):
                    given[j, i] = 0.0
                    for other in range(n):
                        given[j, i] += inverse[i, other] * along[j, other]
                    own[j] += along[j, i] * given[j, i]
            for i in range(n):
                change[i] = v[i] + h * a[i]
            for j in range(c + n):
                impulse[j] = min(max(impulse[j], -bound[j]), bound[j])
                for i in range(n):
                    change[i] += given[j, i] * impulse[j] if bound[j] > 0.0 else 0.0
            sweep = 0
            while sweep < SWEEPS:
                sweep += 1
                if sweep % PATIENCE == 0:
                    stick_together(along, given, bound, impulse, change)
                if sweep_once(along, given, own, bound, impulse, change) < CLOSE:
                    break
            most_sweeps = max(most_sweeps, sweep)
            for i in range(n):
                free[i] = change[i]
                mean[i] = 0.5 * (v[i] + free[i])
        for j in range(c + n):
            sticks[j] = 1 if bound[j] > 0.0 and abs(impulse[j]) < bound[j] else 0
        for i in range(n):
            q[i] = middle[i] + 0.5 * h * free[i]
            v[i] = free[i]
        if (k + 1) % every == 0:
            m = (k + 1) // every - 1
            angle[m] = q
            speed[m] = v
            for j in range(c + n):
                held[m, j] = sticks[j]
    return most_sweeps
