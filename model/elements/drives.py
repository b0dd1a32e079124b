"""What drives a scene: a force on the key, a torque on a joint, an amplifier with a winding."""

from __future__ import annotations

from model.compiler.expressions import ZERO, Arguments, Expression, differentiate_once, root, where
from model.compiler.programs import Accumulate, Statement, variable
from model.elements.kinematics import Kinematics
from model.elements.structure import Structure
from model.kernels import layout as L


def soft_limit(x: Expression, limit: Expression, share: Expression) -> Expression:
    """``x`` held between -limit and limit: itself up to (1 - share) limit, with four continuous derivatives there."""
    width = share * limit
    s = (abs(x) - limit) / width + 1.0
    held = limit - width + width * s / root(root(1.0 + s * s * s * s))
    return where(abs(x) > limit - width, where(x > 0.0, held, -held), x)


@differentiate_once
def amplifier(
    given: Arguments, loop: Expression, supply: Expression, limit: Expression, hold: Expression, share: Expression
) -> Expression:
    """Voltage (V) at ``given``, source voltage and current: less ``loop`` times current, held by ``limit`` (A) and
    ``supply`` (V), softly over ``share`` of these."""
    u, current = given
    return soft_limit(u - loop * current - hold * (current - soft_limit(current, limit, share)), supply, share)


class Drives:
    def __init__(self, s: Structure, k: Kinematics) -> None:
        self._s, self._k = s, k
        self._rows = [
            (kind, i, [s.number(2, L.DRIVE_SIZE, at, n) for n in range(L.WINDING_SIZE)])
            for at, (kind, i) in enumerate(s.drive)
            if i in s.solved
        ]

    def _push(self, kind: int, i: int, numbers: list[Expression]) -> dict[int, Expression]:
        """Generalised forces by coordinate of a drive of ``kind`` at coordinate ``i``: force down on the key, at its
        point in ``numbers``; amplifier, on winding and motor; or torque on a joint."""
        u, v = self._k.state.u, self._k.state.v
        if kind == L.FORCE_DOWN:
            x, y = self._k.to_world_point(i, numbers[L.DRIVE_X], numbers[L.DRIVE_Y])
            return {k: -(u * way[1]) for k, way in self._k.ways(i, x, y).items()}
        if kind == L.AMPLIFIER:  # on the charge of a winding, whose rate is the current; the motor is the body before
            resistance, turn = numbers[L.WINDING_R], numbers[L.WINDING_K]
            return {i: self._volts(i, numbers) - resistance * v[i] - turn * v[i - 1], i - 1: turn * v[i]}
        return {i: u}

    def _volts(self, i: int, numbers: list[Expression]) -> Expression:
        volts: Expression = amplifier(
            (self._k.state.u, self._k.state.v[i]), *numbers[L.WINDING_AMPLIFIER : L.WINDING_SIZE]
        )
        return volts

    @property
    def pushes(self) -> list[dict[int, Expression]]:
        """Generalised forces of each drive."""
        return [self._push(*row) for row in self._rows]

    def own_rates(self) -> list[Expression]:
        """For each drive, the acceleration, downwards, of the point at which a force pushes while no coordinate
        accelerates, m/s^2; ZERO for other kinds."""
        out = []
        for kind, i, numbers in self._rows:
            turning = self._k.pose[i].turning
            up = self._k.to_world_vector(i, numbers[L.DRIVE_X], numbers[L.DRIVE_Y])[1]
            out.append(turning * turning * up if kind == L.FORCE_DOWN else ZERO)
        return out

    def forces(self) -> list[Statement]:
        """Forces N, torques N m, voltages V."""
        return [
            Accumulate(variable(f"f{i}"), e) for push in self.pushes for i, e in push.items() if i in self._s.solved
        ]

    def energy(self) -> list[Statement]:
        """Statements that add the power put in (W) to the variable ``given`` and the loss in a winding's resistance (W)
        to ``drive``."""
        out: list[Statement] = []
        for kind, i, numbers in self._rows:
            v = self._k.state.v
            if kind == L.AMPLIFIER:
                out += [Accumulate(variable("given"), self._volts(i, numbers) * v[i])]
                out += [Accumulate(variable("drive"), numbers[L.WINDING_R] * v[i] * v[i])]
                continue
            out += [Accumulate(variable("given"), e * v[k]) for k, e in self._push(kind, i, numbers).items()]
        return out
