"""Felt under load: Hunt and Crossley (eqs. 2.4, 2.5), Stulov's memory, hysteresis that no speed changes.

f(x) = a x^3 + b x^2 + c x is the slow loading curve, x the depth (m). Felt cannot pull: each law says where it presses.
Equations, passivity and rules of those with memory, and of a curve that dips below zero: docs/explanation/felt.md.
"""

from __future__ import annotations

from model.compiler.expressions import (
    ONE,
    ZERO,
    Expression,
    Given,
    found_by_newton,
    largest,
    law,
    local,
    make,
    root,
    smaller,
    total,
    where,
)
from model.compiler.programs import Add, Put, Statement, While, let, name

DEPTH_STEPS = 60.0  # of a search for a depth, at most
Curve = tuple[Expression, Expression, Expression]


def loading(x: Expression, curve: Curve) -> Expression:
    """Force of the slow loading curve, N; below zero where it dips."""
    a, b, c = curve
    return ((a * x + b) * x + c) * x


def steepness(x: Expression, curve: Curve) -> Expression:
    """Slope of the slow loading curve, N/m."""
    a, b, c = curve
    return (3.0 * a * x + 2.0 * b) * x + c


def stored_slowly(x: Expression, curve: Curve) -> Expression:
    """Energy of the curve itself, J."""
    a, b, c = curve
    return x * x * (0.5 * c + x * (b * (1.0 / 3.0) + 0.25 * a * x))


def stored(x: Expression, curve: Curve) -> Expression:
    """Energy of the slow loading curve, J; a felt that does not press stores nothing."""
    a, b, c = curve
    spread = b * b - 4.0 * a * c
    dips = (b < 0.0) & (spread > 0.0) & (a > 0.0)
    width, twice = root(largest(spread, 0.0)), 1.0 / where(dips, 2.0 * a, 1.0)
    low, high = (-b - width) * twice, smaller(x, (-b + width) * twice)
    pocket = stored_slowly(low, curve) - stored_slowly(high, curve)
    return stored_slowly(x, curve) + where(dips & (x > low), pocket, 0.0)


@law
def hunt_crossley(given: Given, curve: Curve, damping: Expression) -> tuple[Expression, Expression]:
    """Whether it presses, and the force (N) at a depth x (m) and its rate (m/s)."""
    x, rate = given
    slow, factor = loading(x, curve), 1.0 + damping * rate
    # each factor by itself: two negative ones would push
    return (slow > 0.0) & (factor > 0.0), slow * factor


@law
def stulov(given: Given, curve: Curve, epsilon: Expression, tau: Expression) -> tuple[Expression, ...]:
    """Whether it presses, its force (N) and the rate (N/s) of the memory h (N), which follows f within ``tau`` (s)."""
    x, h = given
    f = loading(x, curve)
    return f > epsilon * h, (f - epsilon * h) * (1.0 / (1.0 - epsilon)), (f - h) / tau


@law
def stulov_alone(given: Given, epsilon: Expression, tau: Expression) -> Expression:
    """Rate (N/s) of the memory h of felt that is left alone: its own surface comes back."""
    return -((1.0 - epsilon) * given[0] / tau)


def share_left(shares: list[Expression]) -> Expression:
    """Share of the loading curve of felt with hysteresis before its memories add to it."""
    return ONE / (1.0 + total(shares))


@law
def hysteresis(given: Given, shares: list[Expression], curve: Curve) -> Expression:
    """Force (N) at a depth x and memories z."""
    x, *memories = given
    factor = 1.0 + total(share * z for share, z in zip(shares, memories, strict=True))
    return loading(x, curve) * (factor * share_left(shares))


@law
def hysteresis_rate(given: Given, reach: Expression) -> Expression:
    """Rate (1/s) of a memory z that follows the direction of the press within ``reach`` of the depth."""
    x, rate, z = given
    return (rate - abs(rate) * z) / (reach * x)


@law
def on_string(given: Given, give: Expression, curve: Curve, damping: Expression) -> tuple[Expression, ...]:
    """Whether felt presses on a string, the force (N), and its part that a slow press takes (N).

    Felt and the modes left out, which give way by ``give`` (m/N) times the slow force, are springs in a row.
    """
    x, rate = given
    f = make("argument", "slow force")
    slow = found_by_newton(f, f - largest(loading(largest(x - give * f, 0.0), curve), 0.0), 0.0)
    factor = 1.0 + damping * rate
    return (slow > 0.0) & (factor > 0.0), slow * factor, slow


def _depth_of(label: str, force: Expression, curve: Curve) -> tuple[list[Statement], Expression]:
    """Depth at which slow loading takes a force; the curve rises: Newton's iteration kept between bounds."""
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


def stulov_energy(
    which: str, label: str, x: Expression, h: Expression, curve: Curve, epsilon: Expression, tau: Expression
) -> list[Statement]:
    """Energy (J) that felt with the memory ``h`` (N) stores and power (W) that it loses, touched (x > 0) or not.

    ``which`` tells its names from those of other felts, ``label`` ends those that it adds to.
    """
    outer, behind = _depth_of(f"outer{which}{label}", epsilon * h, curve)
    within, inner = _depth_of(f"inner{which}{label}", h, curve)
    surface = largest(x, behind)
    f, hard = largest(loading(surface, curve), 0.0), 1.0 / (1.0 - epsilon)
    bound = h * surface - (h * inner - stored_slowly(inner, curve))
    lost = epsilon * (surface - inner) * (f - h) / tau
    return [
        *outer, *within, Add(name("energy" + label), (stored_slowly(surface, curve) - epsilon * bound) * hard),
        Add(name("felt" + label), lost * hard),
    ]  # fmt: skip
