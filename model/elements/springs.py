"""Springs, dampers and bushings on one coordinate each: of jack and repetition, of the shank, of joints that give."""

from __future__ import annotations

from model.compiler.expressions import Expression
from model.compiler.programs import Add, Statement, name
from model.elements.kinematics import State
from model.elements.structure import Structure
from model.kernels import layout as L


class Springs:
    """Torque T0 - k (q - q0) on a joint (eq. A.3)."""

    def __init__(self, s: Structure, state: State) -> None:
        self._rows = []
        for k, i in enumerate(s.spring):
            t0, stiffness, q0 = (s.number(0, L.SPRING_SIZE, k, n) for n in (L.SPRING_T0, L.SPRING_K, L.SPRING_Q0))
            self._rows.append((i, t0, stiffness, state.q[i] - q0))

    def forces(self) -> list[Statement]:
        """Torques, N m."""
        return [Add(name(f"f{i}"), t0 - stiffness * turned) for i, t0, stiffness, turned in self._rows]

    def energy(self) -> list[Statement]:
        """What they store, J."""
        return [
            Add(name("energy"), (0.5 * stiffness * turned - t0) * turned) for _, t0, stiffness, turned in self._rows
        ]


class Dampers:
    """Torque - d v on a joint: of the shank, or a loss of the drive."""

    def __init__(self, s: Structure, state: State) -> None:
        driven = {i for _, i in s.drive}
        self.rows: list[tuple[int, Expression, Expression, str]] = []
        for k, i in enumerate(s.damper):
            number = s.number(5, L.DAMPER_SIZE, k, 0)
            self.rows.append((i, number, state.v[i], "drive" if i in driven else "shank"))

    def forces(self) -> list[Statement]:
        """Torques, N m."""
        return [Add(name(f"f{i}"), -(d * v)) for i, d, v, _ in self.rows]

    def energy(self) -> list[Statement]:
        """What they lose, W."""
        return [Add(name(loss), d * v * v) for _, d, v, loss in self.rows]


class Bushings:
    """Force load - k d - c dd/dt along each direction in which a joint gives."""

    def __init__(self, s: Structure, state: State) -> None:
        self.rows = []
        for k, g in enumerate(s.pin):
            stiffness, damping, load = (s.number(8, L.PIN_SIZE, k, n) for n in (L.PIN_K, L.PIN_C, L.PIN_LOAD))
            self.rows.append((g, stiffness, damping, load, state.q[g], state.v[g]))

    def forces(self) -> list[Statement]:
        """Forces on the body, N."""
        return [Add(name(f"f{g}"), load - k * d - c * v) for g, k, c, load, d, v in self.rows]

    def energy(self) -> list[Statement]:
        """What they store, J, and lose, W."""
        out: list[Statement] = []
        for _, k, c, load, d, v in self.rows:
            out += [Add(name("energy"), (0.5 * k * d - load) * d), Add(name("pins"), c * v * v)]
        return out
