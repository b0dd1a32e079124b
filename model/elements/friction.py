"""Friction of surfaces and joints: tanh that runs up to Coulomb's value, with a hump (eqs. 2.10, 2.12)."""

from model.compiler.expressions import ZERO, Expression, Given, guarded, law, make, tanh


@law
def friction(given: Given, per: Expression, a: Expression, b1: Expression, b2: Expression) -> Expression:
    """Friction coefficient (or torque) at a speed; ``per`` is one over the threshold of sliding."""
    (speed,) = given
    z = speed * per
    square = z * z
    hump = guarded(make("differs", b1, ZERO), b1 * z / (1.0 + b2 * (square * square)))
    return a * (tanh(z) + hump)
