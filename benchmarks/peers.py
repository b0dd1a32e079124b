"""Other people's stiff solvers on the model's equations, each with the same compiled right-hand side.

SciPy LSODA, BDF and Radau; CVODE through scikit-sundae and through a small C program (Debian's libsundials and a C
compiler; skipped with a line that says so where one is missing); and the NumPy twin, which is what a user would write.
No solver is told where the force table has its points; all keep steps to at most ``LONGEST``.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

import model
from model.kernels import workspace as W
from model.kernels.scenes import acceleration_of
from model.twin import Twin

LONGEST = 2e-3  # s: longer steps could miss the blow altogether
Array = NDArray[np.float64]


class Answer(NamedTuple):
    """Angles and speeds (m, 10) at the wanted times, right-hand sides and steps (-1: not told)."""

    rows: Array
    n_rhs: int
    n_steps: int


class Problem:
    """One blow from rest as y' = f(t, y)."""

    def __init__(self, action: model.Action, time_s: Array, force_n: Array) -> None:
        scene = model.build_scene(action)
        self.action, self.time, self.force = action, time_s, force_n
        self.start = np.concatenate([model.rest_state(action).angle_rad, np.zeros(scene.size)])
        self.vector = scene.vector
        acceleration, n = acceleration_of(scene.tables), scene.size
        start, spacing, last = time_s[0], time_s[1] - time_s[0], len(time_s) - 2
        if not np.allclose(np.diff(time_s), spacing):
            raise SystemExit("peers: force table with equal spacing needed")

        @numba.njit(nogil=True, error_model="numpy")
        def rhs(t: float, y: Array, out: Array, w: Array, p: Array, force: Array) -> None:
            k = min(max(int((t - start) / spacing), 0), last)
            u = force[k] + (force[k + 1] - force[k]) * (t - start - k * spacing) / spacing
            for i in range(n):
                w[W.Q + i] = y[i]
                w[W.V + i] = y[n + i]
            acceleration(w, p, u)
            for i in range(n):
                out[i] = y[n + i]
                out[n + i] = w[W.ACC + i]

        self._rhs, self._w, self._out = rhs, np.zeros(W.SIZE), np.zeros(2 * n)

        sizes = (2 * n, W.SIZE, len(scene.vector), len(force_n))

        @numba.cfunc(
            numba.types.void(
                numba.types.float64, numba.types.CPointer(numba.types.float64),
                numba.types.CPointer(numba.types.float64), numba.types.CPointer(numba.types.float64),
            )
        )  # fmt: skip
        def pointer(t, y, out, data):  # type: ignore[no-untyped-def]
            block = numba.carray(data, sizes[1] + sizes[2] + sizes[3])
            rhs(
                t, numba.carray(y, sizes[0]), numba.carray(out, sizes[0]), block[: sizes[1]],
                block[sizes[1] : sizes[1] + sizes[2]], block[sizes[1] + sizes[2] :],
            )  # fmt: skip

        self.pointer = pointer
        self.data = np.concatenate([np.zeros(W.SIZE), scene.vector, force_n])
        self(0.0, self.start)

    def __call__(self, t: float, y: Array) -> Array:
        """Right-hand side for solvers that call Python."""
        self._rhs(t, y, self._out, self._w, self.vector, self.force)
        return self._out.copy()


def scipy_solver(method: str) -> Callable[[Problem, Array, float], Answer]:
    """SciPy's ``solve_ivp`` with that method."""

    def run(problem: Problem, at: Array, tolerance: float) -> Answer:
        from scipy.integrate import solve_ivp

        out = solve_ivp(
            problem, (at[0], at[-1]), problem.start, method=method, t_eval=at, rtol=tolerance, atol=tolerance,
            max_step=LONGEST,
        )  # fmt: skip
        if not out.success:
            raise RuntimeError(out.message)
        return Answer(out.y.T, out.nfev, -1)

    return run


def sundae(problem: Problem, at: Array, tolerance: float) -> Answer:
    """CVODE through scikit-sundae, which calls Python for each right-hand side."""
    from sksundae.cvode import CVODE

    rhs, w, vector, force = problem._rhs, problem._w, problem.vector, problem.force

    def f(t: float, y: Array, out: Array) -> None:
        rhs(t, y, out, w, vector, force)

    solver = CVODE(f, method="BDF", rtol=tolerance, atol=tolerance, max_step=LONGEST, max_num_steps=10_000_000)
    out = solver.solve(at, problem.start)
    if not out.success:
        raise RuntimeError(out.message)
    return Answer(np.asarray(out.y), int(out.nfev), -1)


def build_cvode() -> ctypes.CDLL | str:
    """The C program as a library, or the reason why there is none."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        return "no C compiler"
    source = Path(__file__).with_name("cvode_run.c")
    library = Path(tempfile.mkdtemp()) / "cvode_run.so"
    names = ("cvode", "nvecserial", "sunmatrixdense", "sunlinsoldense")
    done = subprocess.run(
        [compiler, "-O2", "-shared", "-fPIC", str(source), "-o", str(library), *(f"-lsundials_{n}" for n in names)],
        capture_output=True, text=True,
    )  # fmt: skip
    if done.returncode:
        return f"libsundials not found ({(done.stderr or 'no message').splitlines()[0]})"
    loaded = ctypes.CDLL(str(library))
    loaded.run.restype = ctypes.c_long
    return loaded


def cvode_from_c(library: ctypes.CDLL) -> Callable[[Problem, Array, float], Answer]:
    """CVODE with nothing but machine code in its loop."""

    def run(problem: Problem, at: Array, tolerance: float) -> Answer:
        n = len(problem.start)
        rows, steps = np.zeros((len(at), n)), ctypes.c_long()
        start, times, data = problem.start.copy(), np.ascontiguousarray(at), problem.data

        def address(a: Array) -> Any:
            return a.ctypes.data_as(ctypes.c_void_p)

        count = library.run(
            ctypes.c_void_p(problem.pointer.address), address(data), n, address(start), len(at), address(times),
            address(rows), ctypes.c_double(tolerance), ctypes.c_double(LONGEST), ctypes.byref(steps),
        )  # fmt: skip
        if count < 0:
            raise RuntimeError(f"CVODE flag {count}")
        return Answer(rows, count, steps.value)

    return run


def twin_lsoda(problem: Problem, at: Array, tolerance: float) -> Answer:
    """What a user would write: the equations in NumPy, solved by LSODA."""
    from scipy.integrate import solve_ivp

    twin, n = Twin(problem.action), len(problem.start) // 2

    def f(t: float, y: Array) -> Array:
        force = float(np.interp(t, problem.time, problem.force))
        return np.concatenate([y[n:], twin.acceleration(y[:n], y[n:], force)])

    out = solve_ivp(
        f, (at[0], at[-1]), problem.start, method="LSODA", t_eval=at, rtol=tolerance, atol=tolerance, max_step=LONGEST
    )
    return Answer(out.y.T, out.nfev, -1)
