"""One-sided vertical contact of a point on A with a point of B below: the motor's tip or a finger on the key."""

from __future__ import annotations

from functools import cached_property

from model.compiler.expressions import Expression
from model.compiler.programs import Accumulate, If, Statement, variable
from model.elements.kinematics import Kinematics, Vector, relative_velocities
from model.elements.laws.felt_law import Felt, evaluate_law
from model.elements.laws.hunt_crossley import HuntCrossley
from model.elements.structure import Structure
from model.kernels import layout as L

LAW = HuntCrossley()


class Tip:
    """Tip ``which`` of a scene at a state."""

    def __init__(self, s: Structure, k: Kinematics, which: int) -> None:
        self._s = s
        a, b = s.probe[which]
        n = [s.number(3, L.PROBE_SIZE, which, i) for i in range(L.PROBE_SIZE)]
        above, below = k.to_world_point(a, n[0], n[1]), k.to_world_point(b, n[2], n[3])
        self.ways: dict[int, Vector] = relative_velocities(k.ways(a, *above), k.ways(b, *below))
        self.depth = below[1] - above[1]
        self._felt = Felt(self.depth, -k.velocity(self.ways)[1], (), (n[4], n[5], n[6]), n[7], ())

    @cached_property
    def felt(self) -> tuple[Expression, Expression]:
        """Whether it presses where it touches, and its force, N."""
        pressing, force = evaluate_law(LAW.force, self._felt)
        return pressing, force

    def forces(self) -> list[Statement]:
        """Generalised forces: up on A, down on B."""
        pressing, force = self.felt
        pushes: list[Statement] = [
            Accumulate(variable(f"f{k}"), force * way[1]) for k, way in self.ways.items() if k in self._s.solved
        ]
        return [If((self.depth > 0.0) & pressing, pushes)]

    def energy(self, label: str = "") -> list[Statement]:
        """Statements that, in touch, add stored energy (J) to ``energy`` and lost power (W) to ``felt``, variables
        whose names end with ``label``."""
        _, stored, lost = LAW.energy(self._felt, label)
        return [
            If(
                self.depth > 0.0,
                [Accumulate(variable("energy" + label), stored), Accumulate(variable("felt" + label), lost)],
            )
        ]
