"""Bodies: mass matrix, weight and the inertia of turning, friction of joints, kinetic and potential energy."""

from __future__ import annotations

from model.compiler.expressions import ZERO, Expression, total
from model.compiler.programs import Accumulate, Statement, variable
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
        self._drift: dict[int, Vector] = {}
        for i in s.order():
            if i in s.guided:
                self._bias[i] = (ZERO, ZERO)
                self._add(self.mass, (i, i), s.body(i, L.MASS))
                self._add(self._force, i, -(s.body(i, L.MASS) * gravity))
            else:
                self._add_body(i)

    @staticmethod
    def _add(to: dict, key: object, e: Expression) -> None:  # type: ignore[type-arg]
        to[key] = to.get(key, ZERO) + e

    def _add_body(self, i: int) -> None:
        """Add the i-th body's inertia to the mass matrix, and its weight and velocity-dependent inertia forces to the
        generalised forces; keep the acceleration that its speeds alone give it."""
        s, k = self._s, self._k
        mass, inertia = s.body(i, L.MASS), s.body(i, L.INERTIA)
        arm = k.to_world_vector(i, s.body(i, L.COM_X), s.body(i, L.COM_Y))
        w = s.parent[i]
        bias = (ZERO, ZERO)  # acceleration of the pivot while no speed changes
        if w >= 0 and w not in s.guided:
            turned, about = k.to_world_vector(w, s.body(i, L.PIVOT_X), s.body(i, L.PIVOT_Y)), k.pose[w].turning
            bias = tuple(b - about * about * d for b, d in zip(self._bias[w], turned, strict=True))  # type: ignore[assignment]
        self._bias[i] = bias
        ways = k.ways(i, *self.centre(i))
        square, turned_on = k.pose[i].turning * k.pose[i].turning, k.pose[i].drift
        drift = bias[0] - square * arm[0] - turned_on * arm[1], bias[1] - square * arm[1] + turned_on * arm[0]
        self._drift[i] = drift
        pull = (mass * drift[0], mass * (drift[1] + self._gravity))
        turns = k.turns(i)
        for a in ways:
            self._add(self._force, a, -dot(ways[a], pull) - inertia * turned_on * turns.get(a, ZERO))
            for b in ways:
                if b <= a:
                    turned_too = inertia * turns[a] * turns[b] if a in turns and b in turns else ZERO
                    self._add(self.mass, (a, b), mass * dot(ways[a], ways[b]) + turned_too)

    def centre(self, i: int) -> Vector:
        """World position of the i-th body's centre of mass, m."""
        return self._k.to_world_point(i, self._s.body(i, L.COM_X), self._s.body(i, L.COM_Y))

    def velocity(self, i: int) -> Vector:
        """Velocity of the i-th body's centre of mass, m/s."""
        return self._k.velocity(self._k.ways(i, *self.centre(i)))

    def acceleration(self, i: int, rates: list[Expression]) -> Vector:
        """Acceleration of the i-th body's centre of mass, m/s^2, from the ``rates`` of all speeds."""
        if i in self._s.guided:
            return ZERO, rates[i]
        ways, drift = self._k.ways(i, *self.centre(i)), self._drift[i]
        moved = [total(way[k] * rates[j] for j, way in ways.items()) for k in (0, 1)]
        return drift[0] + moved[0], drift[1] + moved[1]

    def _joint_speed(self, i: int) -> Expression:
        return self._k.pose[i].turning if i in self._s.led else self._k.state.v[i]

    def joint_friction(self) -> dict[int, Expression]:
        """Friction of each joint by coordinate, with the sign of the joint's speed: a torque, N m, of a guide a force,
        N."""
        s, k = self._s, self._k
        return {
            i: k.friction(
                (self._joint_speed(i),), k.per_slide if i in s.guided else k.per_turn, s.body(i, L.JF_A),
                s.body(i, L.JF_B1), s.body(i, L.JF_B2),
            )
            for i in sorted({*range(s.own), *s.led})
        }  # fmt: skip

    def forces(self) -> list[Statement]:
        """Statements that add weights, velocity-dependent inertia forces and joint friction to the generalised forces
        ``f0``, …."""
        rubs = self.joint_friction()
        taken = {i: e for i, e in rubs.items() if i not in self._s.led}
        for i in self._s.led:  # also resists what raises it
            taken |= {k: taken.get(k, ZERO) + rate * rubs[i] for k, rate in self._k.turns(i).items()}
        return [
            Accumulate(variable(f"f{i}"), e - taken.get(i, ZERO)) for i, e in self._force.items() if i in self._s.solved
        ]

    def inertia(self, acceleration: list[Expression]) -> list[Expression]:
        """Products M a, by row (n,), of mass matrix and ``acceleration`` (n,) of all coordinates; ZERO in rows that are
        not solved for."""
        out = [ZERO] * self._s.n
        for (i, j), m in self.mass.items():
            for row, column in {(i, j), (j, i)}:
                if row in self._s.solved:
                    out[row] = out[row] + m * acceleration[column]
        return out

    def energy(self) -> list[Statement]:
        """Statements that add kinetic and gravitational energy (J) to the variable ``energy``, and power (W) lost by
        friction to ``joints``, of a guide to ``rail``."""
        s, k = self._s, self._k
        v = k.state.v
        moving = total((0.5 if i == j else 1.0) * m * v[i] * v[j] for (i, j), m in self.mass.items())
        heights = total(
            s.body(i, L.MASS)
            * self._gravity
            * (k.pose[i].pivot[1] + k.to_world_vector(i, s.body(i, L.COM_X), s.body(i, L.COM_Y))[1])
            for i in s.bodies
            if i not in s.guided
        )
        rubs = self.joint_friction()
        turning = total(e * self._joint_speed(i) for i, e in rubs.items() if i not in s.guided)
        lifting = total(e * v[i] for i, e in rubs.items() if i in s.guided)
        out: list[Statement] = [
            Accumulate(variable("energy"), moving + heights),
            Accumulate(variable("joints"), turning),
        ]
        return out + ([Accumulate(variable("rail"), lifting)] if s.guided else [])


def solve_mass_matrix(mass: Masses, forces: dict[int, Expression]) -> dict[int, Expression]:
    """Accelerations a with M a = f of the coordinates whose ``forces`` are given: those with the fewest links first."""
    m = {pair: e for (i, j), e in mass.items() for pair in ((i, j), (j, i)) if i in forces and j in forces}
    f, left, done = dict(forces), list(forces), []
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
    a = dict.fromkeys(forces, ZERO)
    for k, inverse, shares in reversed(done):
        a[k] = f[k] * inverse - total(share * a[j] for j, share in shares.items())
    return a
