"""Friction of surfaces and joints: tanh that runs up to Coulomb's value, with a hump (eqs. 2.10, 2.12)."""

from collections.abc import Callable

from model.compiler.expressions import ZERO, Expression, Given, guarded, law, make, tanh


def friction(everywhere: bool) -> Callable[..., Expression]:
    """Friction coefficient (or torque) by A, B1, B2 at a speed, with one over the threshold of sliding.

    ``everywhere``: it is also to be differentiable by a B1 that is 0.
    """

    @law
    def at_speed(given: Given, per: Expression, a: Expression, b1: Expression, b2: Expression) -> Expression:
        z = given[0] * per
        square = z * z
        hump = b1 * z / (1.0 + b2 * (square * square))
        return a * (tanh(z) + (hump if everywhere else guarded(make("differs", b1, ZERO), hump)))

    return at_speed
