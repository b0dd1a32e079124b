"""Exponential, logarithm, power, hyperbolic tangent, cosine and sine of lanes, with bounds on their errors.

Made of correctly rounded operations only: the same bits on every machine. Bounds, in units in the last place (ulp) of
the result unless said, held to in tests/model/kernels/lanes/test_maths.py against 64-bit mantissas: exponential 1.25,
logarithm 1, cosine and sine 1.25 up to 2^20 rad (beyond: NaN), tanh 2.3e-16 absolute, power a relative
(2 + |y log x|) 1.2e-16. NaN gives NaN.
"""

from model.kernels.compile import inlined
from model.kernels.lanes.operations import any_of, exponent_of, fused, mantissa_of, two_to, where, with_sign

ROUND = 6755399441055744.0  # 1.5 * 2^52: added and taken away it leaves a whole number
LOG2_E, LN2_HIGH, LN2_LOW = 1.4426950408889634, 6.93147180369123816490e-01, 1.90821492927058770002e-10
# pi/2 in three parts; the first has no digit below 2^-52, so that x - k times it is exact for whole k
TWO_OVER_PI = 0.6366197723675814
HALF_PI = 1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33
QUARTER_TURN = 0.7853981633974483
LARGEST_ANGLE = 1048576.0
NAN = float("nan")


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


@inlined
def tanh(x):
    """Hyperbolic tangent to an absolute error of 2.3e-16."""
    e = exponential_near(max(-2.0 * abs(x), -40.0))
    return with_sign((1.0 - e) / (1.0 + e), x)


@inlined
def cosine_sine(x):
    """Cosine and sine; polynomials of fdlibm up to 45 degrees, quarter turns taken away first beyond."""
    r = x
    low = 0.0 * x
    k = low
    beyond = abs(x) > QUARTER_TURN
    far = any_of(beyond)
    if far:
        k = where(beyond, fused(x, TWO_OVER_PI, ROUND) - ROUND, 0.0)
        near = fused(k, -HALF_PI[0], x)
        second = fused(k, HALF_PI[1], 0.0)
        r = near - second
        moved = r - near
        low = (near - (r - moved)) - (second + moved)  # what rounding took from r
        low = fused(k, -HALF_PI[2], low - fused(k, HALF_PI[1], -second))
        r = where(beyond, r, x)
    z = r * r
    s = fused(z, 1.58969099521155010221e-10, -2.50507602534068634195e-08)
    s = fused(z, s, 2.75573137070700676789e-06)
    s = fused(z, s, -1.98412698298579493134e-04)
    s = fused(z, s, 8.33333333332248946124e-03)
    s = fused(z, s, -1.66666666666666324348e-01)
    c = fused(z, -1.13596475577881948265e-11, 2.08757232129817482790e-09)
    c = fused(z, c, -2.75573143513906633035e-07)
    c = fused(z, c, 2.48015872894767294178e-05)
    c = fused(z, c, -1.38888888888741095749e-03)
    c = fused(z, c, 4.16666666666666019037e-02)
    half = 0.5 * z
    whole = 1.0 - half
    rest = (1.0 - whole) - half  # what rounding took from 1 - z/2
    cosine = whole + fused(z * z, c, rest)
    sine = fused(z * r, s, r)
    if far:
        turned = where(beyond, sine + low * cosine, sine)
        cosine = where(beyond, cosine - low * sine, cosine)
        sine = turned
        quarter = k - 4.0 * ((fused(k, 0.25, ROUND)) - ROUND)  # -2 to 2
        swapped = abs(quarter) == 1.0
        opposite = abs(quarter) == 2.0
        was = cosine
        cosine = where(swapped, where(quarter > 0.0, -sine, sine), where(opposite, -was, was))
        sine = where(swapped, where(quarter > 0.0, was, -was), where(opposite, -sine, sine))
        sane = abs(x) <= LARGEST_ANGLE
        cosine = where(sane, cosine, NAN)
        sine = where(sane, sine, NAN)
    return cosine, sine
