"""The slow loading curve f(x) of felt pressed in by x (m), which every law has: a x^3 + b x^2 + c x, or a power.

In a scene it is the cubic; a press by itself (`model.felt`) may follow a power. `loading` and `steepness` of the cubic
take plain numbers, too. Where it dips: docs/explanation/felt.md.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from model.compiler.expressions import ONE, ZERO, Expression, largest, local, power, root, smaller, where
from model.compiler.programs import Put, Statement, While, let, name

DEPTH_STEPS = 60.0  # of a search for a depth, at most


class Power(NamedTuple):
    """A curve height x^exponent, N, of felt that is pressed; the height in N/m^exponent."""

    height: Expression
    exponent: Expression


Curve = tuple[Expression, Expression, Expression]
"""a, b and c of a cubic: N/m^3, N/m^2, N/m."""


def loading(x: Any, curve: Any) -> Any:
    """Force of the slow loading curve, N; below zero where it dips."""
    if isinstance(curve, Power):
        return curve.height * power(x, curve.exponent)
    a, b, c = curve
    return ((a * x + b) * x + c) * x


def steepness(x: Any, curve: Any) -> Any:
    """Slope of the slow loading curve, N/m."""
    if isinstance(curve, Power):
        return curve.exponent * curve.height * power(x, curve.exponent - 1.0)
    a, b, c = curve
    return (3.0 * a * x + 2.0 * b) * x + c


def stored_slowly(x: Expression, curve: Curve | Power) -> Expression:
    """Energy of the curve itself, J."""
    if isinstance(curve, Power):
        return curve.height * power(x, curve.exponent + 1.0) / (curve.exponent + 1.0)
    a, b, c = curve
    return x * x * (0.5 * c + x * (b * (1.0 / 3.0) + 0.25 * a * x))


def stored(x: Expression, curve: Curve | Power) -> Expression:
    """Energy of the slow loading curve, J; a felt that does not press stores nothing."""
    if isinstance(curve, Power):
        return stored_slowly(x, curve)
    a, b, c = curve
    spread = b * b - 4.0 * a * c
    dips = (b < 0.0) & (spread > 0.0) & (a > 0.0)
    width, twice = root(largest(spread, 0.0)), 1.0 / where(dips, 2.0 * a, 1.0)
    low, high = (-b - width) * twice, smaller(x, (-b + width) * twice)
    pocket = stored_slowly(low, curve) - stored_slowly(high, curve)
    return stored_slowly(x, curve) + where(dips & (x > low), pocket, 0.0)


def depth_of(label: str, force: Expression, curve: Curve | Power) -> tuple[list[Statement], Expression]:
    """Statements that find the depth at which slow loading takes a force, and that depth, m.

    The curve rises: Newton's iteration kept between bounds. ``label`` tells its names from those of other searches.
    """
    if isinstance(curve, Power):
        share = largest(force, 0.0) / where(curve.height > 0.0, curve.height, 1.0)
        return [], power(share, ONE / curve.exponent)
    low, high, x, left = (f"{label}{part}" for part in ("low", "high", "depth", "left"))

    def was(text: str) -> Expression:
        return local(text)

    f, steep = loading(was(x), curve), steepness(was(x), curve)
    too_low = f < force
    below, above = where(too_low, was(x), was(low)), where(too_low, was(high), was(x))
    there = was(x) - (f - force) / where(steep > 0.0, steep, 1.0)
    inside = (steep > 0.0) & (there > below) & (there < above)
    there = where(inside, there, 0.5 * (below + above))
    more = where(abs(there - was(x)) <= 1e-15 * abs(was(x)), 0.0, was(left) - 1.0)
    start = where(force > 0.0, 1e-6, 0.0)
    return [
        Put(name(low), ZERO), Put(name(high), start), Put(name(left), where(force > 0.0, DEPTH_STEPS, 0.0)),
        While((was(high) < 1.0) & (loading(was(high), curve) < force), [
            Put(name(low), was(high)), Put(name(high), 2.0 * was(high)),
        ]),
        Put(name(x), was(high)),
        While(was(left) > 0.0, [let(more, there, below, above), Put(name(left), more), Put(name(low), below),
                                Put(name(high), above), Put(name(x), there)]),
    ], local(x)  # fmt: skip
