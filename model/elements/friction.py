"""Friction of surfaces and joints: tanh that runs up to Coulomb's value, with a hump (eqs. 2.10, 2.12)."""

from collections.abc import Callable

from model.compiler.expressions import ZERO, Arguments, Expression, compute_where, differentiate_once, intern, tanh


def friction(everywhere: bool) -> Callable[..., Expression]:
    """Return a function f((speed,), 1 / threshold speed, A, B1, B2) for the friction coefficient (or torque), with the
    sign of the speed; ``everywhere``: without branches, differentiable at B1 = 0 too."""

    @differentiate_once
    def coefficient(given: Arguments, per: Expression, a: Expression, b1: Expression, b2: Expression) -> Expression:
        z = given[0] * per
        square = z * z
        hump = b1 * z / (1.0 + b2 * (square * square))
        return a * (tanh(z) + (hump if everywhere else compute_where(intern("differs", b1, ZERO), hump)))

    return coefficient
