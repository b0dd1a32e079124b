"""The linearised equations of a motion at the nodes of a step, with what each parameter adds to them.

M, K and D are the kernels' analytic linearisation. What a parameter adds, alpha, is a central difference of the
accelerations at one state: smooth there, and of few contacts only.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from model.integrators.rosenbrock import STAGE
from model.integrators.tangents.recorded_motion import KERNELS, NUMBERS
from model.kernels.compile import inlined, step_loop
from model.kernels.signatures import SceneNumbers, StepKernels
from model.kernels.workspace import DAMP, GAP, GAP_RATE, M_DIAG, M_UP, PIECE, STIFF, WIDTH, Q, U, V

LANES = 8  # parameters side by side; their number is filled up to a multiple of it
SMALL_PRESS = 0.3  # share of what a felt is pressed in that a difference may move its surface
LEAST_SHARE = 1e-5
VERGE, STILL = 1e-9, 1e-6  # m, m/s


class Columns(NamedTuple):
    """Parameters (p,) as changes of the parameter vector: where, by how much for a step of a difference.

    ``skipped`` is a mask of contacts that the parameter leaves as they are, ``own`` the place of the one contact that
    it changes, or -1; ``moved`` is the most that it moves a surface in a step of a difference, m.
    """

    first: np.ndarray  # (p + 1,) where the entries of each column begin
    entry: np.ndarray  # index in the parameter vector
    change: np.ndarray
    step: np.ndarray  # (p,) of the difference, in the parameter's unit
    skipped: np.ndarray
    own: np.ndarray
    moved: np.ndarray
    turn: np.ndarray  # columns with the same contacts one after the other


class Space(NamedTuple):
    """Memory of a run: workspaces of the scene's kernels, a parameter vector to change, and the linearised equations.

    ``mass``, ``stiff``, ``damp`` (4, n, n) and ``alpha`` (4, n, P) hold M, K, D and alpha at the start of a step and at
    its three nodes.
    """

    point: np.ndarray
    changed_point: np.ndarray
    changed: np.ndarray
    zeros: np.ndarray
    before: np.ndarray  # (n,) accelerations that a difference begins with
    mass: np.ndarray
    stiff: np.ndarray
    damp: np.ndarray
    alpha: np.ndarray
    matrix: np.ndarray  # (3 n, 3 n)
    order: np.ndarray  # (3 n,) of its rows after pivoting
    slopes: np.ndarray  # (3 n, P) nu' at the nodes
    error: np.ndarray  # (2 n, P)
    largest: np.ndarray  # (2 n, P) so far


class Linear(NamedTuple):
    """A scene whose equations are linearised, its parameters, and the memory for it."""

    scene: SceneNumbers
    kernels: StepKernels
    columns: Columns
    space: Space


_f, _i = types.float64, types.int64
_numbers, _table, _cube = (types.Array(_f, k, "C") for k in (1, 2, 3))
_integers = types.Array(_i, 1, "C")
COLUMNS = types.NamedTuple(
    [_integers, _integers, _numbers, _numbers, _integers, _integers, _numbers, _integers], Columns
)
SPACE = types.NamedTuple(
    [
        _numbers,
        _numbers,
        _numbers,
        _numbers,
        _numbers,
        _cube,
        _cube,
        _cube,
        _cube,
        _table,
        _integers,
        _table,
        _table,
        _table,
    ],
    Space,
)
LINEAR = types.NamedTuple([NUMBERS, KERNELS, COLUMNS, SPACE], Linear)
LINEARISE_NODE = types.void(_i, _f, LINEAR)


@inlined
def accelerate(space, p, u, mask, stage):
    """Accelerations with a changed parameter vector, at ``U + STAGE + WIDTH`` of the workspace.

    The stage kernel of an integration, in a workspace with no matrix, no earlier stage and no limits.
    """
    stage(space.changed_point, p, space.zeros, space.zeros, 1, 0.0, 1.0, u, 0.0, mask)


@inlined
def differences(m, pushing, pressed, p, u, linear):
    """Fill row ``m`` of alpha with derivatives of the accelerations by each parameter at a fixed state.

    Where a parameter moves surfaces, central; else forward from what others with the same contacts begin with too:
    accelerations are linear in what a law is multiplied by, and nearly so in a millionth of a mass.
    """
    columns, space = linear.columns, linear.space
    w, changed, alpha = space.changed_point, space.changed, space.alpha[m]
    n = alpha.shape[0]
    at = U + STAGE + WIDTH
    begun, same = False, 0
    for turn in range(columns.step.shape[0]):
        j = columns.turn[turn]
        own = columns.own[j]
        if own >= 0 and pushing >> own & 1 == 0:
            for i in range(n):
                alpha[i, j] = 0.0
            continue
        mask = columns.skipped[j] | ~pushing
        first, last = columns.first[j], columns.first[j + 1]
        if columns.moved[j] > 0.0:
            share = max(LEAST_SHARE, min(1.0, SMALL_PRESS * pressed / columns.moved[j]))
            inverse = 0.5 / (share * columns.step[j])
            for k in range(first, last):
                changed[columns.entry[k]] = p[columns.entry[k]] - share * columns.change[k]
            accelerate(space, changed, u, mask, linear.kernels.stage)
            for i in range(n):
                space.before[i] = w[at + i]
            begun = False
        else:
            share = 1.0
            inverse = 1.0 / columns.step[j]
            if not begun or mask != same:
                accelerate(space, p, u, mask, linear.kernels.stage)
                for i in range(n):
                    space.before[i] = w[at + i]
                begun, same = True, mask
        for k in range(first, last):
            changed[columns.entry[k]] = p[columns.entry[k]] + share * columns.change[k]
        accelerate(space, changed, u, mask, linear.kernels.stage)
        for i in range(n):
            alpha[i, j] = (w[at + i] - space.before[i]) * inverse
        for k in range(first, last):
            changed[columns.entry[k]] = p[columns.entry[k]]


@step_loop(LINEARISE_NODE)
def linearise_node(m, u, linear):
    """Linearise at the state in ``space.point`` and fill row ``m`` of M, K, D and alpha."""
    scene, kernels, columns, space = linear
    p, parent, n_contacts = scene
    w, twin = space.point, space.changed_point
    n = space.alpha.shape[1]
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
    pressed = 1e300
    pushing = 0
    for k in range(n_contacts):
        if w[GAP + k] < 0.0:
            pushing |= 1 << k
            # felt that rests on the verge of touching has no derivative there; it shall not make all others noisy
            if w[GAP + k] < -VERGE or abs(w[GAP_RATE + k]) > STILL:
                pressed = min(pressed, -w[GAP + k])
    for i in range(WIDTH):
        twin[Q + i] = w[Q + i]
        twin[V + i] = w[V + i]
    twin[PIECE] = w[PIECE]
    differences(m, pushing, pressed, p, u, linear)
