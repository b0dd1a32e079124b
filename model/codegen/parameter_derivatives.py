"""Programs of the derivatives of forces, internal variables and normal forces by the scene's numbers.

``numbers``: derivatives of d(f - M a), of the rates of memories and of the force on the string by every number p that
they depend on, at the state and accelerations of a workspace; of the modes' rates by their own numbers.
``normals``: normal force of each contact with its derivatives by coordinates, speeds, memories and numbers.
``regime``: bits of contacts and tips that push, touch an arc's tangent, slide forwards, are pressed in, and of joints
that turn forwards: where one changes the Jacobian jumps or turns.
``propagate_modes``: what free modes become in a time, with their derivatives.
"""

from __future__ import annotations

from model.compiler.expressions import ONE, ZERO, Expression, differentiator, intern, read, subexpressions, value_of
from model.compiler.programs import (
    Accumulate,
    Assign,
    If,
    Program,
    Statement,
    loop_over,
    map_assignments,
    slot,
    variable,
)
from model.elements.kinematics import State
from model.elements.scene import Elements
from model.elements.strings import Modes
from model.elements.structure import Structure
from model.kernels import layout as L
from model.kernels import workspace as W

CARRIED = (
    10  # numbers of a mode in `propagate_modes`: way and rate, then of each its slopes by way, rate, stiffness, damping
)


def numbers_read(e: Expression) -> list[Expression]:
    """Numbers of the parameter vector that an expression depends on, in their order; not those that a loop finds."""
    found = [x for x in subexpressions([e]) if x.op == "read" and x.args[0] == "p" and len(x.args) == 2]
    return sorted(found, key=lambda x: int(x.args[1]))


def normal_places(s: Structure) -> list[list[int]]:
    """Indices in the parameter vector of all that the normal force of each contact may depend on, in the order of its
    row."""
    pivots = [L.GLOBALS + L.BODY_SIZE * i + k for i in s.bodies for k in (L.PIVOT_X, L.PIVOT_Y)]
    out = []
    for c in range(len(s.contact)):
        own = [s.offset[1] + L.CONTACT_SIZE * c + k for k in range(L.DAMP + 1)]
        felt = [int(number.args[1]) for number in s.law_numbers(c)]
        give = [s.offset[7] + L.STRING_GIVE] if c in s.string else []
        out.append(own + pivots + felt + give)
    return out


def normal_sizes(s: Structure) -> list[int]:
    """Numbers of each contact's row: force, derivatives by coordinates, speeds, its memories, and `normal_places`."""
    return [1 + 2 * s.n + len(s.memories(c)) + len(places) for c, places in enumerate(normal_places(s))]


class ParameterDerivatives:
    """Programs of these kernels for a structure.

    Parameters
    ----------
    s : structure of a scene; of coordinates that are prescribed the workspace holds angle, speed and acceleration
    """

    def __init__(self, s: Structure) -> None:
        self._s = s
        q, v = ([read("w", start + i) for i in s.bodies] for start in (W.Q, W.V))
        for way, speed in s.pin_places(W.Z).values():
            q.append(read("w", way))
            v.append(read("w", speed))
        z = [read("w", W.Z + m) for m in range(len(s.memory))]
        self._e = Elements(s, State(q, v, z, read("u", 0)), row=W.Z, everywhere=True)

    def numbers(self) -> Program:
        """Program that writes to ``y``, for each of the scene's numbers p in turn, d(f - M a)/dp of what is solved for,
        then d/dp of each internal variable's rate and of the string's force.

        The row of a mode's number holds the derivative of the mode's own rate first.
        """
        s, e = self._s, self._e
        free, first = s.free, W.P_ACC if s.pin else W.ACC
        rows = {f"f{i}": k for k, i in enumerate(s.solved)} | {f"fade{m}": free + m for m in range(len(s.memory))}
        rows |= {"on the string": free + len(s.memory)} if s.string else {}
        size = s.free + len(s.memory) + len(s.string)
        acceleration = [read("w", (first if i in s.solved else W.ACC) + i) for i in range(s.n)]
        inertia = dict(enumerate(e.bodies.inertia(acceleration)))
        lines: list[Statement] = [Accumulate(variable(f"f{i}"), -inertia[i]) for i in s.solved]
        lines += e.contactless_forces()
        for contact in e.contacts.values():
            lines += contact.forces()
        for tip in e.tips:
            lines += tip.forces()
        puts: dict[str, set[Expression]] = {}

        def with_derivatives(line: Assign | Accumulate) -> list[Statement]:
            if isinstance(line, Assign):
                puts.setdefault(str(line.place[1]), set()).update(numbers_read(line.value))
            return [line]

        map_assignments(lines, with_derivatives)
        touched: set[int] = set()

        def one(line: Assign | Accumulate) -> list[Statement]:
            text = str(line.place[1])
            out: list[Statement] = [line] if text == "on the string" else []  # the modes' rates read it
            numbers = puts[text] if isinstance(line, Assign) else numbers_read(line.value)
            for number in sorted(numbers, key=lambda x: int(x.args[1])):
                slope, place = differentiator({number: ONE})(line.value), size * number.args[1] + rows[text]
                if isinstance(line, Assign):  # in place of what was put before
                    out.append(Assign(slot("y", place), slope))
                elif slope is not ZERO:
                    out.append(Accumulate(slot("y", place), slope))
                touched.update([place] if slope is not ZERO else [])
            return out

        added = map_assignments(lines, one)
        zeros: list[Statement] = [Assign(slot("y", k), ZERO) for k in sorted(touched)]
        return self._program([*self._e.string_seen(), *zeros, *added, *self._modes(size)])

    def _modes(self, size: int) -> list[Statement]:
        """Statements for derivatives of the modes' rates by gain, stiffness and damping of each; ``size``: entries of
        ``y`` a parameter."""
        out: list[Statement] = []
        for m in (contact.modes for contact in self._e.strings):

            def one(i: Expression, m: Modes = m) -> list[Statement]:
                numbers = [m.number(k, i) for k in range(3)]
                rate = m.rate(i, m.state(W.Z, 0, i), m.state(W.Z, 1, i), value_of("on the string"))
                start = size * (self._s.offset[7] + L.STRING_HEAD)
                return [
                    Assign(
                        slot("y", start, intern("whole_multiply", m.half(k, i), size)),
                        differentiator({numbers[k]: ONE})(rate),
                    )
                    for k in range(3)
                ]

            out.append(loop_over("numbers of modes", m.count, one))
        return out

    def normals(self) -> Program:
        """Program that writes to ``y``, contact after contact, the normal force, N, 0 where it does not push, and where
        it does its derivatives by coordinates, speeds, own internal variables and the numbers of `normal_places`."""
        s, e = self._s, self._e
        out, start = e.string_seen(), 0
        for c, (places, size) in enumerate(zip(normal_places(s), normal_sizes(s), strict=True)):
            contact = e.contacts.get(c) or e.contact(c)
            pressing, force = contact.felt
            by = [*e.state.q, *e.state.v, *(e.state.z[m] for m in s.memories(c)), *(read("p", k) for k in places)]
            row = [
                Assign(slot("y", start + k), x)
                for k, x in enumerate([force, *(differentiator({x: ONE})(force) for x in by)])
            ]
            out += [Assign(slot("y", start), ZERO), If(contact.touches, [If(pressing, list(row))])]
            start += size
        return self._program(out)

    def regime(self) -> Program:
        """Program of a mask of conditions that select a branch of the forces (pressed, sliding sense, …): a bit is set
        where one holds."""
        s, e = self._s, self._e
        holds: list[Expression] = []
        for c in s.place:
            contact = e.contacts[c]
            pushes = contact.touches & contact.felt[0]
            holds.append(pushes)
            if s.contact[c][2] == L.HYBRID:
                holds.append(pushes & contact.is_off_arc())
            if c not in s.string:
                rubs = intern("differs", contact.number(L.MU_A), ZERO)
                holds.append(pushes & rubs & (contact.relative_speeds[1] > 0.0))
            if s.memories(c):
                holds.append(pushes & (contact.relative_speeds[0] > 0.0))
        holds += [(tip.depth > 0.0) & tip.felt[0] for tip in e.tips]
        holds += [intern("differs", s.body(i, L.JF_A), ZERO) & (e.state.v[i] > 0.0) for i in s.bodies]
        assert len(holds) <= 64  # bits
        for c in s.place:
            if s.law(c).added:  # of what it decides by as much as there are bits for
                holds += [e.contacts[c].touches & one for one in e.contacts[c].branch_conditions()]
        holds = holds[:64]
        return Program(dict.fromkeys("wp", "array"), e.string_seen(), [(k, ~one) for k, one in enumerate(holds)])

    def propagate_modes(self) -> Program:
        """Program that writes to ``y``, for each mode that vibrates freely for the time ``u``, s, `CARRIED` numbers:
        way and rate then, derivatives of that way by way, rate, stiffness and damping, and those of that rate."""
        out: list[Statement] = []
        for m in (contact.modes for contact in self._e.strings):

            def one(i: Expression, m: Modes = m) -> list[Statement]:
                by = [m.state(W.Z, 0, i), m.state(W.Z, 1, i), m.number(1, i), m.number(2, i)]
                y, u = m.free_vibration(i, read("u", 0))
                row = [y, u, *(differentiator({x: ONE})(y) for x in by), *(differentiator({x: ONE})(u) for x in by)]
                behind = intern("whole_multiply", i, CARRIED)
                return [Assign(slot("y", k, behind), x) for k, x in enumerate(row)]

            out.append(loop_over("carried", m.count, one))
        return self._program(out)

    def _program(self, statements: list[Statement]) -> Program:
        return Program(dict.fromkeys("wupy", "array"), statements)
