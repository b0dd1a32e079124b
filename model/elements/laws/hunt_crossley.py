"""The thesis's felt (eqs. 2.4, 2.5), after Hunt and Crossley: f(x) (1 + D dx/dt)."""

from __future__ import annotations

from model.compiler.expressions import Expression, maximum, where
from model.compiler.programs import Statement
from model.elements.laws.curve import curve_energy, loading_force
from model.elements.laws.felt_law import Felt, Law


class HuntCrossley(Law):
    """Felt whose force grows with the speed of the press; its one parameter beside the curve is ``normal.D``."""

    name = "hunt-crossley"
    damped = True

    def force(self, felt: Felt) -> tuple[Expression, Expression]:
        """Whether it presses, and its force, N."""
        slow, factor = loading_force(felt.depth, felt.curve), 1.0 + felt.damping * felt.rate
        # each factor by itself: two negative ones would push
        return (slow > 0.0) & (factor > 0.0), slow * factor

    def energy(self, felt: Felt, label: str) -> tuple[list[Statement], Expression, Expression]:
        """Energy of the curve; what the force has beyond it is lost."""
        pressing, force = self.force(felt)
        lost = (where(pressing, force, 0.0) - maximum(loading_force(felt.depth, felt.curve), 0.0)) * felt.rate
        return [], curve_energy(felt.depth, felt.curve), lost

    def stiffness(self, felt: Felt) -> Expression:
        """Of the curve, at the speed of the touch."""
        return felt.curve[2] * (1.0 + felt.damping * abs(felt.rate))
