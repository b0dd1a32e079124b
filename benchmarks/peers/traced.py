"""Peers that trace the equations into their own expressions and compile those: CasADi and diffrax.

Both get exact Jacobians by automatic differentiation. They cannot skip open contacts by a branch: every law is
evaluated and masked. Compilation is not timed; it is slow, and printed with the benchmark's preparation times.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.equations import N, accelerations
from benchmarks.peers.solvers import Answer, Solver, Task, Unavailable

Array = NDArray[np.float64]
# one set of equations serves all blows; CasADi itself recompiles their derivatives once they have been released
_casadi_rhs: weakref.WeakKeyDictionary[Any, Any] = weakref.WeakKeyDictionary()


def _casadi_function(ca: Any, task: Task) -> Any:
    """The equations as a CasADi function, compiled with gcc where there is one."""
    if task.equations in _casadi_rhs:
        return _casadi_rhs[task.equations]
    names = {"sin": ca.sin, "cos": ca.cos, "tanh": ca.tanh, "sqrt": ca.sqrt, "where": ca.if_else}
    y, u = ca.SX.sym("y", 2 * N), ca.SX.sym("u")
    dy = ca.vertcat(y[N:], *accelerations(task.action, names, branches=False)(y, u))
    options: dict[str, Any] = {}
    if shutil.which("gcc") is not None:
        flags = ["-O2", "-march=native"]
        options = {"jit": True, "jit_cleanup": False, "compiler": "shell"}  # its folder is removed as a whole
        options["jit_options"] = {"flags": flags, "cleanup": False}
    _casadi_rhs[task.equations] = ca.Function("rhs", [y, u], [dy], options)
    return _casadi_rhs[task.equations]


def casadi_cvodes(task: Task) -> Solver:
    """CVODES of CasADi, Newton with an exact Jacobian."""
    try:
        import casadi as ca
    except ImportError:
        raise Unavailable("casadi is missing; pip install casadi") from None
    integrators: dict[float, Any] = {}

    def prepare(tolerance: float) -> Any:
        rhs = _casadi_function(ca, task)
        force = ca.interpolant("force", "linear", [task.time_s], task.force_n, {"lookup_mode": ["exact"]})
        x, t = ca.MX.sym("x", 2 * N), ca.MX.sym("t")
        problem = {"x": x, "t": t, "ode": rhs(x, force(t))}
        options = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 10**7}
        times = task.output_s
        return ca.integrator("cvodes", "cvodes", problem, float(times[0]), times[1:], options)

    def run(tolerance: float) -> Answer:
        if tolerance not in integrators:
            integrators[tolerance] = prepare(tolerance)
        solve = integrators[tolerance]
        states = np.asarray(solve(x0=task.y0)["xf"]).T
        angles = np.vstack([task.y0[None, :N], states[:, :N]])
        told = solve.stats().get
        return Answer(angles, told("nsteps"), told("netfails"), told("nfevals"), told("nlinsetups"))

    # its compiler writes files to the working directory
    here = os.getcwd()
    with tempfile.TemporaryDirectory(prefix="work-precision-", ignore_cleanup_errors=True) as folder:
        os.chdir(folder)
        try:
            integrators[1e-4] = prepare(1e-4)
        finally:
            os.chdir(here)
    return run


def diffrax_kvaerno5(task: Task) -> Solver:
    """Kvaerno's ESDIRK of order 5 in diffrax (JAX, 64 bit, on the processor)."""
    try:
        import diffrax
        import jax
        import jax.numpy as jnp
    except ImportError:
        raise Unavailable("diffrax is missing; pip install diffrax") from None
    jax.config.update("jax_enable_x64", True)
    names = {"sin": jnp.sin, "cos": jnp.cos, "tanh": jnp.tanh, "sqrt": jnp.sqrt, "where": jnp.where}
    law = accelerations(task.action, names, branches=False)

    def rhs(t: Any, y: Any, force: Any) -> Any:
        x = (t - task.table[0]) * task.table[1]
        k = jnp.clip(x.astype(int), 0, len(task.force_n) - 2)
        u = force[k] + (force[k + 1] - force[k]) * (x - k)
        return jnp.concatenate([y[N:], jnp.stack(law(y, u))])

    def solve(tolerance: Any, force: Any) -> Any:
        return diffrax.diffeqsolve(
            diffrax.ODETerm(rhs), diffrax.Kvaerno5(), task.output_s[0], task.output_s[-1], 1e-5, jnp.asarray(task.y0),
            args=force, saveat=diffrax.SaveAt(ts=jnp.asarray(task.output_s)), max_steps=10**7,
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
        )  # fmt: skip

    force = jnp.asarray(task.force_n)
    ready = jax.jit(solve).lower(1e-4, force).compile()

    def run(tolerance: float) -> Answer:
        solution = ready(jnp.asarray(tolerance), force)
        steps, rejected = (int(solution.stats[f"num_{k}_steps"]) for k in ("accepted", "rejected"))
        return Answer(np.asarray(solution.ys)[:, :N], steps, rejected)

    return run
