"""Elementary functions (sine, cosine, exponential, tanh) of additions, multiplications and bit operations.

Polynomials of the FreeBSD maths library (fdlibm). Bounds, in units in the last place: exponential 1.25, cosine and sine
1 up to 45 degrees; tanh 2.3e-16 absolute. Held to in tests/model/compiler/test_elementary.py.
"""

from __future__ import annotations

import math

from model.compiler.expressions import ONE, Expression, Number, as_expression, constant, intern, maximum

EIGHTH_TURN = 0.7853981633974483
ROUND = 6755399441055744.0  # 1.5 * 2^52: added and taken away it leaves a whole number
LOG2_E, LN2_HIGH, LN2_LOW = 1.4426950408889634, 6.93147180369123816490e-01, 1.90821492927058770002e-10
SINE = (
    1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06, -1.98412698298579493134e-04,
    8.33333333332248946124e-03, -1.66666666666666324348e-01,
)  # fmt: skip
COSINE = (
    -1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07, 2.48015872894767294178e-05,
    -1.38888888888741095749e-03, 4.16666666666666019037e-02,
)  # fmt: skip
PADE = tuple(math.comb(6, j) * math.factorial(12 - j) / math.factorial(12) for j in range(7))


def _multiply_add(x: Number, y: Number, z: Number) -> Expression:
    return intern(
        "fused", as_expression(x), as_expression(y), as_expression(z)
    )  # opaque: a sum less one of its terms would be simplified away


def _evaluate_polynomial(z: Expression, coefficients: tuple[float, ...]) -> Expression:
    out: Expression = constant(coefficients[0])
    for c in coefficients[1:]:
        out = _multiply_add(out, z, c)
    return out


def sine(x: Expression) -> Expression:
    z = x * x
    return x + x * z * _evaluate_polynomial(z, SINE)


def cosine(x: Expression) -> Expression:
    z = x * x
    return ONE - (0.5 * z - z * z * _evaluate_polynomial(z, COSINE))


def _reduce_argument(x: Expression) -> tuple[Expression, Expression]:
    """Multiple k of log 2 nearest to x, shifted into the last bits of a sum, and the remainder x - k log 2."""
    shifted = _multiply_add(x, LOG2_E, ROUND)
    k = shifted - ROUND
    return shifted, _multiply_add(k, -LN2_LOW, _multiply_add(k, -LN2_HIGH, x))


def _exponential(x: Expression) -> Expression:
    """exp(x) as an expression: range reduction to a power of two, then Taylor's series to r^13."""
    shifted, r = _reduce_argument(x)
    square = r * r
    # Taylor's series: beyond r^13 it is below 2^-57
    low, middle = _multiply_add(r, 1.0 / 6.0, 0.5), _multiply_add(r, 1.0 / 120.0, 1.0 / 24.0)
    high, top = _multiply_add(r, 1.0 / 5040.0, 1.0 / 720.0), _multiply_add(r, 1.0 / 362880.0, 1.0 / 40320.0)
    over, last = (
        _multiply_add(r, 1.0 / 39916800.0, 1.0 / 3628800.0),
        _multiply_add(r, 1.0 / 6227020800.0, 1.0 / 479001600.0),
    )
    high = _multiply_add(square, _multiply_add(square, _multiply_add(square, last, over), top), high)
    tail = _multiply_add(square, _multiply_add(square, high, middle), low)
    return (1.0 + _multiply_add(square, tail, r)) * intern("two_to", shifted)


def _tanh(x: Expression) -> Expression:
    """tanh(x) as an expression, by Padé's quotient (6, 6) of the exponential: one division in all."""
    y = maximum(-40.0, -2.0 * abs(x))  # beyond, tanh is 1 to the last digit; what is no number stays none
    shifted, r = _reduce_argument(y)
    square = r * r
    fourth = square * square
    even = _multiply_add(fourth, _multiply_add(square, PADE[6], PADE[4]), _multiply_add(square, PADE[2], PADE[0]))
    odd = r * _multiply_add(fourth, PADE[5], _multiply_add(square, PADE[3], PADE[1]))
    up, down = intern("two_to", shifted) * (even + odd), even - odd
    return intern("with_sign", intern("quotient", down - up, down + up), x)


WRITTEN = {"exponential": _exponential, "tanh": _tanh}
"""Operations with the text that stands for them."""
