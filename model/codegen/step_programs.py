"""Programs of a step: linearise the scene at its start, evaluate it at the stages.

``linearise``: accelerations, K = df/dq - (dM/dq) a, D = df/dv, df/du, what memories are coupled by, open gaps and
sliding speeds with their rates. ``prepare``: the inverse of M / (gamma h) - D - gamma h K. ``skip``: contacts that
cannot touch within the step. ``stage``: accelerations at a stage, and the stage of each state. ``energy``: energy of a
state, power put in and powers lost. A memory z, of felt, acts on the joints of its contact's chain and on nothing else,
so that each stage eliminates it. Numbers are read from a scene's parameter vector (`model.kernels.layout`) and kept in
the workspace of a step (`model.kernels.workspace`).
"""

from __future__ import annotations

from collections.abc import Callable

from model.compiler.expressions import (
    ONE,
    ZERO,
    Expression,
    argument,
    constant,
    differentiator,
    intern,
    maximum,
    read,
    total,
    value_of,
    where,
)
from model.compiler.programs import (
    Accumulate,
    Assign,
    ClearMask,
    If,
    Place,
    Program,
    Reload,
    Statement,
    accumulated_places,
    compute,
    compute_vectorised,
    is_unmasked,
    loop_over,
    map_assignments,
    slot,
    variable,
)
from model.elements.bodies import solve_mass_matrix
from model.elements.contacts import Contact, largest_acceleration, rate_along
from model.elements.kinematics import State
from model.elements.prescribed import interpolate_motion
from model.elements.scene import Elements
from model.elements.strings import StringContact
from model.elements.structure import Structure
from model.kernels import layout as L
from model.kernels import workspace as W

FARTHEST_M = 0.02  # a joint gives no farther than this; its body's other turns reach as much farther
WORTH_OF_WAY = 10.0  # 1/s: an error of d weighs against one of a speed as that of an angle does
STEEPEST = 1.25  # a prescribed front's lever is at least 0.8 of its length (`model.scene.key_motion.LARGEST_RISE`)
LONGEST_OF_STAGE = 5.0  # steps over gamma times the step, at most: no method has a gamma below 0.2
LONGEST_MEMORY = 1e-3  # s, for which an error of a memory is taken to act at most: a blow's contact
BOUND_SLACK = 1e-7  # m, as `model.integrators.step_control`
SOUND = 1e-6  # share of a pivot that may be left

LOSSES = {
    "energy": W.ENERGY, "given": W.POWER_IN, "felt": W.POWER_FELT, "friction": W.POWER_FRICTION,
    "joints": W.POWER_JOINTS, "rail": W.POWER_RAIL, "shank": W.POWER_SHANK, "pins": W.POWER_PINS,
    "string": W.POWER_STRING, "drive": W.POWER_DRIVE,
}  # fmt: skip
Row = list[Expression]
Differentiators = tuple[list[Callable[[Expression], Expression]], ...]
"""Derivatives by each coordinate and by each speed."""
ALWAYS = {"energy", "given", "felt", "friction", "joints"}


class StepPrograms:
    """Programs of the kernels of a structure.

    Parameters
    ----------
    s : the structure
    lanes : whether what a kernel of one run is called with lies in rows of the workspace instead
    """

    def __init__(self, s: Structure, lanes: bool = False) -> None:
        self._s, self._lanes = s, lanes
        self._stiff, self._damp, self._lu = (
            (W.P_STIFF, W.P_DAMP, W.P_LU) if s.pin else (W.STIFF, W.DAMP, W.LU)
        )  # fmt: skip
        self._width = W.WIDE if s.pin else W.WIDTH

    # where numbers are --------------------------------------------------------------------------------------------

    def _condition(self, text: str) -> Expression:
        rows = {"u": W.INPUT, "ft": W.INPUT_RATE, "gh": W.STAGE_STEP, "rate": W.STEP_RATE}
        return read("w", rows[text]) if self._lanes else argument(text)

    def _arguments(self, *numbers: str, arrays: str = "wp") -> dict[str, str]:
        return dict.fromkeys(arrays, "array") | ({} if self._lanes else dict.fromkeys(numbers, "number"))

    def _entry(self, start: int, i: int, j: int) -> Place:
        """Where entry (i, j) of the matrix that begins at ``start`` in the workspace is written."""
        return slot("w", start + self._width * i + j)

    def _stored_entry(self, start: int, i: int, j: int) -> Expression:
        return read("w", start + self._width * i + j)

    def _acceleration(self, i: int) -> int:
        return (W.P_ACC if self._s.pin else W.ACC) + i

    def _coordinates(self, row: int, q: int, v: int, prescribed: tuple[Row, Row]) -> tuple[Row, Row]:
        """Rows of all coordinates and of all speeds, as expressions: own ones from the workspace, from ``q`` and ``v``
        on, those ``prescribed`` (coordinates, speeds), and those of joints that give, whose places follow ``row``."""
        s, places = self._s, self._s.pin_places(row)
        own = range(s.own)
        return (
            [*(read("w", q + i) for i in own), *prescribed[0], *(read("w", place) for place, _ in places.values())],
            [*(read("w", v + i) for i in own), *prescribed[1], *(read("w", place) for _, place in places.values())],
        )

    def _prescribed_motion(self, moving: Expression) -> tuple[list[Statement], tuple[Row, Row, Row, Row]]:
        """Statements that set prescribed coordinates and their three derivatives at the time ``u``, and rows of these
        four; ``moving`` (0 or 1) scales the derivatives.

        Also the rate of the acceleration, where inertia couples it to what is solved for.
        """
        s = self._s
        before: list[Statement] = []
        rows: tuple[Row, Row, Row, Row] = ([], [], [], [])
        for i in list(s.bodies)[s.own :]:
            find, values = interpolate_motion(s.offset[4], self._condition("u"), read("w", W.PIECE))
            before += find
            for k, (row, value) in enumerate(zip(rows, values, strict=True)):
                if k < 3 or i in s.led:
                    before.append(Assign(variable(f"motion{k}_{i}"), value * (moving if k else ONE)))
                    row.append(value_of(f"motion{k}_{i}"))
        return before, rows

    def _accelerations(self, e: Elements, prescribed: Row) -> dict[int, Expression]:
        """Accelerations of what is solved for, from forces as names and what is prescribed."""
        s = self._s
        forces = {i: value_of(f"f{i}") for i in s.solved}
        for i, m, k in self._prescribed_couplings(e):
            forces[i] = forces[i] - m * prescribed[k]
        return solve_mass_matrix(e.bodies.mass, forces)

    def _prescribed_couplings(self, e: Elements) -> list[tuple[int, Expression, int]]:
        """What is solved for, its entry of the mass matrix with a prescribed coordinate, and which of these."""
        s, prescribed = self._s, list(self._s.bodies)[self._s.own :]
        both = [(i, m, j) for (a, b), m in e.bodies.mass.items() for i, j in ((a, b), (b, a))]
        return [(i, m, j - s.own) for i, m, j in both if i in s.solved and j in prescribed]

    def links(self) -> list[list[int]]:
        """Coordinates on which each memory acts, then those on which the string acts, in the order of the workspace."""
        e, _ = self._pattern()
        return [list(e.contacts[c].ways) for c in (*self._s.memory, *self._s.string)]

    # linearise ----------------------------------------------------------------------------------------------------

    def linearise(self) -> Program:
        """Program that writes, at the workspace's state, accelerations a, K = df/dq - (dM/dq) a, D = df/dv, df/du, mass
        matrix, open gaps and their rates to the workspace; returns how many contacts touch."""
        s, moving = self._s, ONE - read("w", W.STATIC)
        find, (pq, pv, pa, jerk) = self._prescribed_motion(moving)
        z = [read("w", W.Z + m) for m in range(len(s.memory))]
        e = Elements(s, State(*self._coordinates(W.Z, W.Q, W.V, (pq, pv)), z, self._condition("u")))
        out: list[Statement] = [*find]
        if pq:
            out.append(Assign(slot("w", W.PIECE), value_of("piece")))
            for k, i in enumerate(list(s.bodies)[s.own :]):
                out += [Assign(slot("w", start + i), row[k]) for start, row in ((W.Q, pq), (W.V, pv), (W.ACC, pa))]
        by_q = [differentiator({x: ONE}) for x in e.state.q]
        by_v = [differentiator({x: ONE}) for x in e.state.v]
        mass = e.bodies.mass
        inverse_inertia = {i: ONE / mass[i, i] for i in s.solved}
        friction = {i: rub for i, rub in e.bodies.joint_friction().items() if i < s.own}
        columns = self._columns(e)
        entries = [(start, i, j) for i, j in sorted(columns) for start in (self._stiff, self._damp)]
        out += [Assign(self._entry(*entry), ZERO) for entry in entries]
        out += [
            compute_vectorised(*e.k.rotations()), compute_vectorised(*friction.values()),
            compute_vectorised(*(by_v[i](x) for i, x in friction.items())),
            compute(e.k.per_slide, *inverse_inertia.values()),
        ]  # fmt: skip
        out += e.contactless_forces()
        later: list[Statement] = []
        for c, contact in e.contacts.items():
            out += self._linearise_contact(e, contact, (by_q, by_v), inverse_inertia)
            later += self._second_rates(contact, s.place[c], pa)
        for tip in e.tips:
            out += self._differentiate_statements(tip.forces(), e, (by_q, by_v), list(tip.ways), [])
        a = self._accelerations(e, pa)
        out += [Assign(slot("w", self._acceleration(i)), a[i]) for i in s.solved]
        if s.pin:
            out += [Assign(slot("w", W.ACC + i), a[i]) for i in range(s.own)]
        out += later
        out += self._linearise_contactless(e, (by_q, by_v), moving, pa)
        out += self._differentiate_by_input(e, pv, pa, jerk)
        return Program(self._arguments("u"), out, "touching")

    def _columns(self, e: Elements) -> set[tuple[int, int]]:
        """Entries of K and D that can differ from zero; rows are free coordinates, columns also prescribed ones."""
        s = self._s
        if s.pin:
            return {(i, j) for i in s.solved for j in range(s.n)}
        out = {(i, i) for i in s.solved}
        out |= {pair for i, j in e.bodies.mass for pair in ((i, j), (j, i))}
        for ways in [c.ways for c in e.contacts.values()] + [t.ways for t in e.tips]:
            out |= {(i, j) for i in ways for j in ways}
        for kind, i in s.drive:
            if kind == L.AMPLIFIER:
                out |= {(i, i - 1), (i - 1, i)}
        return {(i, j) for i, j in out if i in s.solved}

    def _differentiate_statements(
        self,
        statements: list[Statement],
        e: Elements,
        differentiators: Differentiators,
        chain: list[int],
        memories: list[int],
    ) -> list[Statement]:
        """The statements, each force on what is solved for and rate of an internal variable (indices ``memories``)
        followed by its derivatives by the coordinates ``chain``, their speeds and these variables; ``differentiators``:
        by coordinate, by speed."""
        rates = {f"fade{m}": m for m in memories}
        forces = {f"f{i}": i for i in self._s.solved}

        def one(s: Assign | Accumulate) -> list[Statement]:
            text = str(s.place[1])
            out: list[Statement] = [s]
            if s.place[0] != "local":
                return out
            if text in forces:
                i = forces[text]
                for start, slope in ((self._stiff, differentiators[0]), (self._damp, differentiators[1])):
                    found = [(j, slope[j](s.value)) for j in chain]
                    out += [Accumulate(self._entry(start, i, j), d) for j, d in found if d is not ZERO]
                for m in memories:
                    d = differentiator({e.state.z[m]: ONE})(s.value)
                    if i in chain:
                        out.append(Accumulate(slot("w", W.Z_PUSH + W.LINKS * m + chain.index(i)), d))
            elif text in rates:
                m = rates[text]
                out.append(Assign(slot("w", W.Z_RATE + m), s.value))
                out.append(Assign(slot("w", W.Z_FADE + m), differentiator({e.state.z[m]: ONE})(s.value)))
                for start, slope in ((W.Z_TURN, differentiators[0]), (W.Z_SPEED, differentiators[1])):
                    places = [slot("w", start + W.LINKS * m + k) for k in range(len(chain))]
                    out += [Assign(place, slope[j](s.value)) for place, j in zip(places, chain, strict=True)]
            return out

        return map_assignments(statements, one)

    def _linearise_contact(
        self,
        e: Elements,
        contact: Contact,
        differentiators: Differentiators,
        inverse_inertia: dict[int, Expression],
    ) -> list[Statement]:
        """Statements of a contact's gap, its rate and, in touch, its force and derivatives; ``inverse_inertia``: 1/M_ii
        by coordinate; ``differentiators``: lists by coordinate and by speed."""
        s, c = self._s, contact.c
        where_ = s.place[c]
        if isinstance(contact, StringContact):
            return self._linearise_string(e, contact, differentiators, inverse_inertia)
        chain = list(contact.ways)
        memories = contact.memories
        forces = self._differentiate_statements(contact.forces(), e, differentiators, chain, memories)
        *before, touch = forces
        assert isinstance(touch, If)
        pressing, force = contact.felt
        grip = contact.number(L.MU_A) * force * largest_acceleration(contact.slides(), inverse_inertia)
        turns, slides = contact.turns(), contact.slides()
        inside = [
            Assign(slot("w", W.GRIP + where_), ZERO), *touch.then, Accumulate(variable("touching"), ONE),
            Assign(slot("w", W.ROOM + where_), ZERO), *self._gap(where_, contact.gap[0], contact.relative_speeds[0]),
            Assign(slot("w", W.SLIDE + where_), contact.relative_speeds[1]),
            If(pressing, [Assign(slot("w", W.GRIP + where_), grip),
                          *self._memory_error_weights(e, contact, inverse_inertia, chain)]),
            *self._directions(where_, turns, slides),
            self._touch_limit(contact, contact.relative_speeds[0], turns, inverse_inertia),
        ]  # fmt: skip
        open_turns = contact.open_turns()
        rate = rate_along(open_turns, e.state.v)
        away = [
            Assign(slot("w", W.ROOM + where_), contact.clearance()),
            Assign(slot("w", W.GAP + where_), contact.clearance()),
            Assign(slot("w", W.GAP_RATE + where_), rate), *self._directions(where_, open_turns, {}),
            self._touch_limit(contact, rate, open_turns, inverse_inertia),
        ]  # fmt: skip
        if contact.law.anew is not None:
            away += [Assign(slot("w", W.Z + m), constant(contact.law.anew)) for m in contact.memories]
        return [*self._default_memories(contact, inverse_inertia, chain), *before, If(contact.touches, inside, away)]

    def _gap(self, place: int, depth: Expression, rate: Expression) -> list[Statement]:
        return [Assign(slot("w", W.GAP + place), -depth), Assign(slot("w", W.GAP_RATE + place), -rate)]

    def _touch_limit(
        self, contact: Contact, rate: Expression, turns: dict[int, Expression], inverse_inertia: dict[int, Expression]
    ) -> Statement:
        kick = contact.stiffness(rate) * largest_acceleration(turns, inverse_inertia)
        return Assign(slot("w", W.KICK + self._s.place[contact.c]), kick)

    def _directions(self, place: int, turns: dict[int, Expression], slides: dict[int, Expression]) -> list[Statement]:
        """Statements that store how each coordinate changes the gap and slides, for the second rates."""
        out: list[Statement] = [Assign(variable(f"turns{place}_{k}"), turn) for k, turn in turns.items()]
        return out + [Assign(variable(f"slides{place}_{k}"), slides.get(k, ZERO)) for k in turns]

    def _second_rates(self, contact: Contact, place: int, prescribed_acceleration: list[Expression]) -> list[Statement]:
        """Statements for the rates of gap rate, m/s^2, and sliding speed, 0 without friction, of the contact at index
        ``place``, from the accelerations."""
        s = self._s

        def acceleration(k: int) -> Expression:
            return read("w", self._acceleration(k)) if k in s.solved else prescribed_acceleration[k - s.own]

        turn, slide = (
            total(value_of(f"{text}{place}_{k}") * acceleration(k) for k in list(contact.ways))
            for text in ("turns", "slides")
        )
        rubs = intern("differs", contact.number(L.MU_A), ZERO)
        if isinstance(contact, StringContact):
            slide = ZERO
        return [
            Assign(slot("w", W.GAP_ACC + place), turn),
            Assign(slot("w", W.SLIDE_RATE + place), where(rubs, slide, 0.0)),
        ]  # fmt: skip

    def _default_memories(
        self, contact: Contact, inverse_inertia: dict[int, Expression], chain: list[int]
    ) -> list[Statement]:
        """Statements for a contact's internal variables while it is open: no push on any coordinate in ``chain``, and
        the error of speed that a unit of each is worth; ``inverse_inertia``: 1/M_ii by coordinate."""
        out: list[Statement] = []
        felt = contact.pressed_by(ZERO, contact.relative_speeds[0])
        for m, z, alone in zip(contact.memories, felt.memory, contact.law.recovery_rates(felt), strict=True):
            out += [Assign(slot("w", W.Z_PUSH + W.LINKS * m + k), ZERO) for k in range(len(chain))]
            worth = ZERO
            if contact.law.anew is None:  # of felt that is left alone: as if it were met again at once
                by_memory = differentiator({z: ONE})
                push = abs(by_memory(contact.law.force(felt)[1])) * largest_acceleration(
                    contact.open_turns(), inverse_inertia
                )
                worth = _remembered_error(push, by_memory(alone))
            out.append(Assign(slot("w", W.Z_WEIGHT + m), worth))
        return out

    def _memory_error_weights(
        self, e: Elements, contact: Contact, inverse_inertia: dict[int, Expression], chain: list[int]
    ) -> list[Statement]:
        """Statements that set the error weight of each internal variable of a contact: the speed error that a unit of
        it causes on the coordinates ``chain``; ``inverse_inertia``: 1/M_ii by coordinate."""
        out: list[Statement] = []
        for m in contact.memories:
            pushes = [
                abs(read("w", W.Z_PUSH + W.LINKS * m + k)) * inverse_inertia[j]
                for k, j in enumerate(chain)
                if j in inverse_inertia
            ]
            if not pushes:  # felt under a prescribed body: what it pushes counts as if that were free
                turns, by_memory = contact.turns(), differentiator({e.state.z[m]: ONE})(contact.felt[1])
                pushes = [abs(turns[j] * by_memory) / e.bodies.mass[j, j] for j in chain]
            worth = _remembered_error(maximum(*pushes), read("w", W.Z_FADE + m))
            out.append(Assign(slot("w", W.Z_WEIGHT + m), worth))
        return out

    def _linearise_contactless(
        self, e: Elements, differentiators: Differentiators, is_moving: Expression, prescribed_acceleration: Row
    ) -> list[Statement]:
        """Statements that add K and D of all but contacts to the workspace, and set df/du and the mass matrix.

        Accelerations are known by then. ``is_moving`` is 1, and 0 in statics, where inertia adds nothing.
        """
        s = self._s
        out: list[Statement] = []
        forces = [ZERO] * s.n
        for line in e.contactless_forces():
            assert isinstance(line, Accumulate)
            i = int(str(line.place[1])[1:])
            forces[i] = forces[i] + line.value
        prescribed = dict(zip(range(s.own, len(s.bodies)), prescribed_acceleration, strict=True))
        accelerations = [prescribed[i] if i in prescribed else read("w", self._acceleration(i)) for i in range(s.n)]
        inertia = e.bodies.inertia(accelerations)
        for i in s.solved:
            for j in range(s.n):
                stiff, damp = (
                    differentiators[0][j](forces[i]) - is_moving * differentiators[0][j](inertia[i]),
                    differentiators[1][j](forces[i]),
                )
                out += [] if stiff is ZERO else [Accumulate(self._entry(self._stiff, i, j), stiff)]
                out += [] if damp is ZERO else [Accumulate(self._entry(self._damp, i, j), damp)]
            u = e.state.u
            by_input = differentiator({u: ONE})(forces[i]) if s.own == len(s.bodies) else ZERO
            out.append(Assign(variable(f"u{i}"), by_input))
        for (i, j), m in e.bodies.mass.items():
            if i in s.solved and j in s.solved and s.pin:
                out.append(Assign(self._entry(W.P_MASS, i, j), m))
            if i < s.own and i == j:
                out.append(Assign(slot("w", W.M_DIAG + i), m))
            elif i < s.own and j < s.own:
                out.append(Assign(slot("w", W.M_UP + max(i, j, key=lambda k: s.parent[k])), m))
        return out

    def _differentiate_by_input(
        self, e: Elements, prescribed_speed: Row, prescribed_acceleration: Row, prescribed_jerk: Row
    ) -> list[Statement]:
        """Statements for df/du of forces and internal variables; u may be the time of a prescribed motion."""
        s = self._s
        moved = list(s.bodies)[s.own :]
        out: list[Statement] = []
        for i in s.solved:
            more = total(
                self._stored_entry(self._stiff, i, j) * prescribed_speed[k]
                + self._stored_entry(self._damp, i, j) * prescribed_acceleration[k]
                for k, j in enumerate(moved)
            )
            more = more - total(m * prescribed_jerk[k] for row, m, k in self._prescribed_couplings(e) if row == i)
            value = value_of(f"u{i}") + more
            out += [Assign(slot("w", W.F_U + i), value)] if i < s.own else []
            out += [Assign(slot("w", W.P_INPUT + i), value)] if s.pin else []
        for m, c in enumerate(s.memory):
            terms = ZERO
            for k, j in enumerate(list(e.contacts[c].ways)):
                if j in moved:
                    turn, speed = (read("w", start + W.LINKS * m + k) for start in (W.Z_TURN, W.Z_SPEED))
                    terms = terms + turn * prescribed_speed[j - s.own] + speed * prescribed_acceleration[j - s.own]
            out.append(Assign(slot("w", W.Z_INPUT + m), terms))
        if s.pin:
            for way, speed_place in s.pin_places(W.Z_WEIGHT).values():
                out += [Assign(slot("w", way), constant(WORTH_OF_WAY)), Assign(slot("w", speed_place), ONE)]
        return out

    # the matrix of a step -----------------------------------------------------------------------------------------

    def _pattern(self) -> tuple[Elements, set[tuple[int, int]]]:
        """Elements at the workspace's state, and the entries (i, j) of the matrix that can differ from zero."""
        s = self._s
        spare = [read("w", W.Q + i) for i in range(s.own, len(s.bodies))]
        z = [read("w", W.Z + m) for m in range(len(s.memory))]
        state = State(
            *self._coordinates(W.Z, W.Q, W.V, (spare, spare)), z, ZERO if self._lanes else self._condition("u")
        )
        e = Elements(s, state)
        return e, {(i, j) for i, j in self._columns(e) if j in s.solved}

    def _masses(self, e: Elements) -> set[tuple[int, int]]:
        s = self._s
        return {pair for i, j in e.bodies.mass for pair in ((i, j), (j, i)) if i in s.solved and j in s.solved}

    def _mass(self, i: int, j: int) -> Expression:
        """Entry (i, j) of the mass matrix as ``linearise`` left it."""
        s = self._s
        if s.pin:
            return self._stored_entry(W.P_MASS, max(i, j), min(i, j))
        if i == j:
            return read("w", W.M_DIAG + i)
        return read("w", W.M_UP + (i if s.parent[i] == j else j))

    def prepare(self) -> Program:
        """Program that writes the inverse of the stage matrix M/gh - D - gh K, gh being gamma times the step, with
        modes and internal variables eliminated, to the workspace; returns 1, or 0 where that would lose six digits."""
        s, gh = self._s, self._condition("gh")
        inverse = 1.0 / gh
        e, pattern = self._pattern()
        masses = self._masses(e)
        m: dict[tuple[int, int], Expression] = {}
        for i, j in pattern:
            stiff, damp = (self._stored_entry(start, i, j) for start in (self._stiff, self._damp))
            m[i, j] = (inverse * self._mass(i, j) if (i, j) in masses else ZERO) - damp - gh * stiff
        out: list[Statement] = []
        for g, (_, speed) in s.pin_places(W.Z).items():
            step = LONGEST_OF_STAGE * gh
            way = 1.5 * step * abs(read("w", speed)) + step * step * abs(read("w", W.P_ACC + g)) + BOUND_SLACK
            out.append(Assign(slot("w", W.P_ALLOWANCE + g), way))
        for n, c in enumerate(s.memory):
            ease = 1.0 / (inverse - read("w", W.Z_FADE + n))
            out.append(Assign(slot("w", W.Z_EASE + n), ease))
            chain = list(e.contacts[c].ways)
            for k, j in enumerate(chain):
                back = ease * (gh * read("w", W.Z_TURN + W.LINKS * n + k) + read("w", W.Z_SPEED + W.LINKS * n + k))
                for other, i in enumerate(chain):
                    if i in s.solved and j in s.solved:
                        m[i, j] = m.get((i, j), ZERO) - read("w", W.Z_PUSH + W.LINKS * n + other) * back
        for contact in e.strings:
            out += contact.prepare_modes(inverse, gh)
            chain = list(contact.ways)
            for k, j in enumerate(chain):
                back = (1.0 - value_of("share")) * (gh * read("w", W.S_ANGLES + k) + read("w", W.S_SPEEDS + k))
                for other, i in enumerate(chain):
                    if i in s.solved and j in s.solved:
                        m[i, j] = m.get((i, j), ZERO) + read("w", W.S_ALONG + other) * back
        inverted, sound = _invert_matrix(m, s.solved)
        out += [Assign(self._entry(self._lu, i, j), x) for (i, j), x in inverted.items()]
        self._filled = set(inverted)
        return Program(self._arguments("gh", arrays="w"), out, sound)

    def inverse_pattern(self) -> set[tuple[int, int]]:
        self.prepare()
        return self._filled

    def skip(self) -> Program:
        """Program that returns a mask with a bit for each contact, set where it cannot touch within the step as the
        workspace's allowances bound it."""
        s = self._s
        out: list[Statement] = []
        mask: list[tuple[int, Expression]] = []
        e, _ = self._pattern()
        needed = ZERO
        idle = read("w", W.IDLE) > 0.0
        for c, place in s.place.items():
            way, reaches = ZERO, s.offset[1] + L.CONTACT_SIZE * c + L.REACH
            farther = 2.0 * FARTHEST_M if s.pin else 0.0

            def reach(k: int, reaches: int = reaches, c: int = c, farther: float = farther) -> Expression:
                return read("p", reaches + s.chain[c].index(k)) + farther if k in s.chain[c] else constant(farther)

            for k in list(e.contacts[c].ways):
                far = ONE if k in s.pin else reach(k)
                for i, rise in s.led.items():
                    if i in s.chain[c] and k in (i, rise):  # a rise turns the key, too
                        lever = abs(s.number(2, L.DRIVE_SIZE, 0, L.DRIVE_X))
                        far = STEEPEST * (far if k == i else far + reach(i) / lever)
                way = way + far * read("w", (W.P_ALLOWANCE if k in s.pin else W.ALLOWANCE) + k)
            near = ~(way < read("w", W.ROOM + place))
            if self._lanes:
                near = near & ~idle
                needed = needed + where(near, 1.0, 0.0)
            mask.append((place, near))
        if self._lanes:
            out.append(Assign(slot("w", W.NEEDED), needed))
        return Program(self._arguments(), out, mask)

    # stages -------------------------------------------------------------------------------------------------------

    def stage(self) -> Program:
        """Program that finds stage ``k`` of each state from the accelerations there, without the contacts of ``mask``;
        returns whether a coordinate left its allowance, so that all contacts were evaluated."""
        s = self._s
        rate, k = self._condition("rate"), argument("k")
        find, (pq, pv, pa, _) = self._prescribed_motion(ONE)
        out, q, v, z = self._stage_state(k, (pq, pv))
        out += [*find, compute(*(x for x in (*q, *v) if x not in (*pq, *pv)), *z)]
        moved = [abs(value_of(f"sq{i}")) > read("w", W.ALLOWANCE + i) for i in range(s.own)]
        moved += [abs(value_of(f"sq{g}")) > read("w", W.P_ALLOWANCE + g) for g in s.pin]
        moved += [abs(pq[i - s.own] - read("w", W.Q + i)) > read("w", W.ALLOWANCE + i) for i in list(s.bodies)[s.own :]]
        far = moved[0]
        for one in moved[1:]:
            far = far | one
        out.append(ClearMask(far & (read("w", W.IDLE) <= 0.0) if self._lanes else far))
        e = Elements(s, State(q, v, z, self._condition("u")))
        for contact in e.strings:
            out += contact.stage_modes(k, rate)
        out.append(If(intern("first"), self._start_statements(), self._stage_statements(e, pa)))
        numbers = {} if self._lanes else dict.fromkeys(("gh", "rate", "u", "ft"), "number")
        given = {"w": "array", "p": "array", "a": "plain", "c": "plain", "k": "whole", **numbers, "mask": "whole"}
        return Program(given, [*out, *self._solve_stage(e, k)], "exceeded")

    def _stage_state(self, k: Expression, prescribed: tuple[Row, Row]) -> tuple[list[Statement], Row, Row, Row]:
        """Statements that sum the stages before ``k``, and rows of coordinates, speeds and internal variables at
        stage ``k``; ``prescribed``: rows of coordinates and speeds that stand between own ones and those of joints
        that give."""
        s = self._s
        rows = [(f"{i}", W.Q + i, W.V + i, W.U + i, W.U + W.WIDTH + i, 2 * W.WIDTH) for i in range(s.own)]
        at_z, at_u = s.pin_places(W.Z), s.pin_places(W.Z_U)
        rows += [(f"{g}", *at_z[g], *at_u[g], W.MOST_MEMORIES) for g in s.pin]

        def add_stage(j: Expression) -> list[Statement]:
            a, c = (read(array, 0, intern("whole_add", j, intern("whole_multiply", k, W.MAX_STAGES))) for array in "ac")
            out: list[Statement] = []
            for text, _, _, uq, uv, stride in rows:
                for place, sums in ((uq, ("sq", "b")), (uv, ("sv", "l"))):
                    x = read("w", place, intern("whole_multiply", j, stride))
                    out += [Accumulate(variable(sums[0] + text), a * x), Accumulate(variable(sums[1] + text), c * x)]
            for m in range(len(s.memory)):
                x = read("w", W.Z_U + m, intern("whole_multiply", j, W.MOST_MEMORIES))
                out += [Accumulate(variable(f"sz{m}"), a * x), Accumulate(variable(f"kept{m}"), c * x)]
            return out

        out: list[Statement] = [loop_over("stage", k, add_stage)]
        # one number each, so that derivatives and what is read are of the state and not of its sum
        q = [intern("named", read("w", row[1]) + value_of("sq" + row[0])) for row in rows]
        v = [intern("named", read("w", row[2]) + value_of("sv" + row[0])) for row in rows]
        z = [intern("named", read("w", W.Z + m) + value_of(f"sz{m}")) for m in range(len(s.memory))]
        return out, [*q[: s.own], *prescribed[0], *q[s.own :]], [*v[: s.own], *prescribed[1], *v[s.own :]], z

    def _start_statements(self) -> list[Statement]:
        s = self._s
        out: list[Statement] = [Assign(variable(f"a{i}"), read("w", self._acceleration(i))) for i in s.solved]
        out += [Assign(variable(f"fade{m}"), read("w", W.Z_RATE + m)) for m in range(len(s.memory))]
        return out + [Assign(variable("on the string"), read("w", W.S_FORCE)) for _ in s.string]

    def _stage_statements(self, e: Elements, prescribed_acceleration: Row) -> list[Statement]:
        """Statements of all forces at a stage and of the accelerations ``a0``, … of what is solved for."""
        s = self._s
        friction = [rub for i, rub in e.bodies.joint_friction().items() if i < s.own]
        out: list[Statement] = [
            compute_vectorised(*e.k.rotations()), compute_vectorised(*friction), compute(e.k.per_slide),
            *e.contactless_forces(),
        ]  # fmt: skip
        for c, contact in e.contacts.items():
            *before, touch = contact.forces()
            out += [*before, If(is_unmasked(s.place[c]), [touch])]
        out += [line for tip in e.tips for line in tip.forces()]
        return [
            *out,
            *(Assign(variable(f"a{i}"), a) for i, a in self._accelerations(e, prescribed_acceleration).items()),
        ]

    def _solve_stage(self, e: Elements, k: Expression) -> list[Statement]:
        """Statements that solve the linear system of stage ``k`` (its number) and write the stage of each state into
        the workspace, from the variables that `stage` sets before it."""
        s = self._s
        gh, rate, ft = self._condition("gh"), self._condition("rate"), self._condition("ft")
        n, filled, masses = s.solved, self.inverse_pattern(), self._masses(e)
        columns = {(i, j) for i, j in self._columns(e) if j in s.solved}
        a = {i: value_of(f"a{i}") + value_of(f"l{i}") * rate for i in n}
        b = {i: e.state.v[i] + value_of(f"b{i}") * rate for i in n}
        g: dict[int, Expression] = {}
        out: list[Statement] = []
        for i in n:
            push = ft * read("w", (W.P_INPUT if s.pin else W.F_U) + i)
            push = push + total(self._mass(i, j) * a[j] for j in n if (i, j) in masses)
            stiff = total(self._stored_entry(self._stiff, i, j) * b[j] for j in n if (i, j) in columns)
            g[i] = push + gh * stiff
        kept = []
        for m, c in enumerate(s.memory):
            chain = list(e.contacts[c].ways)
            turned = total(
                read("w", W.Z_TURN + W.LINKS * m + at_row) * b[j] for at_row, j in enumerate(chain) if j in b
            )
            follows = value_of(f"fade{m}") + value_of(f"kept{m}") * rate + ft * read("w", W.Z_INPUT + m) + gh * turned
            kept.append(read("w", W.Z_EASE + m) * follows)
            for at_row, j in enumerate(chain):
                if j in g:
                    g[j] = g[j] + read("w", W.Z_PUSH + W.LINKS * m + at_row) * kept[m]
        for contact in e.strings:
            out.append(Assign(variable("given"), ZERO))
            awake, share = read("w", W.S_AWAKE) > 0.0, read("w", W.S_SHARE)
            out.append(If(awake, contact.known_sides(gh)))
            chain = list(contact.ways)
            turned = gh * total(read("w", W.S_ANGLES + at_row) * b[j] for at_row, j in enumerate(chain) if j in b)
            less = where(awake, share * value_of("given") + (1.0 - share) * turned, 0.0)
            for at_row, j in enumerate(chain):
                if j in g:
                    g[j] = g[j] - read("w", W.S_ALONG + at_row) * less
        g = {i: total(self._stored_entry(self._lu, i, j) * g[j] for j in n if (i, j) in filled) for i in n}
        behind = intern("whole_multiply", k, 2 * W.WIDTH)
        for i in range(s.own):
            out += [
                Assign(slot("w", W.U + i, behind), gh * (b[i] + g[i])),
                Assign(slot("w", W.U + W.WIDTH + i, behind), g[i]),
            ]
        behind = intern("whole_multiply", k, W.MOST_MEMORIES)
        for i, (way, speed) in s.pin_places(W.Z_U).items():
            out += [Assign(slot("w", way, behind), gh * (b[i] + g[i])), Assign(slot("w", speed, behind), g[i])]
        for m, c in enumerate(s.memory):
            back = total(
                (gh * read("w", W.Z_TURN + W.LINKS * m + at_row) + read("w", W.Z_SPEED + W.LINKS * m + at_row)) * g[j]
                for at_row, j in enumerate(list(e.contacts[c].ways))
                if j in g
            )
            out.append(Assign(slot("w", W.Z_U + m, behind), kept[m] + read("w", W.Z_EASE + m) * back))
        for contact in e.strings:
            chain = list(contact.ways)
            back = total(
                (gh * read("w", W.S_ANGLES + at_row) + read("w", W.S_SPEEDS + at_row)) * g[j]
                for at_row, j in enumerate(chain)
                if j in g
            )
            turned = gh * total(read("w", W.S_ANGLES + at_row) * b[j] for at_row, j in enumerate(chain) if j in b)
            more = read("w", W.S_SHARE) * (turned + back - value_of("given"))
            stepped = [Assign(variable("more"), more), *contact.solve_modes(k, value_of("more"), gh)]
            out.append(If(read("w", W.S_AWAKE) > 0.0, stepped))
        return out

    def _linearise_string(
        self,
        e: Elements,
        contact: StringContact,
        differentiators: Differentiators,
        inverse_inertia: dict[int, Expression],
    ) -> list[Statement]:
        """Statements of the contact with the string: force and derivatives where it touches, else the open gap;
        ``inverse_inertia``: 1/M_ii by coordinate; ``differentiators``: lists by coordinate and by speed."""
        s = self._s
        place, chain = s.place[contact.c], list(contact.ways)
        pressing, force = contact.felt
        x, rate = contact.depth_and_rate
        along_x, along_rate = differentiator({x: ONE, rate: ZERO}), differentiator({x: ZERO, rate: ONE})
        turns, open_turns = contact.turns(), contact.open_turns()
        coupled: list[Statement] = []
        for k, j in enumerate(chain):
            coupled += [
                Assign(slot("w", W.S_ALONG + k), turns[j]),
                Assign(slot("w", W.S_ANGLES + k), differentiators[0][j](force)),
            ]
            coupled += [Assign(slot("w", W.S_SPEEDS + k), differentiators[1][j](force))]
        pushes = [Accumulate(variable(f"f{k}"), p) for k, p in contact.push(force, ZERO).items()]
        press = [
            Assign(slot("w", W.S_FORCE), force), Assign(slot("w", W.S_HARD), along_x(force)),
            Assign(slot("w", W.S_LOSSY), along_rate(force)),
            Assign(variable("worth"), along_x(force) * largest_acceleration(turns, inverse_inertia)),
            *self._differentiate_statements(list(pushes), e, differentiators, chain, []), *coupled,
        ]  # fmt: skip
        stiff = contact.number(L.K_C)
        inside = [
            If(pressing, press), Accumulate(variable("touching"), ONE), Assign(slot("w", W.ROOM + place), ZERO),
            *self._gap(place, x, rate), *self._directions(place, turns, {}),
            Assign(slot("w", W.KICK + place), stiff * largest_acceleration(turns, inverse_inertia)),
        ]  # fmt: skip
        rate_open = rate_along(open_turns, e.state.v) + value_of("swing")
        away = [
            Assign(slot("w", W.ROOM + place), maximum(-contact.gap[0] - read("w", W.S_REACH), 0.0)),
            Assign(slot("w", W.GAP + place), maximum(-x, 0.0)), Assign(slot("w", W.GAP_RATE + place), rate_open),
            Assign(variable("worth"), stiff * largest_acceleration(open_turns, inverse_inertia)),
            *self._directions(place, open_turns, {}),
            Assign(slot("w", W.KICK + place), stiff * largest_acceleration(open_turns, inverse_inertia)),
        ]  # fmt: skip
        cleared = [Assign(slot("w", row), ZERO) for row in (W.S_FORCE, W.S_HARD, W.S_LOSSY)]
        cleared += [
            Assign(slot("w", row + k), ZERO) for row in (W.S_ALONG, W.S_ANGLES, W.S_SPEEDS) for k in range(len(chain))
        ]
        return [
            *contact.begin_step(), *cleared, Assign(variable("worth"), ZERO), If(x > 0.0, inside, away),
            *contact.set_error_weights(value_of("worth")), Reload(),
        ]  # fmt: skip

    # energy -------------------------------------------------------------------------------------------------------

    def energy(self) -> Program:
        """Program that writes the energy, J, the power put in and the powers lost, W, at the state from `W.AUDIT_Q` on,
        to the workspace."""
        s, prescribed = self._s, list(self._s.bodies)[self._s.own :]
        find, (pq, pv, pa, _) = self._prescribed_motion(ONE)
        z = [read("w", W.AUDIT_Z + m) for m in range(len(s.memory))]
        state = State(*self._coordinates(W.AUDIT_Z, W.AUDIT_Q, W.AUDIT_V, (pq, pv)), z)
        state.u = ZERO if prescribed else self._condition("u")
        e = Elements(s.all_solved(), state)
        out = [*find, *e.energy()]
        for i, rate in zip(prescribed, pa, strict=True):
            out += self._holding_power(e, i, rate)
        found = {str(place[1]) for place in accumulated_places(out)} | ALWAYS
        out += [Assign(slot("w", place), value_of(text)) for text, place in LOSSES.items() if text in found]
        return Program(self._arguments("u"), out)

    @staticmethod
    def _holding_power(e: Elements, i: int, acceleration: Expression) -> list[Statement]:
        """Statements that add to ``given`` the power (W) of what prescribes coordinate ``i``, which has
        ``acceleration``."""
        mass = e.bodies.mass
        rows = {i} | {k for pair in mass if i in pair for k in pair}
        out = e.contactless_forces()
        for contact in map(e.contact, range(len(e.s.contact))):  # also those that push nothing that is solved for
            out += contact.forces() if rows & set(contact.ways) else []
        out += [line for tip in e.tips for line in tip.forces()]

        def entry(k: int) -> Expression:
            return mass.get((max(i, k), min(i, k)), ZERO)

        found = solve_mass_matrix(mass, {k: value_of(f"f{k}") - entry(k) * acceleration for k in rows if k != i})
        holds = total(entry(k) * a for k, a in (found | {i: acceleration}).items()) - value_of(f"f{i}")
        return [*out, Accumulate(variable("given"), holds * e.state.v[i])]


Matrix = dict[tuple[int, int], Expression]


def _invert_matrix(matrix: Matrix, rows: list[int]) -> tuple[Matrix, Expression]:
    """Inverse of a matrix, entries by (row, column) of ``rows``, by LU factors without exchanges, and the condition
    that these lose less than six digits.

    Its rows are sums that do not wait for each other, as steps of a substitution would.
    """
    n, place = len(rows), {row: k for k, row in enumerate(rows)}
    m = {(place[i], place[j]): e for (i, j), e in matrix.items()}
    small = {i: SOUND * abs(m[i, i]) for i in range(n)}
    pivots: list[Expression] = []
    sound: Expression | None = None
    for k in range(n):
        kept = abs(m[k, k]) > small[k]
        sound = kept if sound is None else sound & kept
        pivots.append(ONE / m[k, k])
        for i in range(k + 1, n):
            if (i, k) in m:
                m[i, k] = m[i, k] * pivots[k]
                for j in range(k + 1, n):
                    if (k, j) in m:
                        m[i, j] = m.get((i, j), ZERO) - m[i, k] * m[k, j]
    out: dict[tuple[int, int], Expression] = {}
    for column in range(n):
        x = [ONE if i == column else ZERO for i in range(n)]
        for i in range(n):
            x[i] = x[i] - total(m[i, j] * x[j] for j in range(i) if (i, j) in m)
        for i in reversed(range(n)):
            x[i] = (x[i] - total(m[i, j] * x[j] for j in range(i + 1, n) if (i, j) in m)) * pivots[i]
        out |= {(rows[i], rows[column]): e for i, e in enumerate(x) if e is not ZERO}
    assert sound is not None
    return out, sound


def _remembered_error(push: Expression, fade: Expression) -> Expression:
    """Error of a speed that one unit of a memory is worth: acceleration ``push`` while it lasts."""
    lasts = 1.0 / maximum(-fade, 1e-300)
    return push * where(lasts > LONGEST_MEMORY, LONGEST_MEMORY, lasts)
