"""Felt laws with memory along a given press: force and stored energy at every sample, in reference form.

In: times, s, depths, m, of one press, and a law's numbers. Out: force, N, and stored energy, J, written into arrays
(n,). Each step is the exact solution of its state between two samples, so that nothing here depends on how finely a
slow press is sampled. Equations, passivity and limits: docs/explanation/felt.md.
"""

from math import exp

from model.kernels.compile import kernel

HALVINGS = 60  # of a step in search of the instant the surfaces part or meet: to the last bit


@kernel
def fill_stulov(time, depth, f0, exponent, epsilon, tau, force, stored):
    """Stulov's felt: force F0 (u - eps h) of u = x^p, memory tau dh/dt = max(u, eps h) - h."""
    h, u0 = 0.0, max(depth[0], 0.0) ** exponent
    for k in range(len(time)):
        u = max(depth[k], 0.0) ** exponent
        if k > 0:
            h = _remembered(time[k] - time[k - 1], u0, u, h, epsilon, tau)
        u0 = u
        pressed = max(u, epsilon * h)  # the surface of felt that is left behind, where it is
        force[k] = f0 * (pressed - epsilon * h)
        x, q = pressed ** (1.0 / exponent), 1.0 / exponent
        stored[k] = f0 * (x ** (exponent + 1.0) / (exponent + 1.0) - epsilon * (h * x - h ** (1.0 + q) / (1.0 + q)))


@kernel
def _under_load(at, step, u0, u1, h, tau):
    """Memory after the time ``at`` of a step in which u runs straight from u0 to u1."""
    slope = (u1 - u0) / step
    return u0 + slope * (at - tau) + (h - u0 + slope * tau) * exp(-at / tau)


@kernel
def _remembered(step, u0, u1, h, epsilon, tau):
    """Memory at the end of a step that may part or meet the surfaces once."""
    touching = u0 >= epsilon * h
    if touching:
        end = _under_load(step, step, u0, u1, h, tau)
        changes = u1 < epsilon * end
    else:
        end = h * exp(-(1.0 - epsilon) * step / tau)
        changes = u1 > epsilon * end
    if not changes:
        return end
    low, high = 0.0, step
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if touching:
            then = _under_load(middle, step, u0, u1, h, tau)
        else:
            then = h * exp(-(1.0 - epsilon) * middle / tau)
        if (u0 + (u1 - u0) * middle / step >= epsilon * then) == touching:
            low = middle
        else:
            high = middle
    left = step - high
    if touching:
        return _under_load(high, step, u0, u1, h, tau) * exp(-(1.0 - epsilon) * left / tau)
    met = h * exp(-(1.0 - epsilon) * high / tau)
    if left <= 0.0:
        return met
    return _under_load(left, left, u0 + (u1 - u0) * high / step, u1, met, tau)


@kernel
def fill_hysteresis(depth, a, b, c, shares, reaches, force, stored):
    """Felt whose loop does not depend on speed: force f(x) (1 + sum of share z), dz = (dx - |dx| z) / (reach x)."""
    z = shares * 0.0 + 1.0
    before = depth[0]
    for k in range(len(depth)):
        x = depth[k]
        if x <= 0.0:
            z[:] = 1.0  # at the depth 0 the memory has no length: what touches next starts on the loading branch
            force[k], stored[k], before = 0.0, 0.0, x
            continue
        if before > 0.0 and x != before:
            way = 1.0 if x > before else -1.0
            for i in range(len(z)):
                z[i] = way + (z[i] - way) * (before / x) ** (way / reaches[i])
        before = x
        fit = max(0.0, ((a * x + b) * x + c) * x)
        factor, memory = 1.0, 0.0
        for i in range(len(z)):
            factor += shares[i] * z[i]
            memory += shares[i] * reaches[i] * z[i] * z[i]
        force[k] = fit * factor
        stored[k] = x * x * (0.5 * c + x * (b / 3.0 + 0.25 * a * x)) + 0.5 * fit * x * memory
