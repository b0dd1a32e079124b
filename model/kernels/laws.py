"""Force laws with their derivatives: felt (eqs. 2.4, 2.5), friction (eqs. 2.10, 2.12), springs (eq. A.3).

The normal force is clamped at zero: felt cannot pull, while eq. 2.4 would for fast separation.
"""

from math import exp

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
