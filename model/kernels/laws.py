"""Felt (eqs. 2.4, 2.5) and a soft limit with their derivatives, for a hammer and a drive by themselves.

The normal force is clamped at zero: felt cannot pull, while eq. 2.4 would for fast separation.
"""

from math import sqrt

from model.kernels.compile import inlined


@inlined
def felt(x, rate, a, b, c, damping):
    """Normal force, its derivative by penetration and by normal speed; (N, N/m, N s/m)."""
    if x <= 0.0:
        return 0.0, 0.0, 0.0
    fit = ((a * x + b) * x + c) * x
    factor = 1.0 + damping * rate
    # each factor by itself: two negative ones would push (docs/explanation/felt.md)
    if fit <= 0.0 or factor <= 0.0:
        return 0.0, 0.0, 0.0
    return fit * factor, ((3.0 * a * x + 2.0 * b) * x + c) * factor, fit * damping


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
