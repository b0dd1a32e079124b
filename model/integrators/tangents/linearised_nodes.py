"""Linearised equations of a motion at the collocation nodes of a step, with each parameter's load."""

from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.tangents.channels import CHANNELS, Channels, fill_channels, load_modes
from model.integrators.tangents.parameter_loads import LOADS, SOURCES, Loads, Sources, parameter_loads
from model.integrators.tangents.recorded_motion import KERNELS, NUMBERS
from model.kernels.compile import uncounted_loop
from model.kernels.signatures import SceneNumbers, StepKernels
from model.kernels.workspace import M_DIAG, M_UP, Z


class Space(NamedTuple):
    """Memory of a run: a workspace of the scene's kernels, and the linearised equations of n coordinates.

    ``mass``, ``stiff``, ``damp`` (s + 1, n, n) and ``load`` (s + 1, n, P) hold M, K, D and d(f - M a)/dp at the start
    of a step and at its s nodes. Where joints give, how far they do are coordinates behind the others.
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
    row_of: np.ndarray  # (s n,) where a row of the system lies after pivoting
    weights: np.ndarray  # (s, 2) of the polynomial through the nodes, where it is asked for
    input_change: np.ndarray  # (1, P) of the kernels' input by parameters, at the node that is linearised
    places: (
        np.ndarray
    )  # (6 + n,) where K, D, du and M begin in a workspace (M -1 for a tree's), the length of their rows, the column of
    # the first prescribed coordinate, the row of each that is solved for
    channels: Channels


class Linear(NamedTuple):
    """A scene whose equations are linearised, its parameters, and the memory for it."""

    scene: SceneNumbers
    kernels: StepKernels
    sources: Sources
    loads: Loads
    space: Space
    input_slope: np.ndarray  # (k - 1, 2, P) change of the input at both ends between its points, or (0, 2, P) for none


_f, _i = types.float64, types.int64
_numbers, _table, _cube = (types.Array(_f, k, "C") for k in (1, 2, 3))
_integers = types.Array(_i, 1, "C")
SPACE = types.NamedTuple(
    [_numbers, *[_cube] * 4, *[_table] * 3, _integers, *[_table] * 3, _integers, *[_table] * 2, _integers, CHANNELS],
    Space,
)
LINEAR = types.NamedTuple([NUMBERS, KERNELS, SOURCES, LOADS, SPACE, _cube], Linear)
LINEARISE_NODE = types.void(_i, _f, LINEAR)


@uncounted_loop(LINEARISE_NODE)
def linearise_node(m, u, linear):
    """Linearise at the state in ``space.point`` under the input ``u`` and fill row ``m`` of M, K, D, the loads
    (derivatives by the parameters) and the channels."""
    scene, kernels, sources, loads, space, _ = linear
    p, parent, _ = scene
    w, channels = space.point, space.channels
    n, count = space.load.shape[1], channels.many.shape[0]
    felts = count - channels.modes.awake.shape[0]
    for c in range(felts):
        channels.before[c] = w[Z + c]
    kernels.linearise(w, p, u)
    for c in range(felts):  # felt that is left starts anew, whatever it was
        channels.began[c] = 0 if w[Z + c] == channels.before[c] else 1
    stiff, damp, input_, mass, width = space.places[:5]
    first, row = space.places[5], space.places[6:]
    for i in range(n):
        for j in range(n):
            space.mass[m, i, j] = 0.0 if mass < 0 else w[mass + width * row[max(i, j)] + row[min(i, j)]]
            space.stiff[m, i, j] = w[stiff + width * row[i] + row[j]]
            space.damp[m, i, j] = w[damp + width * row[i] + row[j]]
    if mass < 0:
        for i in range(n):
            space.mass[m, i, i] = w[M_DIAG + i]
            up = parent[i]
            if up >= 0:
                space.mass[m, i, up] = w[M_UP + i]
                space.mass[m, up, i] = w[M_UP + i]
    parameter_loads(w, p, u, sources, loads, space.load[m], channels.load[m])
    for k in range(space.carried.shape[0]):
        for i in range(n):
            x = w[stiff + width * row[i] + first + k]
            if x != 0.0:
                for j in range(space.load.shape[2]):
                    space.load[m, i, j] += x * space.carried[k, j]
    if linear.input_slope.shape[0] > 0:
        for i in range(n):
            x = w[input_ + row[i]]
            for j in range(space.load.shape[2]):
                space.load[m, i, j] += x * space.input_change[0, j]
    if count > 0:
        fill_channels(m, w, channels)
        if felts < count and channels.modes.loaded[0] == 1:
            load_modes(m, n + count, loads.by_number, channels.modes)
