"""Force laws with their derivatives: felt (eqs. 2.4, 2.5), friction (eqs. 2.10, 2.12), springs (eq. A.3), an amplifier.

The normal force is clamped at zero: felt cannot pull, while eq. 2.4 would for fast separation.
"""

from math import exp, sqrt

from model.kernels.compile import inlined


@inlined
def felt(x, rate, a, b, c, damping):
    """Normal force, its derivative by penetration and by normal speed; (N, N/m, N s/m)."""
    if x <= 0.0:
        return 0.0, 0.0, 0.0
    fit = ((a * x + b) * x + c) * x
    factor = 1.0 + damping * rate
    # each factor by itself: two negative ones would push (docs/decisions/0022-model-felt-pocket.md)
    if fit <= 0.0 or factor <= 0.0:
        return 0.0, 0.0, 0.0
    return fit * factor, ((3.0 * a * x + 2.0 * b) * x + c) * factor, fit * damping


@inlined
def friction(s, per, a, b1, b2):
    """Smoothed friction coefficient (or torque) at speed ``s`` and its derivative by ``s``; ``per`` is 1/threshold."""
    z = s * per
    th = 1.0
    if abs(z) < 19.5:  # beyond, tanh is 1 to the last digit
        # one exponential: absolute accuracy is what a force needs, and libm's tanh takes twice the time
        e = exp(-2.0 * abs(z))
        th = (1.0 - e) / (1.0 + e)
    if z < 0.0:
        th = -th
    value = th
    slope = 1.0 - th * th
    if b1 != 0.0:
        z4 = z * z * z * z
        d = 1.0 + b2 * z4
        value += b1 * z / d
        slope += b1 * (1.0 - 3.0 * b2 * z4) / (d * d)
    return a * value, a * slope * per


@inlined
def soft_limit(x, limit, share):
    """``x`` held between -limit and limit, and its slope.

    Exactly ``x`` up to (1 - share) limit; four continuous derivatives there, so that a step keeps its order.
    """
    size = abs(x)
    width = share * limit
    if size <= limit - width:
        return x, 1.0
    s = (size - limit) / width + 1.0
    fourth = 1.0 + s * s * s * s
    root = sqrt(sqrt(fourth))
    value = limit - width + width * s / root
    return (value if x > 0.0 else -value), 1.0 / (fourth * root)


@inlined
def amplifier(u, current, loop, supply, limit, hold, share):
    """Voltage of an amplifier, its derivatives by the source ``u`` (V) and by the current; (V, 1, V/A).

    It gives ``u`` less what its current loop takes, and gives way beyond the largest current; within its supply.
    """
    allowed, slope = soft_limit(current, limit, share)
    volts, of_source = soft_limit(u - loop * current - hold * (current - allowed), supply, share)
    return volts, of_source, -of_source * (loop + hold * (1.0 - slope))
