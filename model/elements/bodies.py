"""Bodies: mass matrix, weight and the inertia of turning, friction of joints, kinetic and potential energy."""

from __future__ import annotations

from model.compiler.expressions import ZERO, Expression, total
from model.compiler.programs import Add, Statement, name
from model.elements.kinematics import Kinematics, Vector, dot
from model.elements.structure import Structure
from model.kernels import layout as L

Masses = dict[tuple[int, int], Expression]
"""Entries of the lower triangle of the mass matrix that are not zero."""


class Bodies:
    """All bodies of a scene at a state."""

    def __init__(self, s: Structure, k: Kinematics, gravity: Expression) -> None:
        self._s, self._k, self._gravity = s, k, gravity
        self.mass: Masses = {}
        self._force: dict[int, Expression] = {}
        self._bias: dict[int, Vector] = {}
        for i in s.order():
            if i in s.guided:
                self._bias[i] = (ZERO, ZERO)
                self._add(self.mass, (i, i), s.body(i, L.MASS))
                self._add(self._force, i, -(s.body(i, L.MASS) * gravity))
            else:
                self._place(i)

    @staticmethod
    def _add(to: dict, key: object, e: Expression) -> None:  # type: ignore[type-arg]
        to[key] = to.get(key, ZERO) + e

    def _place(self, i: int) -> None:
        s, k = self._s, self._k
        mass, inertia = s.body(i, L.MASS), s.body(i, L.INERTIA)
        arm = k.along(i, s.body(i, L.COM_X), s.body(i, L.COM_Y))
        w = s.parent[i]
        bias = (ZERO, ZERO)  # acceleration of the pivot while no speed changes
        if w >= 0 and w not in s.guided:
            turned, about = k.along(w, s.body(i, L.PIVOT_X), s.body(i, L.PIVOT_Y)), k.turning(w)
            bias = tuple(b - about * about * d for b, d in zip(self._bias[w], turned, strict=True))  # type: ignore[assignment]
        self._bias[i] = bias
        ways = k.ways(i, *self.centre(i))
        square = k.turning(i) * k.turning(i)
        pull = (mass * (bias[0] - square * arm[0]), mass * (bias[1] - square * arm[1] + self._gravity))
        turns = k.turns(i)
        for a in ways:
            self._add(self._force, a, -dot(ways[a], pull))
            for b in ways:
                if b <= a:
                    turned_too = inertia if a in turns and b in turns else ZERO
                    self._add(self.mass, (a, b), mass * dot(ways[a], ways[b]) + turned_too)

    def centre(self, i: int) -> Vector:
        """World position of a body's centre of mass, m."""
        return self._k.at(i, self._s.body(i, L.COM_X), self._s.body(i, L.COM_Y))

    def velocity(self, i: int) -> Vector:
        """Velocity of the centre of mass, m/s."""
        return self._k.velocity(self._k.ways(i, *self.centre(i)))

    def acceleration(self, i: int, rates: list[Expression]) -> Vector:
        """Acceleration of the centre of mass, m/s^2, from those of all coordinates."""
        ways = self._k.ways(i, *self.centre(i))
        arm, square = self._k.along(i, self._s.body(i, L.COM_X), self._s.body(i, L.COM_Y)), self._k.turning(i)
        bias = self._bias[i]
        moved = [total(way[k] * rates[j] for j, way in ways.items()) for k in (0, 1)]
        return bias[0] - square * square * arm[0] + moved[0], bias[1] - square * square * arm[1] + moved[1]

    def joint_friction(self) -> dict[int, Expression]:
        """Torque that each joint's friction takes, N m; of a guide its force, N."""
        s, k = self._s, self._k
        return {
            i: k.friction(
                (k.state.v[i],), k.per_slide if i in s.guided else k.per_turn, s.body(i, L.JF_A), s.body(i, L.JF_B1),
                s.body(i, L.JF_B2),
            )
            for i in range(s.own)
        }  # fmt: skip

    def forces(self) -> list[Statement]:
        """Weight, inertia of turning, friction of joints."""
        rubs = self.joint_friction()
        return [Add(name(f"f{i}"), e - rubs.get(i, ZERO)) for i, e in self._force.items() if i < self._s.free]

    def inertia(self, acceleration: list[Expression]) -> list[Expression]:
        """M a, row by row of the free coordinates."""
        out = [ZERO] * self._s.free
        for (i, j), m in self.mass.items():
            for row, column in {(i, j), (j, i)}:
                if row < self._s.free and column < self._s.free:
                    out[row] = out[row] + m * acceleration[column]
        return out

    def energy(self) -> list[Statement]:
        """Kinetic energy and that of heights; what friction of joints takes."""
        s, k = self._s, self._k
        v = k.state.v
        moving = total((0.5 if i == j else 1.0) * m * v[i] * v[j] for (i, j), m in self.mass.items())
        heights = total(
            s.body(i, L.MASS) * self._gravity * (k.pivot(i)[1] + k.along(i, s.body(i, L.COM_X), s.body(i, L.COM_Y))[1])
            for i in s.bodies
            if i not in s.guided
        )
        rubs = self.joint_friction()
        turning = total(e * v[i] for i, e in rubs.items() if i not in s.guided)
        lifting = total(e * v[i] for i, e in rubs.items() if i in s.guided)
        out: list[Statement] = [Add(name("energy"), moving + heights), Add(name("joints"), turning)]
        return out + ([Add(name("rail"), lifting)] if s.guided else [])


def solved(mass: Masses, forces: list[Expression]) -> list[Expression]:
    """Accelerations a with M a = f: coordinates with the fewest links are eliminated first."""
    n = len(forces)
    m = {pair: e for (i, j), e in mass.items() for pair in ((i, j), (j, i)) if max(pair) < n}
    f, left, done = list(forces), list(range(n)), []
    while left:
        k = min(left, key=lambda i: sum((i, j) in m for j in left))
        left.remove(k)
        inverse = 1.0 / m[k, k]
        shares = {j: m[k, j] * inverse for j in left if (k, j) in m}
        done.append((k, inverse, shares))
        for j, share in shares.items():
            f[j] = f[j] - share * f[k]
            for i in shares:
                m[j, i] = m.get((j, i), ZERO) - share * m[k, i]
    a = [ZERO] * n
    for k, inverse, shares in reversed(done):
        a[k] = f[k] * inverse - total(share * a[j] for j, share in shares.items())
    return a
