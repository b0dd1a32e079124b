"""Derivatives of forces by parameters along a motion, put together from those by the scene's numbers."""

from typing import NamedTuple

import numpy as np
from numba import types

from model.kernels.compile import uncounted_loop
from model.kernels.kernel_value import KernelType
from model.kernels.signatures import OBSERVE
from model.kernels.workspace import Q, V, Z


class Sources(NamedTuple):
    """Numbers of a scene that parameters change, (s,), increasing; ``first`` (s + 1,) where each begins in the rest.

    ``column`` is the parameter, ``slope`` by how much a unit of it changes the number; ``place`` (k,) the row of each
    number of the vector, or -1. Numbers of a string's modes are not among them.
    """

    number: np.ndarray
    first: np.ndarray
    column: np.ndarray
    slope: np.ndarray
    place: np.ndarray


class Loads(NamedTuple):
    """Kernels of `model.codegen.parameter_derivatives` and memory for what they fill; what contacts' rows are made of.

    ``normal_first`` (c + 1,) is where the numbers of each contact begin in ``normal_number``, ``memory`` (c + 1,) the
    first memory of each contact; all memories of a contact lie together. ``string`` is the string's contact, or -1.
    ``acting`` (k, 4) has places of ``by_number`` that parameters change: the place, its row of the loads, from where to
    where its number's entries lie in the rest of `Sources`.
    """

    numbers: object
    normals: object
    propagate_modes: object
    input: np.ndarray  # (1,)
    by_number: np.ndarray  # (k r,)
    normal: np.ndarray
    modes: np.ndarray  # (10 K,)
    normal_first: np.ndarray
    normal_number: np.ndarray
    memory: np.ndarray
    string: int
    acting: np.ndarray


_f, _i = types.float64, types.int64
_numbers, _table, _cube = (types.Array(_f, k, "C") for k in (1, 2, 3))
_integers = types.Array(_i, 1, "C")
SOURCES = types.NamedTuple([_integers] * 3 + [_numbers, _integers], Sources)
LOADS = types.NamedTuple(
    [KernelType(OBSERVE)] * 3 + [_numbers] * 4 + [_integers] * 3 + [_i, types.Array(_i, 2, "C")], Loads
)
PARAMETER_LOADS = types.void(_numbers, _numbers, _f, SOURCES, LOADS, _table, _table)


@uncounted_loop(PARAMETER_LOADS)
def parameter_loads(w, p, u, sources, loads, load, entering):
    """Fill ``load`` (n, P) with d(f - M a)/dp, ``entering`` (C, P) with those of memory rates, then the string's force,
    at state and accelerations in ``w``; ``p``: the scene's numbers, ``u``: its input, ``sources``: which numbers each
    parameter changes."""
    n = load.shape[0]
    load[:, :] = 0.0
    entering[:, :] = 0.0
    loads.input[0] = u
    loads.numbers(w, loads.input, p, loads.by_number)
    for k in range(loads.acting.shape[0]):
        change, i = loads.by_number[loads.acting[k, 0]], loads.acting[k, 1]
        if change != 0.0:
            for e in range(loads.acting[k, 2], loads.acting[k, 3]):
                if i < n:
                    load[i, sources.column[e]] += sources.slope[e] * change
                else:
                    entering[i - n, sources.column[e]] += sources.slope[e] * change


class MotionDerivatives(NamedTuple):
    """States (m, N) of a motion, derivatives (m, n, P), those of channels (m, C, P); columns beyond P are not read."""

    state: np.ndarray
    d_angle: np.ndarray
    d_speed: np.ndarray
    d_channel: np.ndarray


MOVED = types.NamedTuple([_table, _cube, _cube, _cube], MotionDerivatives)
NORMAL_SLOPES = types.void(MOVED, _numbers, _i, SOURCES, LOADS, _numbers, _table, _cube)


@uncounted_loop(NORMAL_SLOPES)
def normal_force_derivatives(moved, p, n_free, sources, loads, w, normal, out):
    """Fill ``normal`` (m, c), N, at the states of ``moved``, and add its derivatives, by those of ``moved``, to ``out``
    (m, c, P), zeros before.

    ``n_free`` coordinates stand in a row of states before their speeds and what is remembered; ``w`` is a workspace.
    """
    n, count = moved.d_angle.shape[1], out.shape[2]
    d_angle, d_speed, d_channel = moved.d_angle, moved.d_speed, moved.d_channel
    for m in range(moved.state.shape[0]):
        for i in range(n_free):
            w[Q + i], w[V + i] = moved.state[m, i], moved.state[m, n_free + i]
        for i in range(moved.state.shape[1] - 2 * n_free):
            w[Z + i] = moved.state[m, 2 * n_free + i]
        loads.normals(w, loads.input, p, loads.normal)
        at = 0
        for c in range(normal.shape[1]):
            row, first = loads.normal, at
            memories = loads.memory[c + 1] - loads.memory[c]
            numbers = loads.normal_first[c + 1] - loads.normal_first[c]
            at += 1 + 2 * n + memories + numbers
            normal[m, c] = row[first]
            if not row[first] > 0.0:
                continue
            for k in range(n):
                by_angle, by_speed = row[first + 1 + k], row[first + 1 + n + k]
                if by_angle != 0.0 or by_speed != 0.0:
                    for j in range(count):
                        out[m, c, j] += by_angle * d_angle[m, k, j] + by_speed * d_speed[m, k, j]
            for k in range(memories):
                by_memory, at_channel = row[first + 1 + 2 * n + k], loads.memory[c] + k
                for j in range(count):
                    out[m, c, j] += by_memory * d_channel[m, at_channel, j]
            if c == loads.string:
                for j in range(count):
                    out[m, c, j] += d_channel[m, d_channel.shape[1] - 1, j]
            for k in range(numbers):
                s = sources.place[loads.normal_number[loads.normal_first[c] + k]]
                change = row[first + 1 + 2 * n + memories + k]
                if s >= 0 and change != 0.0:
                    for e in range(sources.first[s], sources.first[s + 1]):
                        out[m, c, sources.column[e]] += sources.slope[e] * change
