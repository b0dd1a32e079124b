"""Torque of a motor along a recorded command and motion, for several sets of circuit parameters."""

from math import expm1

import numpy as np

from model.kernels.compile import kernel

SUBSTEPS = 4  # of a sample: steps are exact while no limit sets in
MICROSTEPS = 12  # of a substep in which a limit sets in
SETTLING = 60  # steps of a few delays each, until the current is where the first command leaves it


@kernel
def integrate_torque(amplifier_kernel, lumps, source_limit, command, turned, interval, softness, out):
    """Fill ``out`` (p, k) with the motor's torque, N m, at the ends of substeps, for ``lumps`` (p, 7); ``command`` (V)
    every ``interval`` s, ``turned`` (k,): motor's angle, rad, ``source_limit`` (p,), ``softness``: of limits.

    Equations: `model.drive.lumps`; ``amplifier_kernel`` is that of `model.codegen.single_element`.

    Steps are exact where the circuit is linear (exponential Rosenbrock-Euler), of second order where a limit sets in.
    """
    n = command.shape[0]
    at, numbers, volts = np.empty(2), np.empty(5), np.empty(2)
    for row in range(lumps.shape[0]):
        gain, delay, damping, ceiling, supply, share, firmness = lumps[row]
        numbers[0], numbers[1], numbers[2], numbers[3], numbers[4] = 1.0 - share, supply, ceiling, firmness, softness
        m = 0.0
        for step in range((n - 1) * SUBSTEPS + SETTLING):
            k = max(0, step - SETTLING)
            h = interval / SUBSTEPS
            emf = damping * (turned[k + 1] - turned[k]) / h
            if step < SETTLING:
                h, emf = 5.0 * delay, 0.0  # "a few delays"
            else:
                out[row, k] = m
            source = min(max(gain * command[k // SUBSTEPS], -source_limit[row]), source_limit[row])
            asked = source - (1.0 - share) * m
            near = abs(m) > (1.0 - softness) * ceiling or abs(asked) > (1.0 - softness) * supply
            parts = MICROSTEPS if near else 1
            for _ in range(parts):
                at[0], at[1] = source, m
                amplifier_kernel(at, at, numbers, volts)
                pull = (share - volts[1]) / delay * h / parts
                rate = (volts[0] - share * m - emf) / delay * h / parts
                m += rate if pull < 1e-9 else rate * -expm1(-pull) / pull
        out[row, (n - 1) * SUBSTEPS] = m
