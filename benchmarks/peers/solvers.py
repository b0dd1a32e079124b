"""The peers: each factory makes a function of the tolerance that returns states and work counts.

All get the same compiled equations (parameters frozen as literals), the same force table, start and output times.
``rtol = atol = tolerance`` throughout, with each package's finite-difference Jacobian unless it makes its own or its
name says otherwise.
A factory raises ``Unavailable`` with the reason if its package is missing. Only solving is timed, not preparation.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import odeint

from benchmarks.peers.compiled import CompiledEquations, CompiledJacobian
from benchmarks.peers.equations import N
from model import Action

Array = NDArray[np.float64]
LIBRARIES = ("sundials_cvode", "sundials_nvecserial", "sundials_sunmatrixdense", "sundials_sunlinsoldense")


class Unavailable(Exception):
    """A peer is not available on this machine; the message gives the reason and a remedy."""


def build() -> ctypes.CDLL:
    """Compile and load the C program."""
    compiler = shutil.which("gcc")
    if compiler is None:
        raise Unavailable("gcc is missing")
    source = Path(__file__).with_name("cvode.c")
    names = [f"-l{name}" for name in LIBRARIES]
    problem = ""
    with tempfile.TemporaryDirectory(prefix="work-precision-", ignore_cleanup_errors=True) as folder:
        library = Path(folder) / "cvode_peer.so"
        base = [compiler, "-O3", "-march=native", "-shared", "-fPIC", "-o", str(library), str(source)]
        for extra in ([], ["-lsundials_core"]):  # SUNDIALS 7 has its context in a separate library
            done = subprocess.run([*base, *names, *extra, "-lm"], capture_output=True, text=True, check=False)
            if done.returncode == 0:
                return ctypes.CDLL(str(library))  # loaded: the file may be deleted
            problem = problem or (done.stderr.strip().splitlines() or ["no message"])[0]
    raise Unavailable(f"cvode.c does not build ({problem}); on Debian: apt-get install libsundials-dev")


def cvode_in_c(
    address: int, table: Array, y0: Array, times: Array, jacobian: int
) -> Callable[[float], tuple[Array, tuple[int, int, int, int]]]:
    """Return a function of the tolerance: states (m, n), and steps, rejected, right-hand sides, Jacobians.

    ``address`` is that of the right-hand side, ``jacobian`` that of the Jacobian.
    """
    library = build()
    double = np.ctypeslib.ndpointer(float, flags="C_CONTIGUOUS")
    library.solve.argtypes = [
        ctypes.c_void_p, ctypes.c_void_p, double, ctypes.c_longlong, ctypes.c_int, double, ctypes.c_int, double,
        ctypes.c_double, double, np.ctypeslib.ndpointer(np.int64, flags="C_CONTIGUOUS"),
    ]  # fmt: skip

    def run(tolerance: float) -> tuple[Array, tuple[int, int, int, int]]:
        out, counts = np.full((len(times), len(y0)), np.nan), np.zeros(4, dtype=np.int64)
        status = library.solve(
            address, jacobian, table, len(table), len(y0), y0, len(times), times, tolerance, out, counts
        )
        if status:
            raise RuntimeError(f"CVODE from C failed with status {status}")
        return out, (int(counts[0]), int(counts[1]), int(counts[2]), int(counts[3]))

    return run


@dataclass
class Answer:
    """Angles (m, 5) at the output times and work counts; None where the solver does not report them."""

    angle_rad: Array
    steps: int | None = None
    rejected: int | None = None
    rhs: int | None = None
    jacobians: int | None = None


@dataclass
class Task:
    """One blow as passed to every peer; output times (m,) are points of the force table."""

    action: Action
    equations: CompiledEquations
    jacobian: CompiledJacobian
    time_s: Array
    force_n: Array
    table: Array
    y0: Array
    output_s: Array


Solver = Callable[[float], Answer]


def scipy_odeint(task: Task) -> Solver:
    """SciPy ``odeint``: LSODA with its loop in compiled code; only the right-hand side is called from Python."""

    def run(tolerance: float) -> Answer:
        y, info = odeint(
            task.equations.give, task.y0, task.output_s, args=(task.table,), tfirst=True,
            rtol=tolerance, atol=tolerance, mxstep=10**7, full_output=True,
        )  # fmt: skip
        return Answer(y[:, :N], int(info["nst"][-1]), None, int(info["nfe"][-1]), int(info["nje"][-1]))

    return run


def c_cvode(task: Task) -> Solver:
    """CVODE (BDF) driven from C with the address of the compiled right-hand side and of the analytic Jacobian."""
    solve = cvode_in_c(task.equations.address, task.table, task.y0, task.output_s, task.jacobian.address)

    def run(tolerance: float) -> Answer:
        y, counts = solve(tolerance)
        return Answer(y[:, :N], *counts)

    return run
