"""Slow loading curve f(x) of felt at penetration x (m): a x^3 + b x^2 + c x, or a power law."""

from __future__ import annotations

from typing import Any, NamedTuple

from model.compiler.expressions import ONE, ZERO, Expression, maximum, minimum, power, root, value_of, where
from model.compiler.programs import Assign, Statement, While, compute, variable

DEPTH_STEPS = 60.0  # of a search for a depth, at most


class Power(NamedTuple):
    """A curve height x^exponent, N, of felt that is pressed; the height in N/m^exponent."""

    height: Expression
    exponent: Expression


Curve = tuple[Expression, Expression, Expression]
"""a, b and c of a cubic: N/m^3, N/m^2, N/m."""


def loading_force(x: Any, curve: Any) -> Any:
    """Force of the slow loading curve at the depth x >= 0, N; negative where the curve dips."""
    if isinstance(curve, Power):
        return curve.height * power(x, curve.exponent)
    a, b, c = curve
    return ((a * x + b) * x + c) * x


def loading_stiffness(x: Any, curve: Any) -> Any:
    """Slope of the slow loading curve, N/m."""
    if isinstance(curve, Power):
        return curve.exponent * curve.height * power(x, curve.exponent - 1.0)
    a, b, c = curve
    return (3.0 * a * x + 2.0 * b) * x + c


def polynomial_energy(x: Expression, curve: Curve | Power) -> Expression:
    """Integral of the curve's force from 0 to the depth x >= 0, J, with the parts where it is negative."""
    if isinstance(curve, Power):
        return curve.height * power(x, curve.exponent + 1.0) / (curve.exponent + 1.0)
    a, b, c = curve
    return x * x * (0.5 * c + x * (b * (1.0 / 3.0) + 0.25 * a * x))


def curve_energy(x: Expression, curve: Curve | Power) -> Expression:
    """Energy stored by slow loading to a depth x >= 0, J; the caller must pass no negative x.

    It is the integral of the force, without the stretch in which a cubic dips below zero.
    """
    if isinstance(curve, Power):
        return polynomial_energy(x, curve)
    a, b, c = curve
    spread = b * b - 4.0 * a * c
    dips = (b < 0.0) & (spread > 0.0) & (a > 0.0)
    width, twice = root(maximum(spread, 0.0)), 1.0 / where(dips, 2.0 * a, 1.0)
    low, high = (-b - width) * twice, minimum(x, (-b + width) * twice)
    pocket = polynomial_energy(low, curve) - polynomial_energy(high, curve)
    return polynomial_energy(x, curve) + where(dips & (x > low), pocket, 0.0)


def solve_depth(label: str, force: Expression, curve: Curve | Power) -> tuple[list[Statement], Expression]:
    """Statements that find the depth at which slow loading takes a force, and that depth, m.

    The curve rises: Newton's iteration kept between bounds. ``label`` tells its names from those of other searches.
    """
    if isinstance(curve, Power):
        share = maximum(force, 0.0) / where(curve.height > 0.0, curve.height, 1.0)
        return [], power(share, ONE / curve.exponent)
    low, high, x, left = (f"{label}{part}" for part in ("low", "high", "depth", "left"))

    def was(text: str) -> Expression:
        return value_of(text)

    f, steep = loading_force(was(x), curve), loading_stiffness(was(x), curve)
    too_low = f < force
    below, above = where(too_low, was(x), was(low)), where(too_low, was(high), was(x))
    there = was(x) - (f - force) / where(steep > 0.0, steep, 1.0)
    inside = (steep > 0.0) & (there > below) & (there < above)
    there = where(inside, there, 0.5 * (below + above))
    more = where(abs(there - was(x)) <= 1e-15 * abs(was(x)), 0.0, was(left) - 1.0)
    start = where(force > 0.0, 1e-6, 0.0)
    return [
        Assign(variable(low), ZERO), Assign(variable(high), start),
        Assign(variable(left), where(force > 0.0, DEPTH_STEPS, 0.0)),
        While((was(high) < 1.0) & (loading_force(was(high), curve) < force), [
            Assign(variable(low), was(high)), Assign(variable(high), 2.0 * was(high)),
        ]),
        Assign(variable(x), was(high)),
        While(was(left) > 0.0, [compute(more, there, below, above),
                                Assign(variable(left), more), Assign(variable(low), below),
                                Assign(variable(high), above), Assign(variable(x), there)]),
    ], value_of(x)  # fmt: skip
