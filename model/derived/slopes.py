"""What parameters do to a scene, derived from its elements: change of forces and of contacts' normal forces by numbers.

``numbers``: d(f - M a)/dp of every number p that a force depends on, at the state and accelerations of a workspace.
``normals``: normal force of each contact with its derivatives by coordinates, speeds, its own numbers and all pivots.
``regime``: bits of the contacts that push, touch an arc's tangent, slide forwards: there the Jacobian jumps or turns.
"""

from __future__ import annotations

from model.compiler.expressions import ONE, ZERO, Expression, make, parts, read, slopes
from model.compiler.programs import Add, If, Program, Put, Statement, at, mapped
from model.elements.kinematics import State
from model.elements.scene import Elements
from model.elements.structure import Structure
from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.regimes import BESIDE, SLIDING, normal_size


def numbers_read(e: Expression) -> list[Expression]:
    """Numbers of the parameter vector that an expression depends on, in their order; not those that a loop finds."""
    found = [x for x in parts([e]) if x.op == "read" and x.args[0] == "p" and len(x.args) == 2]
    return sorted(found, key=lambda x: int(x.args[1]))


class Differentiated:
    """Programs of these kernels for a structure.

    Parameters
    ----------
    s : structure of a scene; of coordinates that are prescribed the workspace holds angle, speed and acceleration
    """

    def __init__(self, s: Structure) -> None:
        self._s = s
        q, v = ([read("w", start + i) for i in s.bodies] for start in (W.Q, W.V))
        self._e = Elements(s, State(q, v, [], read("u", 0)), everywhere=True)

    def numbers(self) -> Program:
        """Rows of ``y`` by number, n entries each: d(f - M a)/dp of the free coordinates."""
        s, e = self._s, self._e
        touched: set[int] = set()

        def one(line: Put | Add) -> list[Statement]:
            i = int(str(line.place[1])[1:])
            out: list[Statement] = []
            for number in numbers_read(line.value):
                slope = slopes({number: ONE})(line.value)
                if slope is not ZERO:
                    touched.add(s.free * number.args[1] + i)
                    out.append(Add(at("y", s.free * number.args[1] + i), slope))
            return out

        acceleration = [read("w", W.ACC + i) for i in s.bodies]
        inertia = [Add(("local", f"f{i}", None), -m) for i, m in enumerate(e.bodies.inertia(acceleration))]
        lines = [*e.smooth_forces(), *inertia]
        for contact in e.contacts.values():
            lines += contact.forces()
        for tip in e.tips:
            lines += tip.forces()
        added = mapped(lines, one)
        return self._program([*(Put(at("y", k), ZERO) for k in sorted(touched)), *added])

    def normals(self) -> Program:
        """Row of each contact: force, derivatives by coordinates and by speeds, by its numbers, by pivots' x and y."""
        s, e = self._s, self._e
        n, size = len(s.bodies), normal_size(len(s.bodies))
        by = [slopes({x: ONE}) for x in (*e.state.q, *e.state.v)]
        out: list[Statement] = []
        for c in range(len(s.contact)):
            contact = e.contact(c)
            pressing, force = contact.felt
            numbers = [contact.number(k) for k in range(L.K_A + 4)]
            numbers += [s.body(i, k) for i in s.bodies for k in (L.PIVOT_X, L.PIVOT_Y)]
            changes = [d(force) for d in by] + [slopes({x: ONE})(force) for x in numbers]
            row = [Put(at("y", size * c + k), x) for k, x in enumerate([force, *changes])]
            out += [Put(at("y", size * c), ZERO), If(contact.touches, [If(pressing, list(row))])]
        assert size == 1 + 2 * n + L.K_A + 4 + 2 * n
        return self._program(out)

    def regime(self) -> Program:
        """Bits as told above, by place of the contact."""
        conditions = []
        for c, place in self._s.place.items():
            contact = self._e.contacts[c]
            pushes = contact.touches & contact.felt[0]
            conditions.append((place, ~pushes))
            if self._s.contact[c][2] == L.HYBRID:
                conditions.append((BESIDE + place, ~(pushes & contact.beside_the_arc())))
            rubs = make("differs", contact.number(L.MU_A), ZERO) & (contact.closing[1] > 0.0)
            conditions.append((SLIDING + place, ~(pushes & rubs)))
        return Program(dict.fromkeys("wp", "array"), [], conditions)

    def _program(self, statements: list[Statement]) -> Program:
        return Program(dict.fromkeys("wupy", "array"), statements)
