"""CVODE driven by a C program: the cost of the method itself, without Python in its loop.

Builds ``cvode.c`` with gcc against the system's SUNDIALS (Debian: ``libsundials-dev``) in a temporary folder.
If the compiler or the library is missing, ``build`` raises ``Unavailable``.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

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


def version() -> str:
    """Version of the system's SUNDIALS and the compiler that `build` uses; empty where it cannot be built."""
    try:
        library = build()
    except Unavailable:
        return ""
    library.version.restype = ctypes.c_char_p
    told = subprocess.run(["gcc", "-dumpfullversion"], capture_output=True, text=True, check=False).stdout.strip()
    return f"SUNDIALS {library.version().decode()} of the system, driver by gcc {told} -O3 -march=native"


def cvode_in_c(
    address: int, table: Array, y0: Array, times: Array, jacobian: int | None = None
) -> Callable[[float], tuple[Array, tuple[int, int, int, int]]]:
    """Return a function of the tolerance: states (m, n), and steps, rejected, right-hand sides, Jacobians.

    ``address`` is that of the right-hand side, ``jacobian`` that of the Jacobian, by default difference quotients.
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
