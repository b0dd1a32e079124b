"""The straight-line equations compiled with numba: right-hand sides for the peers, and the explicit reference.

The force table is passed as one array: first time (s), points per second, then the forces (N); points are equally
spaced, so that a look-up costs nothing. The explicit reference is Dormand and Prince's method of order 8
(coefficients read from SciPy's DOP853), compiled; a step ends at every point of the table, so that no kink of the
force lies inside one.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core.imputils import lower_constant
from numpy.typing import NDArray
from scipy.integrate import DOP853

from benchmarks.peers.equations import N, accelerations
from model import Action
from model.codegen.load import load_kernels
from model.files import force_library as forces
from model.kernels import workspace as W
from model.kernels.kernel_value import KernelType
from model.scene.build import build_scene

RATE_HZ, DURATION_S = forces.RATE_HZ, forces.DURATION_S
NOISE_N = 0.05
BLOWS = ("forte", "piano", "double", "fortissimo", "noisy")


def force_table(blow: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (k,) and forces (k,) of one blow; ``noisy`` is the forte as read by a load cell with 0.05 N noise."""
    time, force = forces.force_table("forte" if blow == "noisy" else blow)
    if blow == "noisy":
        noise = np.random.default_rng(4).normal(0.0, NOISE_N, len(time))
        at, newton = forces.KNOTS["forte"]
        force = np.round(np.interp(time, np.array(at, dtype=float), np.array(newton, dtype=float)) + noise, 4)
    return time, force


Array = NDArray[np.float64]
READ = types.Array(types.float64, 1, "C", readonly=True)
WRITE = types.float64[::1]


@numba.njit(types.float64(types.float64, READ))
def force_at(t: float, table: Array) -> float:
    """Force at ``t``, interpolated linearly between the points, constant beyond them."""
    last = table.shape[0] - 3
    x = (t - table[0]) * table[1]
    if x <= 0.0:
        return table[2]
    if x >= last:
        return table[2 + last]
    k = int(x)
    return table[2 + k] + (table[3 + k] - table[2 + k]) * (x - k)


def pack(time_s: Array, force_n: Array) -> Array:
    """Return a force table of equally spaced points as one array."""
    return np.concatenate([[time_s[0], (len(time_s) - 1) / (time_s[-1] - time_s[0])], force_n])


class CompiledEquations:
    """Compiled forms of one action's right-hand side; y is 5 angles (rad) and 5 speeds (rad/s).

    Attributes
    ----------
    accelerations : (y, u) -> 5 numbers
    fill : (t, y, dy, table), writes the derivative into ``dy``
    give : (t, y, table) -> dy
    address : of a C function ``void (double t, const double *y, double *dy, const double *table, long long size)``
    """

    def __init__(self, action: Action) -> None:
        a = numba.njit(types.UniTuple(types.float64, N)(READ, types.float64), error_model="numpy")(
            accelerations(action)
        )

        @numba.njit(types.void(types.float64, READ, WRITE, READ), error_model="numpy")
        def fill(t: float, y: Array, dy: Array, table: Array) -> None:
            acc = a(y, force_at(t, table))
            for i in range(N):
                dy[i] = y[N + i]
                dy[N + i] = acc[i]

        @numba.njit(WRITE(types.float64, READ, READ), error_model="numpy")
        def give(t: float, y: Array, table: Array) -> Array:
            dy = np.empty(2 * N)
            fill(t, y, dy, table)
            return dy

        pointer = types.CPointer(types.float64)

        @numba.cfunc(types.void(types.float64, pointer, pointer, pointer, types.int64), error_model="numpy")
        def from_c(t: float, y: Any, dy: Any, table: Any, size: int) -> None:
            fill(t, numba.carray(y, 2 * N), numba.carray(dy, 2 * N), numba.carray(table, size))

        self.accelerations, self.fill, self.give = a, fill, give
        self._from_c = from_c  # keeps the machine code alive
        self.address: int = from_c.address  # type: ignore[assignment]
        self._explicit: Any = None

    def explicit(self, y0: Array, table: Array, every: int, tolerance: float) -> tuple[Array, int]:
        """States (m, 10) at every ``every``-th point of the table by the explicit method, and the number of steps."""
        if self._explicit is None:
            self._explicit = _explicit_method(self.fill)
        out = np.full(((table.shape[0] - 3) // every + 1, 2 * N), np.nan)
        steps = self._explicit(y0, table, every, tolerance, out)
        if not np.isfinite(out).all():
            raise SystemExit("the explicit reference failed: it gave values that are not finite")
        return out, int(steps)


def _explicit_method(fill: Any) -> Any:
    a, b, c = (np.ascontiguousarray(getattr(DOP853, k), dtype=float) for k in "ABC")
    e3, e5 = (np.ascontiguousarray(getattr(DOP853, k), dtype=float) for k in ("E3", "E5"))
    stages = DOP853.n_stages

    @numba.njit(types.int64(WRITE, READ, types.int64, types.float64, types.float64[:, ::1]), error_model="numpy")
    def run(start: Array, table: Array, every: int, tolerance: float, out: Array) -> int:
        n = start.shape[0]
        k = np.zeros((stages + 1, n))
        y, trial = start.copy(), np.empty(n)
        out[0] = y
        h, steps = 1e-6, 0
        fill(table[0], y, k[0], table)
        for knot in range(table.shape[0] - 3):
            t = table[0] + knot / table[1]
            end = table[0] + (knot + 1) / table[1]
            while t < end:
                step = h
                if t + 1.0001 * step >= end:
                    step = end - t
                for s in range(1, stages + 1):
                    for i in range(n):
                        total = 0.0
                        for j in range(s):
                            total += (a[s, j] if s < stages else b[j]) * k[j, i]
                        trial[i] = y[i] + step * total
                    fill(t + (c[s] if s < stages else 1.0) * step, trial, k[s], table)
                third, fifth = 0.0, 0.0
                for i in range(n):
                    scale = tolerance * (1.0 + max(abs(y[i]), abs(trial[i])))
                    d3, d5 = 0.0, 0.0
                    for j in range(stages + 1):
                        d3 += e3[j] * k[j, i]
                        d5 += e5[j] * k[j, i]
                    third += (d3 / scale) ** 2
                    fifth += (d5 / scale) ** 2
                error = 0.0 if fifth == 0.0 else step * fifth / np.sqrt((fifth + 0.01 * third) * n)
                if not np.isfinite(error):
                    return steps
                factor = 5.0 if error == 0.0 else min(5.0, max(0.2, 0.9 * error**-0.125))
                if error <= 1.0:
                    steps += 1
                    t = end if step == end - t else t + step
                    y[:] = trial
                    k[0] = k[stages]
                    h = max(h, step * factor) if step < h else step * factor
                else:
                    h = step * factor
                    if h < 1e-14:
                        return steps
            if (knot + 1) % every == 0:
                out[(knot + 1) // every] = y
        return steps

    return run


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
        linearise, vector = load_kernels(scene.tables).linearise, scene.vector
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
