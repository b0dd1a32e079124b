"""Exponential, logarithm and power of lanes, with bounds on their errors.

Made of correctly rounded operations only: the same bits on every machine. Bounds, in units in the last place (ulp) of
the result unless said, held to in tests/model/kernels/lanes/test_maths.py against 64-bit mantissas: exponential 1.25,
logarithm 1, power a relative (2 + |y log x|) 1.2e-16. NaN gives NaN.
"""

from model.kernels.compile import inlined
from model.kernels.lanes.operations import exponent_of, fused, mantissa_of, two_to, where

ROUND = 6755399441055744.0  # 1.5 * 2^52: added and taken away it leaves a whole number
LOG2_E, LN2_HIGH, LN2_LOW = 1.4426950408889634, 6.93147180369123816490e-01, 1.90821492927058770002e-10


@inlined
def exponential_near(x):
    """The exponential of |x| < 700, without care for overflow."""
    shifted = fused(x, LOG2_E, ROUND)
    k = shifted - ROUND
    r = fused(k, -LN2_LOW, fused(k, -LN2_HIGH, x))
    square = r * r
    # Taylor's series: beyond r^13 it is below 2^-57
    low = fused(r, 1.0 / 6.0, 0.5)
    middle = fused(r, 1.0 / 120.0, 1.0 / 24.0)
    high = fused(r, 1.0 / 5040.0, 1.0 / 720.0)
    top = fused(r, 1.0 / 362880.0, 1.0 / 40320.0)
    over = fused(r, 1.0 / 39916800.0, 1.0 / 3628800.0)
    last = fused(r, 1.0 / 6227020800.0, 1.0 / 479001600.0)
    high = fused(square, fused(square, fused(square, last, over), top), high)
    tail = fused(square, fused(square, high, middle), low)
    return (1.0 + fused(square, tail, r)) * two_to(shifted)


@inlined
def exponential(x):
    """The exponential of any number: 0 and infinity where it has no other value."""
    x = max(min(x, 710.0), -746.0)
    half = fused(0.5 * LOG2_E, x, ROUND)
    k = half - ROUND
    return exponential_near(fused(k, -2.0 * LN2_LOW, fused(k, -2.0 * LN2_HIGH, x))) * two_to(half) * two_to(half)


@inlined
def logarithm(x):
    """Natural logarithm of x > 0, finite and not subnormal (fdlibm's way)."""
    k = exponent_of(x)
    m = mantissa_of(x)
    large = m > 1.4142135623730951
    k = where(large, k + 1.0, k)
    f = where(large, 0.5 * m, m) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = w * fused(w, fused(w, 1.531383769920937332e-01, 2.222219843214978396e-01), 3.999999999940941908e-01)
    even = fused(w, 1.479819860511658591e-01, 1.818357216161805012e-01)
    even = z * fused(w, fused(w, even, 2.857142874366239149e-01), 6.666666666666735130e-01)
    half = 0.5 * f * f
    return k * LN2_HIGH - ((half - (s * (half + (odd + even)) + k * LN2_LOW)) - f)


@inlined
def power(x, y):
    """x^y for x > 0, finite and not subnormal."""
    return exponential(y * logarithm(x))
