"""Stulov's felt: F = (f - epsilon h) / (1 - epsilon), a memory h that follows f: tau dh/dt = f - h.

Where the surfaces part, the felt's own surface lags at f = epsilon h and comes back by itself. Equations, passivity and
sources: docs/explanation/felt.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from model.compiler.expressions import Expression, maximum
from model.compiler.programs import Statement
from model.elements.laws.curve import Curve, loading_force, polynomial_energy, solve_depth
from model.elements.laws.felt_law import Felt, Law, Number


def relaxation_force(x: Expression, h: Expression, curve: Curve, epsilon: Expression) -> tuple[Expression, Expression]:
    """Whether it presses, and its force, N."""
    f = loading_force(x, curve)
    return f > epsilon * h, (f - epsilon * h) * (1.0 / (1.0 - epsilon))


def surface_energy(
    label: str, x: Expression, h: Expression, curve: Curve, epsilon: Expression, tau: Expression
) -> tuple[list[Statement], Expression, Expression]:
    """Statements, stored energy (J) and dissipated power (W) of felt at depth ``x`` with the internal variable ``h``
    (N); ``label`` ends the statements' names."""
    outer, behind = solve_depth(f"outer{label}", epsilon * h, curve)
    within, inner = solve_depth(f"inner{label}", h, curve)
    surface = maximum(x, behind)
    f, hard = maximum(loading_force(surface, curve), 0.0), 1.0 / (1.0 - epsilon)
    bound = h * surface - (h * inner - polynomial_energy(inner, curve))
    lost = epsilon * (surface - inner) * (f - h) / tau
    return [*outer, *within], (polynomial_energy(surface, curve) - epsilon * bound) * hard, lost * hard


class Stulov(Law):
    """Felt with a memory that fades with time."""

    name = "stulov"
    numbers = {
        "epsilon": Number(0.9, "1", 0.08, 0.0, 0.9999, "share of the force that fades; 0.99 with microseconds for "
                          "hammer felt (Stulov, as remembered), less for softer felt"),
        "tau": Number(5.0e-5, "s", 3.0e-5, 1e-9, 10.0, "time in which it fades; tau eps / (1 - eps) = 0.45 ms acts as "
                      "the damping of slow presses"),
    }  # fmt: skip

    def pack_numbers(
        self, contact: str, values: Mapping[str, float], curve: tuple[float, float, float]
    ) -> tuple[int, Sequence[float]]:
        self.refuse_softening(contact, curve)
        return 1, (values["epsilon"], values["tau"])

    def force(self, felt: Felt) -> tuple[Expression, Expression]:
        return relaxation_force(felt.depth, felt.memory[0], felt.curve, felt.numbers[0])

    def rates(self, felt: Felt) -> Sequence[Expression]:
        """The memory (N) follows the curve."""
        return [(loading_force(felt.depth, felt.curve) - felt.memory[0]) / felt.numbers[1]]

    def recovery_rates(self, felt: Felt) -> Sequence[Expression]:
        epsilon, tau = felt.numbers
        return [-((1.0 - epsilon) * felt.memory[0] / tau)]

    def energy(self, felt: Felt, label: str) -> tuple[list[Statement], Expression, Expression]:
        return surface_energy(label, felt.depth, felt.memory[0], felt.curve, *felt.numbers)

    def stiffness(self, felt: Felt) -> Expression:
        """Of a press too fast for the memory."""
        return felt.curve[2] / (1.0 - felt.numbers[0])

    def rest_memories(
        self, depth: float, curve: tuple[float, float, float], numbers: Sequence[float], memories: int
    ) -> Sequence[float]:
        return [loading_force(depth, curve)]
