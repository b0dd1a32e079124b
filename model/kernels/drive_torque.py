"""Torque of a motor along a recorded command and a recorded motion, for several sets of numbers of its circuit."""

from math import expm1

from model.kernels.compile import kernel
from model.kernels.laws import soft_limit

SUBSTEPS = 4
MICROSTEPS = 12  # of a substep in which a limit sets in
SETTLING = 60  # steps of a few delays each, until the current is where the first command leaves it


@kernel
def torque_along(lumps, largest, command, turned, interval, softness, out):
    """Fill ``out`` (p, k), N m, at the ends of all substeps, for rows of ``lumps`` (p, 7).

    Equations: `model.drive.circuit`. ``turned`` holds the angle of the motor, rad, at the ends of all substeps.

    Steps are exact where the circuit is linear (exponential Rosenbrock-Euler), of second order where a limit sets in.
    """
    n = command.shape[0]
    for row in range(lumps.shape[0]):
        gain, delay, damping, ceiling, supply, share, firmness = lumps[row]
        m = 0.0
        for step in range((n - 1) * SUBSTEPS + SETTLING):
            k = max(0, step - SETTLING)
            at = k // SUBSTEPS
            h = interval / SUBSTEPS
            emf = damping * (turned[k + 1] - turned[k]) / h
            if step < SETTLING:
                h, emf = 5.0 * delay, 0.0
            else:
                out[row, k] = m
            source = min(max(gain * command[at], -largest[row]), largest[row])
            asked = source - (1.0 - share) * m
            near = abs(m) > (1.0 - softness) * ceiling or abs(asked) > (1.0 - softness) * supply
            parts = MICROSTEPS if near else 1
            for _ in range(parts):
                held, held_slope = soft_limit(m, ceiling, softness)
                volts, slope = soft_limit(source - (1.0 - share) * m - firmness * (m - held), supply, softness)
                pull = (share + slope * (1.0 - share + firmness * (1.0 - held_slope))) / delay * h / parts
                rate = (volts - share * m - emf) / delay * h / parts
                m += rate if pull < 1e-9 else rate * -expm1(-pull) / pull
        out[row, (n - 1) * SUBSTEPS] = m
