"""Identify the hammer's friction with an optimiser of one's own: residual and exact Jacobian for SciPy.

Run:  python examples/own_optimiser.py

All else is held here, so that it takes seconds; without ``fixed`` everything uncertain takes part.
"""

import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

import rig
import validation

folder = Path(tempfile.mkdtemp()) / "session"
session = rig.record(folder, profile="forte", trials=3, backend="sim://", operator="example")

problem = validation.residual_problem([session], ["hammer.joint_friction"], fixed=("*",))
found = least_squares(problem.residual, problem.start, problem.jacobian, bounds=problem.bounds)
u = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
values = problem.values(found.x)  # of the action; the force's gain, level and delay are fitted beside them
for name, z, z_u in zip(problem.names, found.x, u, strict=True):
    value = f"{values[name]:.3g} N m; " if name in values else ""
    print(f"{name}: {value}z {z:.2f}, u {z_u:.2f} of the prior's")
