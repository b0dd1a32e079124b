"""Hammer against one to three strings of modes: one march in equal steps, exact but for the force between steps.

Each mode is carried over a step by its own exact solution under a force that runs straight through the step; the forces
at the step's end follow from Newton's method on the felt law. Modes that are left out give way as springs. Conventions:
displacements positive the way the hammer moves; docs/explanation/string_and_motor.md.
"""

from math import cos, exp, sin, sqrt

import numpy as np

from model.kernels.compile import kernel

NEWTON = 50


@kernel
def fill_propagators(omega, sigma, push, step, out):
    """Row (8,) a mode: what displacement and velocity become, then what the forces at begin and end of a step add.

    q1 = r0 q + r1 v + r4 F0 + r5 F1 and v1 = r2 q + r3 v + r6 F0 + r7 F1; ``push`` is shape over modal mass, 1/kg.
    """
    for n in range(len(omega)):
        square = omega[n] * omega[n]
        left = square - sigma[n] * sigma[n]
        root = sqrt(abs(left))
        if left > 0.0:
            decay = exp(-sigma[n] * step)
            c, s = decay * cos(root * step), decay * sin(root * step) / root
        elif left < 0.0:  # overdamped: it creeps back
            slow, fast = exp((root - sigma[n]) * step), exp((-root - sigma[n]) * step)
            c, s = 0.5 * (slow + fast), 0.5 * (slow - fast) / root
        else:
            c = exp(-sigma[n] * step)
            s = c * step
        row = out[n]
        row[0], row[1] = c + sigma[n] * s, s
        row[2], row[3] = -square * s, c - sigma[n] * s
        for end in range(2):
            slope = (1.0 if end == 1 else -1.0) / step * push[n] / square
            level = (0.0 if end == 1 else 1.0) * push[n] / square - 2.0 * sigma[n] * slope / square
            row[4 + end] = level + slope * step - row[0] * level - row[1] * slope
            row[6 + end] = slope - row[2] * level - row[3] * slope


@kernel
def march(felt, shape, rows, soft, law, modes, force, hammer):
    """March (steps,) rows of ``force`` (steps, strings) and ``hammer`` (steps, 2: m, m/s); returns Newton's worst left.

    ``felt`` is the kernel of `model.derived.outside_a_scene`, ``shape`` (k,) at the hammer, ``rows`` (strings, k, 8),
    ``soft`` (strings,) m/N of what is left out, ``law`` the felt's numbers, the hammer's mass and the step, ``modes``
    (strings, k, 2) at rest on entry and at the last row on return. The first rows of force and hammer are given.
    """
    a, b, c, power, exponent, damping, mass, step = law
    strings, worst = len(rows), 0.0
    at, pressed, numbers = np.empty(2), np.empty(3), np.array([a, b, c, damping])
    f0, f1, free, gives = force[0].copy(), force[0].copy(), force[0].copy(), force[0].copy()
    moving, eases, lead, gain = force[0].copy(), force[0].copy(), force[0].copy(), force[0].copy()
    for i in range(strings):
        gives[i], eases[i] = soft[i], 0.0
        for n in range(len(shape)):
            gives[i] += shape[n] * rows[i, n, 5]
            eases[i] += shape[n] * rows[i, n, 7]
    y, v = hammer[0, 0], hammer[0, 1]
    for k in range(1, len(force)):
        total = 0.0
        for i in range(strings):
            f0[i] = force[k - 1, i]
            total += f0[i]
            free[i], moving[i] = 0.0, 0.0
            for n in range(len(shape)):
                q, w, row = modes[i, n, 0], modes[i, n, 1], rows[i, n]
                free[i] += shape[n] * (row[0] * q + row[1] * w + row[4] * f0[i])
                moving[i] += shape[n] * (row[2] * q + row[3] * w + row[6] * f0[i])
            f1[i] = f0[i]
        y0 = y + v * step - total * step * step / (3.0 * mass)
        v0 = v - total * step / (2.0 * mass)
        near, fast = step * step / (6.0 * mass), step / (2.0 * mass)
        left = 0.0
        for _ in range(NEWTON):
            pushes = 0.0
            for i in range(strings):
                pushes += f1[i]
            left, above, below = 0.0, 0.0, 1.0
            for i in range(strings):
                depth = y0 - near * pushes - free[i] - gives[i] * f1[i]
                rate = v0 - fast * pushes - moving[i] - eases[i] * f1[i]
                at[0], at[1] = depth, rate
                felt(at, at, numbers, pressed)
                fn, fx, fr = pressed
                if depth > 0.0 and power > 0.0 and 1.0 + damping * rate > 0.0:
                    more = power * depth**exponent
                    fn += more * (1.0 + damping * rate)
                    fx += exponent * more / depth * (1.0 + damping * rate)
                    fr += more * damping
                off = fn - f1[i]
                left = max(left, abs(off))
                own = 1.0 + fx * gives[i] + fr * eases[i]
                lead[i], gain[i] = off / own, (fx * near + fr * fast) / own
                above += lead[i]
                below += gain[i]
            together = above / below
            for i in range(strings):
                f1[i] += lead[i] - gain[i] * together
            if left <= 1e-12 * (1.0 + abs(pushes)):
                break
        worst = max(worst, left)
        total = 0.0
        for i in range(strings):
            f1[i] = max(f1[i], 0.0)
            total += f1[i]
            force[k, i] = f1[i]
            for n in range(len(shape)):
                q, w, row = modes[i, n, 0], modes[i, n, 1], rows[i, n]
                modes[i, n, 0] = row[0] * q + row[1] * w + row[4] * f0[i] + row[5] * f1[i]
                modes[i, n, 1] = row[2] * q + row[3] * w + row[6] * f0[i] + row[7] * f1[i]
        y, v = y0 - near * total, v0 - fast * total
        hammer[k, 0], hammer[k, 1] = y, v
    return worst
