"""The linearised equations of a motion at the nodes of a step, with what each parameter adds to them.

M, K and D are the kernels' linearisation; what a parameter adds to the forces is derived as they are (`loads`).
"""

from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.tangents.loads import LOADS, SOURCES, Loads, Sources, parameter_loads
from model.integrators.tangents.recorded_motion import KERNELS, NUMBERS
from model.kernels.compile import step_loop
from model.kernels.signatures import SceneNumbers, StepKernels
from model.kernels.workspace import DAMP, M_DIAG, M_UP, STIFF, WIDTH


class Space(NamedTuple):
    """Memory of a run: a workspace of the scene's kernels, and the linearised equations.

    ``mass``, ``stiff``, ``damp`` (s + 1, n, n) and ``load`` (s + 1, n, P) hold M, K, D and d(f - M a)/dp at the start
    of a step and at its s nodes.
    """

    point: np.ndarray
    mass: np.ndarray
    stiff: np.ndarray
    damp: np.ndarray
    load: np.ndarray
    carried: np.ndarray  # (N - n, P) derivatives of prescribed coordinates, the same at all times
    matrix: np.ndarray  # (s n, s n filled up to lanes), zeros in what fills it up
    lower: np.ndarray  # (s n, s n)
    order: np.ndarray  # (s n,) of its rows after pivoting
    slopes: np.ndarray  # (s n, P) nu' at the nodes
    error: np.ndarray  # (2 n, P)
    largest: np.ndarray  # (2 n, P) so far


class Linear(NamedTuple):
    """A scene whose equations are linearised, its parameters, and the memory for it."""

    scene: SceneNumbers
    kernels: StepKernels
    sources: Sources
    loads: Loads
    space: Space


_f, _i = types.float64, types.int64
_numbers, _table, _cube = (types.Array(_f, k, "C") for k in (1, 2, 3))
_integers = types.Array(_i, 1, "C")
SPACE = types.NamedTuple([_numbers, *[_cube] * 4, *[_table] * 3, _integers, *[_table] * 3], Space)
LINEAR = types.NamedTuple([NUMBERS, KERNELS, SOURCES, LOADS, SPACE], Linear)
LINEARISE_NODE = types.void(_i, _f, LINEAR)


@step_loop(LINEARISE_NODE)
def linearise_node(m, u, linear):
    """Linearise at the state in ``space.point`` and fill row ``m`` of M, K, D and the loads."""
    scene, kernels, sources, loads, space = linear
    p, parent, _ = scene
    w = space.point
    n = space.load.shape[1]
    kernels.linearise(w, p, u)
    for i in range(n):
        for j in range(n):
            space.mass[m, i, j] = 0.0
            space.stiff[m, i, j] = w[STIFF + WIDTH * i + j]
            space.damp[m, i, j] = w[DAMP + WIDTH * i + j]
    for i in range(n):
        space.mass[m, i, i] = w[M_DIAG + i]
        up = parent[i]
        if up >= 0:
            space.mass[m, i, up] = w[M_UP + i]
            space.mass[m, up, i] = w[M_UP + i]
    parameter_loads(w, p, u, sources, loads, space.load[m])
    for k in range(space.carried.shape[0]):
        for i in range(n):
            x = w[STIFF + WIDTH * i + n + k]
            if x != 0.0:
                for j in range(space.load.shape[2]):
                    space.load[m, i, j] += x * space.carried[k, j]
