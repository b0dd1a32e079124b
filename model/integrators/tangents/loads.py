"""What a change of a scene's numbers does to its generalised forces at one state: d(f - M a)/dp, in closed form.

A source is one number of the parameter vector; what it does goes to every parameter that changes it. Contacts that do
not push have no part in it. Equations: thesis Sections 2.1, 2.2; signs as in ``model.kernels.trajectory.dynamics``.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.tangents.body_change import body_change, weight_change
from model.integrators.tangents.contact_change import (
    FELT_FIT,
    NORMAL,
    SLIDE_GRIP,
    SLIDING,
    SQUEEZE,
    TOUCH_SIZE,
    WAY_SIZE,
    change_contact,
    press_change,
    rub_change,
    touch_contact,
)  # fmt: skip
from model.integrators.tangents.probe_change import change_probe
from model.kernels import layout as L
from model.kernels.compile import inlined_uncounted, uncounted_loop
from model.kernels.laws import friction
from model.kernels.layout import Tables
from model.kernels.trajectory.kinematics import direction, place
from model.kernels.workspace import WIDTH, Q, V

GLOBAL, BODY, SPRING, CONTACT, DRIVE, PROBE, DAMPER = range(7)


class Sources(NamedTuple):
    """Numbers of a scene that parameters change, (s,), those of one thing one after the other.

    ``kind`` and ``thing`` say of which contact, body, ... it is a ``number``; ``first`` (s + 1,) where its parameters
    begin in ``column`` and ``slope``, by how much a unit of each changes the number.
    """

    kind: np.ndarray
    thing: np.ndarray
    number: np.ndarray
    first: np.ndarray
    column: np.ndarray
    slope: np.ndarray


class LoadSpace(NamedTuple):
    """Memory for it: poses of bodies, contacts that push, one change of a contact, one of the forces."""

    pose: np.ndarray  # (N, POSE_SIZE)
    touch: np.ndarray  # (C, TOUCH_SIZE)
    way: np.ndarray  # (WAY_SIZE,)
    push: np.ndarray  # (WIDTH,)


def load_space(tables: Tables) -> LoadSpace:
    """Memory for a scene."""
    return LoadSpace(
        np.zeros((len(tables.parent), L.POSE_SIZE)),
        np.zeros((len(tables.contact), TOUCH_SIZE)),
        np.zeros(WAY_SIZE),
        np.zeros(WIDTH),
    )


_f, _i = types.float64, types.int64
_numbers, _table = types.Array(_f, 1, "C"), types.Array(_f, 2, "C")
_integers, _integer_table = types.Array(_i, 1, "C"), types.Array(_i, 2, "C")
TABLES = types.NamedTuple(
    [_integers, _integer_table, _integers, *[_integer_table] * 5, *[_integers] * 5, *[_integer_table] * 2], Tables
)
SOURCES = types.NamedTuple([_integers] * 5 + [_numbers], Sources)
LOAD_SPACE = types.NamedTuple([_table, _table, _numbers, _numbers], LoadSpace)
PARAMETER_LOADS = types.void(_numbers, _numbers, _f, TABLES, SOURCES, LOAD_SPACE, _table)


@inlined_uncounted
def friction_slopes(s, per, a, b1, b2):
    """Derivatives of the smoothed friction coefficient (or torque) by its A, B1 and B2."""
    one, _ = friction(s, per, 1.0, b1, b2)
    z = s * per
    z4 = z * z * z * z
    d = 1.0 + b2 * z4
    return one, a * z / d, -a * b1 * z * z4 / (d * d)


@inlined_uncounted
def of_law(number, first, slopes):
    """The slope that belongs to a number of a friction law whose numbers begin with ``first``."""
    return slopes[0] if number == first else slopes[1] if number == first + 1 else slopes[2]


@inlined_uncounted
def joint_change(i, number, w, p, tables, push):
    """What the friction of joint ``i`` does when a number of its law changes."""
    o = L.GLOBALS + L.BODY_SIZE * i
    per = 1.0 / p[L.V_T if tables.parent[i] == L.GUIDED else L.OMEGA_T]
    slopes = friction_slopes(w[V + i], per, p[o + L.JF_A], p[o + L.JF_B1], p[o + L.JF_B2])
    push[i] -= of_law(number, L.JF_A, slopes)


@inlined_uncounted
def threshold_change(number, n_contacts, w, p, tables, space):
    """What friction does when a threshold speed changes."""
    for i in range(tables.parent.shape[0]):
        if (tables.parent[i] == L.GUIDED) == (number == L.V_T):
            o = L.GLOBALS + L.BODY_SIZE * i
            _, slope = friction(w[V + i], 1.0 / p[number], p[o + L.JF_A], p[o + L.JF_B1], p[o + L.JF_B2])
            space.push[i] += slope * w[V + i] / p[number]
    if number != L.V_T:
        return
    for c in range(n_contacts):
        t = space.touch[c]
        if t[NORMAL] > 0.0:
            rub_change(c, t, -t[SLIDE_GRIP] * t[SLIDING] / p[L.V_T], tables, space.push)


@inlined_uncounted
def pivot_way(i, number, tables, space):
    """Where the pivot of body ``i`` goes in the world when it moves in the frame that carries it."""
    x, y = (1.0, 0.0) if number == L.PIVOT_X else (0.0, 1.0)
    if tables.parent[i] >= 0:
        x, y = direction(space.pose, tables.parent[i], x, y)
    return x, y


@inlined_uncounted
def carried_contacts_change(i, x, y, w, tables, space):
    """What contacts do when the pivot of body ``i`` moves by (x, y) in the world, with all that it carries."""
    parent, way = tables.parent, space.way
    for c in range(tables.contact.shape[0]):
        if not space.touch[c, NORMAL] > 0.0:
            continue
        way[:] = 0.0
        a, b = tables.contact[c, 0], tables.contact[c, 1]
        on_a, on_b = a >= 0 and (a == i or parent[a] == i), b >= 0 and (b == i or parent[b] == i)
        if not (on_a or on_b):
            continue
        if on_a:
            way[L.A_X], way[L.A_Y] = x, y
        if on_b:
            way[L.B_X], way[L.B_Y] = x, y
        way[WAY_SIZE - 2], way[WAY_SIZE - 1] = x, y
        change_contact(c, i, space.touch[c], way, w, tables, space.push)


@inlined_uncounted
def pivot_change(i, number, w, p, tables, space):
    """What contacts, probes and inertia do when the pivot of body ``i`` moves in the frame that carries it."""
    x, y = pivot_way(i, number, tables, space)
    carried_contacts_change(i, x, y, w, tables, space)
    for k in range(tables.probe.shape[0]):
        a, b = tables.probe[k, 0], tables.probe[k, 1]
        rise = (y if b == i or tables.parent[b] == i else 0.0) - (y if a == i or tables.parent[a] == i else 0.0)
        if rise != 0.0:
            change_probe(k, -1, rise, w, p, tables, space)
    body_change(i, number, w, p, tables, space)


@inlined_uncounted
def surface_change(c, number, w, p, tables, space):
    """What contact ``c`` does when one of its numbers changes."""
    t, way = space.touch[c], space.way
    x, squeeze = t[0], t[SQUEEZE]
    o = tables.offset[1] + L.CONTACT_SIZE * c
    if number >= L.MU_A:
        slopes = friction_slopes(t[SLIDING], 1.0 / p[L.V_T], p[o + L.MU_A], p[o + L.MU_B1], p[o + L.MU_B2])
        rub_change(c, t, of_law(number, L.MU_A, slopes), tables, space.push)
        return
    if number >= L.K_A:
        factor = 1.0 + p[o + L.DAMP] * squeeze
        force = x * factor
        if number == L.DAMP:
            force = t[FELT_FIT] * squeeze
        elif number == L.K_B:
            force *= x
        elif number == L.K_A:
            force *= x * x
        press_change(c, t, force, tables, space.push)
        return
    way[:] = 0.0
    if number == L.A_R or number == L.B_R:
        if number == L.B_R and tables.contact[c, 2] == L.LINE:
            return
        way[number] = 1.0
    else:
        # numbers of A come first, then those of B; every pair is x and y
        of_a = number < L.A_R
        begins = L.A_X if of_a else L.B_X if number < L.B_R else L.N_X if number < L.E_X else L.E_X
        body = tables.contact[c, 0] if of_a else tables.contact[c, 1]
        x, y = (1.0, 0.0) if number == begins else (0.0, 1.0)
        way[begins], way[begins + 1] = direction(space.pose, body, x, y)
    change_contact(c, -1, t, way, w, tables, space.push)


@inlined_uncounted
def source_change(kind, k, number, w, p, tables, space):
    """Add to ``space.push`` what a unit of one number does; bodies, contacts and what does not hang on the input."""
    push = space.push
    if kind == CONTACT:
        surface_change(k, number, w, p, tables, space)
    elif kind == BODY:
        if number >= L.JF_A:
            joint_change(k, number, w, p, tables, push)
        elif number == L.PIVOT_X or number == L.PIVOT_Y:
            pivot_change(k, number, w, p, tables, space)
        else:
            body_change(k, number, w, p, tables, space)
    elif kind == SPRING:
        i, o = tables.spring[k], tables.offset[0] + L.SPRING_SIZE * k
        if number == L.SPRING_T0:
            push[i] += 1.0
        elif number == L.SPRING_K:
            push[i] -= w[Q + i] - p[o + L.SPRING_Q0]
        else:
            push[i] += p[o + L.SPRING_K]
    elif kind == PROBE:
        change_probe(k, number, 0.0, w, p, tables, space)
    elif kind == DAMPER:
        push[tables.damper[k]] -= w[V + tables.damper[k]]
    elif number == L.GRAVITY:
        weight_change(w, p, tables, space)
    else:
        threshold_change(number, tables.contact.shape[0], w, p, tables, space)


@uncounted_loop(PARAMETER_LOADS)
def parameter_loads(w, p, u, tables, sources, space, load):
    """Fill ``load`` (n, P) with d(f - M a)/dp at the state and the accelerations in the workspace ``w``."""
    n = load.shape[0]
    size = tables.parent.shape[0]
    load[:, :] = 0.0
    place(w[Q : Q + size], w[V : V + size], p, tables.parent, space.pose)
    for c in range(tables.contact.shape[0]):
        touch_contact(c, w, p, tables, space)
    for s in range(sources.kind.shape[0]):
        kind, k, number = sources.kind[s], sources.thing[s], sources.number[s]
        if kind == CONTACT and not space.touch[k, NORMAL] > 0.0:
            continue
        space.push[:] = 0.0
        if kind == DRIVE:
            i = tables.drive[k, 1]
            lever = space.pose[i, L.POSE_C] if number == L.DRIVE_X else -space.pose[i, L.POSE_S]
            space.push[i] -= u * lever
        else:
            source_change(kind, k, number, w, p, tables, space)
        for e in range(sources.first[s], sources.first[s + 1]):
            j, slope = sources.column[e], sources.slope[e]
            for i in range(n):
                load[i, j] += slope * space.push[i]
