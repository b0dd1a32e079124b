"""Friction of surfaces and joints: tanh that runs up to Coulomb's value, with a hump (eqs. 2.10, 2.12)."""

from model.compiler.expressions import ZERO, Expression, Given, guarded, law, make, tanh


def _friction(given: Given, per: Expression, laws: tuple[Expression, ...], everywhere: bool) -> Expression:
    (speed,), (a, b1, b2) = given, laws
    z = speed * per
    square = z * z
    hump = b1 * z / (1.0 + b2 * (square * square))
    return a * (tanh(z) + (hump if everywhere else guarded(make("differs", b1, ZERO), hump)))


@law
def friction(given: Given, per: Expression, *laws: Expression) -> Expression:
    """Friction coefficient (or torque) by A, B1, B2 at a speed; ``per`` is one over the threshold of sliding."""
    return _friction(given, per, laws, everywhere=False)


@law
def friction_everywhere(given: Given, per: Expression, *laws: Expression) -> Expression:
    """The same, also differentiable by a B1 that is 0."""
    return _friction(given, per, laws, everywhere=True)
