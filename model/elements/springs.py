"""Springs, dampers and bushings on one coordinate each: of jack and repetition, of the shank, of joints that give."""

from __future__ import annotations

from dataclasses import dataclass

from model.compiler.expressions import ZERO, Expression
from model.compiler.programs import Accumulate, Statement, variable
from model.elements.kinematics import State
from model.elements.structure import Structure
from model.kernels import layout as L


@dataclass(frozen=True)
class Spring:
    """Force (torque) load - k d - c v along coordinate ``i`` (eq. A.3); ``loss`` names what it loses."""

    i: int
    load: Expression
    stiffness: Expression
    damping: Expression
    way: Expression
    rate: Expression
    loss: str = ""

    def forces(self) -> list[Statement]:
        """Its force, N, or torque, N m."""
        return [Accumulate(variable(f"f{self.i}"), self.load - self.stiffness * self.way - self.damping * self.rate)]

    def energy(self) -> list[Statement]:
        """What it stores, J, and loses, W."""
        kept, lost = (0.5 * self.stiffness * self.way - self.load) * self.way, self.dissipated_power
        return [Accumulate(variable(text), e) for text, e in (("energy", kept), (self.loss, lost)) if e is not ZERO]

    @property
    def dissipated_power(self) -> Expression:
        return self.damping * self.rate * self.rate


def springs(s: Structure, state: State) -> list[Spring]:
    """Springs of the joints that are solved for, each with torque T0 - k (q - q0), N m, and no damping."""
    out = []
    for k, i in enumerate(s.spring):
        if i not in s.solved:
            continue
        t0, stiffness, q0 = (s.number(0, L.SPRING_SIZE, k, n) for n in (L.SPRING_T0, L.SPRING_K, L.SPRING_Q0))
        out.append(Spring(i, t0, stiffness, ZERO, state.q[i] - q0, state.v[i]))
    return out


def dampers(s: Structure, state: State) -> list[Spring]:
    """Dampers of joints, shank and drives, then bushings along each compliant direction of a joint."""
    driven = {i for _, i in s.drive}
    out = []
    for k, i in enumerate(s.damper):
        if i not in s.solved:
            continue
        number, loss = s.number(5, L.DAMPER_SIZE, k, 0), "drive" if i in driven else "shank"
        out.append(Spring(i, ZERO, ZERO, number, state.q[i], state.v[i], loss))
    for k, g in enumerate(s.pin):
        stiffness, damping, load = (s.number(8, L.PIN_SIZE, k, n) for n in (L.PIN_K, L.PIN_C, L.PIN_LOAD))
        out.append(Spring(g, load, stiffness, damping, state.q[g], state.v[g], "pins"))
    return out
