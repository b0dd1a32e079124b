"""Derivatives of contacts' normal forces along a motion in closed form: by its states and by the scene's numbers.

A coordinate of a contact's chain moves one of its surfaces, turns it, and moves the pivots that hang from it; that is a
``way`` as any other (`contact_change`). Only contacts that push have derivatives, and only their chains are asked.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.tangents.contact_change import (
    BETWEEN_X,
    BETWEEN_Y,
    CHAIN,
    N_X,
    N_Y,
    NORMAL,
    NORMAL_RATE,
    NORMAL_X,
    PRESSED,
    STRAIGHT,
    direction_change,
    surfaces_moved,
    touch_contact,
)
from model.integrators.tangents.loads import (
    BODY,
    CONTACT,
    LOAD_SPACE,
    SOURCES,
    TABLES,
    carried_contacts_change,
    pivot_way,
    surface_change,
)
from model.integrators.tangents.nodes import LANES
from model.kernels import layout as L
from model.kernels.compile import inlined_uncounted, uncounted_loop
from model.kernels.lanes.operations import rows
from model.kernels.trajectory.kinematics import place, point
from model.kernels.workspace import Q, V

_numbers, _states, _slopes = (types.Array(types.float64, k, "C") for k in (1, 2, 3))


class Moved(NamedTuple):
    """States (m, n) of a motion and their derivatives (m, n, P), P a multiple of the lanes."""

    angle: np.ndarray
    speed: np.ndarray
    d_angle: np.ndarray
    d_speed: np.ndarray


MOVED = types.NamedTuple([_states, _states, _slopes, _slopes], Moved)
NORMAL_SLOPES = types.void(MOVED, _numbers, TABLES, SOURCES, LOAD_SPACE, _numbers, _states, _slopes)


@inlined_uncounted
def turned(b, x, y, tables, pose):
    """Displacement of a point that coordinate ``b`` carries, per unit of it."""
    if tables.parent[b] == L.GUIDED:
        return 0.0, 1.0
    return pose[b, L.POSE_Y] - y, x - pose[b, L.POSE_X]


@inlined_uncounted
def slope_by_angle(c, k, w, p, tables, space):
    """Derivative of a pushing contact's normal force by coordinate ``k`` of its chain, speeds held."""
    t, way, pose = space.touch[c], space.way, space.pose
    b = tables.chain[c, k]
    o = tables.offset[1] + L.CONTACT_SIZE * c
    x, y = point(pose, tables.contact[c, 0], p[o + L.A_X], p[o + L.A_Y])
    way[:] = 0.0
    if tables.side[c, k] > 0:
        way[L.A_X], way[L.A_Y] = turned(b, x, y, tables, pose)
    else:
        way[L.B_X], way[L.B_Y] = turned(b, x - t[BETWEEN_X], y - t[BETWEEN_Y], tables, pose)
        if t[STRAIGHT] != 0.0 and tables.parent[b] != L.GUIDED:
            straight = int(t[STRAIGHT])
            way[straight], way[straight + 1] = -t[N_Y], t[N_X]
    depth, (dnx, dny, dpx, dpy) = surfaces_moved(t, way)
    rate = 0.0
    for other in range(tables.contact[c, 3]):
        i = tables.chain[c, other]
        sx, sy = 0.0, 0.0
        if tables.parent[i] == b:
            sx, sy = turned(b, pose[i, L.POSE_X], pose[i, L.POSE_Y], tables, pose)
        gn, _ = direction_change(c, other, (dnx, dny, dpx - sx, dpy - sy), t, tables)
        rate -= gn * w[V + i]
    return t[NORMAL_X] * depth + t[NORMAL_RATE] * rate


@inlined_uncounted
def through_the_state(m, c, moved, w, p, tables, space, out):
    """Add what the state's derivatives do to the force of one contact at time ``m``; ``out`` is rows of lanes."""
    t = space.touch[c]
    n, blocks = moved.angle.shape[1], moved.d_angle.shape[2] // LANES
    d_angle, d_speed = rows(moved.d_angle, LANES), rows(moved.d_speed, LANES)
    to = (m * tables.contact.shape[0] + c) * blocks
    for k in range(tables.contact[c, 3]):
        by_angle, by_speed = slope_by_angle(c, k, w, p, tables, space), -t[NORMAL_RATE] * t[CHAIN + 4 * k]
        of = (m * n + tables.chain[c, k]) * blocks
        for b in range(blocks):
            out[to + b] = out[to + b] + by_angle * d_angle[of + b] + by_speed * d_speed[of + b]


@inlined_uncounted
def by_the_numbers(m, w, p, tables, sources, space, out):
    """Add what the parameters change of the contacts themselves, with the state held at time ``m``."""
    for s in range(sources.kind.shape[0]):
        kind, i, number = sources.kind[s], sources.thing[s], sources.number[s]
        of_contact = kind == CONTACT and number < L.MU_A and space.touch[i, NORMAL] > 0.0
        of_pivot = kind == BODY and (number == L.PIVOT_X or number == L.PIVOT_Y)
        if not (of_contact or of_pivot):
            continue
        first, last = (i, i + 1) if of_contact else (0, tables.contact.shape[0])
        for c in range(first, last):
            space.touch[c, PRESSED] = 0.0
        if of_contact:
            surface_change(i, number, w, p, tables, space)
        else:
            x, y = pivot_way(i, number, tables, space)
            carried_contacts_change(i, x, y, w, tables, space)
        for c in range(first, last):
            change = space.touch[c, PRESSED]
            if change != 0.0:
                for e in range(sources.first[s], sources.first[s + 1]):
                    out[m, c, sources.column[e]] += sources.slope[e] * change


@uncounted_loop(NORMAL_SLOPES)
def normal_slopes(moved, p, tables, sources, space, w, normal, out):
    """Fill ``normal`` (m, c), N, and add to ``out`` (m, c, P), which is 0, its derivatives."""
    n = moved.angle.shape[1]
    lanes = rows(out, LANES)
    for m in range(moved.angle.shape[0]):
        for i in range(n):
            w[Q + i], w[V + i] = moved.angle[m, i], moved.speed[m, i]
        place(w[Q : Q + n], w[V : V + n], p, tables.parent, space.pose)
        for c in range(normal.shape[1]):
            touch_contact(c, w, p, tables, space)
            normal[m, c] = space.touch[c, NORMAL]
            if normal[m, c] > 0.0:
                through_the_state(m, c, moved, w, p, tables, space, lanes)
        by_the_numbers(m, w, p, tables, sources, space, out)
