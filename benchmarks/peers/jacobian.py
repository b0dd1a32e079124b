"""An analytic Jacobian of the peers' equations for CVODE in C, from the derivatives that our own kernels compute.

The model's ``linearise`` gives K = df/dq - (dM/dq) a, D = df/dv, the accelerations a and the mass matrix M; the lower
half of the Jacobian is M^-1 (K, D). ``largest_deviation`` compares it with central differences of the peers' equations.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core.imputils import lower_constant
from numpy.typing import NDArray

from benchmarks.peers.compiled import CompiledEquations, force_at
from benchmarks.peers.equations import N
from model import Action
from model.derived.load import kernels_of
from model.kernels import workspace as W
from model.kernels.kernel_value import KernelType
from model.scene.build import build_scene

Array = NDArray[np.float64]


@lower_constant(KernelType)
def _address(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    # an address compiled in: only for what is never cached, such as the function below
    return ir.Constant(ir.IntType(64), value.address)


class CompiledJacobian:
    """The Jacobian as compiled code; y is 5 angles (rad) and 5 speeds (rad/s).

    Attributes
    ----------
    fill : (t, y, jacobian (100,) column by column, table)
    address : of a C function with the arguments of `CompiledEquations`'s, which fills the matrix
    """

    def __init__(self, action: Action) -> None:
        scene = build_scene(action)
        linearise, vector = kernels_of(scene.tables).linearise, scene.vector
        parent = tuple(int(i) for i in scene.tables.parent)

        @numba.njit(error_model="numpy")
        def fill(t, y, jacobian, table):  # type: ignore[no-untyped-def]
            w = np.zeros(W.SIZE)
            for i in range(N):
                w[W.Q + i] = y[i]
                w[W.V + i] = y[N + i]
            linearise(w, vector, force_at(t, table))
            for column in range(2 * N):
                at = (W.STIFF if column < N else W.DAMP) + column % N
                # M x = a column of K or D: children eliminated into their parents
                for i in range(N):
                    jacobian[2 * N * column + i] = 1.0 if column == N + i else 0.0
                for i in range(N):
                    if parent[i] < 0:
                        top = w[at + W.WIDTH * i]
                        bottom = w[W.M_DIAG + i]
                        for k in range(N):
                            if parent[k] == i:
                                share = w[W.M_UP + k] / w[W.M_DIAG + k]
                                top -= share * w[at + W.WIDTH * k]
                                bottom -= share * w[W.M_UP + k]
                        x = top / bottom
                        jacobian[2 * N * column + N + i] = x
                        for k in range(N):
                            if parent[k] == i:
                                own = w[at + W.WIDTH * k] - w[W.M_UP + k] * x
                                jacobian[2 * N * column + N + k] = own / w[W.M_DIAG + k]

        pointer = types.CPointer(types.float64)

        @numba.cfunc(types.void(types.float64, pointer, pointer, pointer, types.int64), error_model="numpy")
        def from_c(t: float, y: Any, jacobian: Any, table: Any, size: int) -> None:
            fill(t, numba.carray(y, 2 * N), numba.carray(jacobian, 4 * N * N), numba.carray(table, size))

        self.fill = fill
        self._from_c = from_c  # keeps the machine code alive
        self.address: int = from_c.address  # type: ignore[assignment]

    def largest_deviation(self, equations: CompiledEquations, states: Array, table: Array) -> float:
        """Largest difference, relative to the largest entry, from central differences at ``states`` (m, 10)."""
        worst = 0.0
        for y in states:
            exact = np.zeros(4 * N * N)
            self.fill(0.0, y, exact, table)
            differences = np.empty((2 * N, 2 * N))
            for j in range(2 * N):
                step = np.zeros(2 * N)
                step[j] = 1e-7 if j < N else 1e-6
                high, low = (equations.give(0.0, y + sign * step, table) for sign in (1.0, -1.0))
                differences[j] = (high - low) / (2.0 * step[j])
            scale = np.abs(differences).max()
            worst = max(worst, float(np.abs(exact.reshape(2 * N, 2 * N) - differences).max() / scale))
        return worst
