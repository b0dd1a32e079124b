"""What parameters do to forces along a motion: derivatives by a scene's numbers, put together for each parameter.

The derivatives by numbers come from the scene's elements (`model.derived.slopes`); a parameter changes some numbers, by
so much per unit of it: a row of `Sources`.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from model.kernels import layout as L
from model.kernels.compile import uncounted_loop
from model.kernels.kernel_value import KernelType
from model.kernels.lanes import rows
from model.kernels.regimes import OWN, SLOPES
from model.kernels.workspace import Q, V

LANES = 8  # parameters side by side; their number is filled up to a multiple of it


class Sources(NamedTuple):
    """Numbers of a scene that parameters change, (s,), increasing; ``first`` (s + 1,) where each begins in the rest.

    ``column`` is the parameter, ``slope`` by how much a unit of it changes the number; ``place`` (k,) the row of each
    number of the vector, or -1.
    """

    number: np.ndarray
    first: np.ndarray
    column: np.ndarray
    slope: np.ndarray
    place: np.ndarray


class Loads(NamedTuple):
    """Kernels of `model.derived.slopes` and memory for what they fill."""

    numbers: object
    normals: object
    input: np.ndarray  # (1,)
    by_number: np.ndarray  # (k n,)
    normal: np.ndarray  # (c (1 + 4 N + OWN),)


_f, _i = types.float64, types.int64
_numbers, _table, _cube = (types.Array(_f, k, "C") for k in (1, 2, 3))
_integers = types.Array(_i, 1, "C")
SOURCES = types.NamedTuple([_integers] * 3 + [_numbers, _integers], Sources)
LOADS = types.NamedTuple([KernelType(SLOPES), KernelType(SLOPES), _numbers, _numbers, _numbers], Loads)
PARAMETER_LOADS = types.void(_numbers, _numbers, _f, SOURCES, LOADS, _table)


@uncounted_loop(PARAMETER_LOADS)
def parameter_loads(w, p, u, sources, loads, load):
    """Fill ``load`` (n, P) with d(f - M a)/dp at the state and the accelerations in the workspace ``w``."""
    n = load.shape[0]
    load[:, :] = 0.0
    loads.input[0] = u
    loads.numbers(w, loads.input, p, loads.by_number)
    for s in range(sources.number.shape[0]):
        at = n * sources.number[s]
        for i in range(n):
            change = loads.by_number[at + i]
            if change != 0.0:
                for e in range(sources.first[s], sources.first[s + 1]):
                    load[i, sources.column[e]] += sources.slope[e] * change


class Moved(NamedTuple):
    """States (m, N) of a motion and their derivatives (m, N, P), P a multiple of the lanes."""

    angle: np.ndarray
    speed: np.ndarray
    d_angle: np.ndarray
    d_speed: np.ndarray


MOVED = types.NamedTuple([_table, _table, _cube, _cube], Moved)
NORMAL_SLOPES = types.void(MOVED, _numbers, _i, SOURCES, LOADS, _numbers, _table, _cube)


@uncounted_loop(NORMAL_SLOPES)
def normal_slopes(moved, p, contacts_at, sources, loads, w, normal, out):
    """Fill ``normal`` (m, c), N, and add to ``out`` (m, c, P), which is 0, its derivatives."""
    n = moved.angle.shape[1]
    blocks = moved.d_angle.shape[2] // LANES
    d_angle, d_speed, lanes = rows(moved.d_angle, LANES), rows(moved.d_speed, LANES), rows(out, LANES)
    for m in range(moved.angle.shape[0]):
        for i in range(n):
            w[Q + i], w[V + i] = moved.angle[m, i], moved.speed[m, i]
        loads.normals(w, loads.input, p, loads.normal)
        for c in range(normal.shape[1]):
            at = (1 + 4 * n + OWN) * c
            row = loads.normal
            normal[m, c] = row[at]
            if not row[at] > 0.0:
                continue
            to = (m * normal.shape[1] + c) * blocks
            for k in range(n):
                of = (m * n + k) * blocks
                by_angle, by_speed = row[at + 1 + k], row[at + 1 + n + k]
                if by_angle != 0.0 or by_speed != 0.0:
                    for b in range(blocks):
                        lanes[to + b] = lanes[to + b] + by_angle * d_angle[of + b] + by_speed * d_speed[of + b]
            for k in range(OWN + 2 * n):
                number = contacts_at + L.CONTACT_SIZE * c + k
                if k >= OWN:
                    number = L.GLOBALS + L.BODY_SIZE * ((k - OWN) // 2) + L.PIVOT_X + (k - OWN) % 2
                s = sources.place[number]
                change = row[at + 1 + 2 * n + k]
                if s >= 0 and change != 0.0:
                    for e in range(sources.first[s], sources.first[s + 1]):
                        out[m, c, sources.column[e]] += sources.slope[e] * change
