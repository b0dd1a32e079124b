"""A string of modes under the hammer, in place of the rigid bar.

y_n is the part of mode n in the string's way at the hammer, u_n its rate: dy/dt = u, du/dt = g F - c u - k y. In a
stage they follow the change dF of the contact's force, which follows the joints and the modes' sums: one scalar
equation. While the hammer is too far away to touch, the modes stay as they were at the time ``SINCE``, and are carried
on in closed form at once when it comes near. How many modes there are is a number in the parameter vector, so that one
compilation serves any. Derivation: docs/explanation/string_and_motor.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from model.compiler.expressions import (
    ONE,
    ZERO,
    Arguments,
    Expression,
    constant,
    cosine,
    differentiate_once,
    exponential,
    intern,
    maximum,
    read,
    root,
    sine,
    solve_by_newton,
    value_of,
    where,
)
from model.compiler.programs import (
    Accumulate,
    Assign,
    For,
    If,
    Place,
    Reload,
    Statement,
    loop_over,
    make_shared_integer,
    slot,
    variable,
)
from model.elements.contacts import Contact
from model.elements.laws.curve import Curve, curve_energy, loading_force
from model.elements.structure import Structure
from model.kernels import layout as L
from model.kernels import workspace as W

AWAKE = -1e300  # in place of a time; a state between two of these is below half of it
NEAR, FAR = 2e-5, 5e-5  # m beyond the string's reach: nearer, its modes are stepped; farther, they wait
LASTING = 1e-4  # s, for which an error of the string's place is taken to act on the hammer
NOT_A_NUMBER = float("nan")


class Modes:
    """Where the numbers and states of a string's modes are."""

    def __init__(self, s: Structure, array: str = "w", row: int = W.AUDIT_Z) -> None:
        self.array, self.row = array, row
        self._numbers, self.first = s.offset[7], s.first_of_string()
        self._count = read("p", self._numbers)
        self.count = make_shared_integer(self._count)

    def number(self, which: int, i: Expression) -> Expression:
        """Gain 1/kg, stiffness 1/s^2 or damping 1/s of mode ``i``."""
        return read("p", self._numbers + L.STRING_HEAD, self.half(which, i))

    @property
    def give(self) -> Expression:
        """Static compliance (m/N) of the modes left out."""
        return read("p", self._numbers + L.STRING_GIVE)

    def half(self, halves: int, i: Expression) -> Expression:
        """Offset of mode ``i``'s displacement (``halves`` 0) or rate (1) from the first mode's displacement."""
        return intern("whole_add", i, intern("whole_multiply", self.count, halves)) if halves else i

    def state(self, row: int, half: int, i: Expression) -> Expression:
        """Way (0) or rate (1) of mode ``i`` in a row of memories."""
        return read(self.array, row + self.first + L.STRING_STATES, self.half(half, i))

    def place(self, row: int, half: int, i: Expression) -> Place:
        return slot("w", row + self.first + L.STRING_STATES, self.half(half, i))

    def head(self, row: int, k: int) -> Place:
        """Where one of the two numbers before the states is."""
        return slot("w", row + self.first + k)

    def sums(self, row: int) -> list[Statement]:
        """Statements that set ``sway`` and ``swing`` to the string's displacement (m) and its rate (m/s), sums of the
        modes at ``row`` of the workspace."""
        return [
            Assign(variable("sway"), ZERO), Assign(variable("swing"), ZERO),
            loop_over(f"sum {row}", self.count, lambda i: [
                Accumulate(variable("sway"), self.state(row, 0, i)),
                Accumulate(variable("swing"), self.state(row, 1, i)),
            ]),
        ]  # fmt: skip

    def add_stored_energy(self, row: int, to: Place, sign: float = 1.0) -> For:
        """Loop that adds ``sign`` times the energy (J) of the modes at ``row`` of the workspace to ``to``."""

        def one(i: Expression) -> list[Statement]:
            y, u = self.state(row, 0, i), self.state(row, 1, i)
            energy = (u * u + self.number(1, i) * y * y) / (2.0 * self.number(0, i))
            return [Accumulate(to, sign * energy)]

        return loop_over(f"energy {row} {sign}", self.count, one)

    def reach(self) -> list[Statement]:
        """Statements that set `W.S_REACH` to a bound, m, that the free string's displacement towards the hammer never
        exceeds from now on: 1.1 times the sum of its modes' amplitudes, of the state at `W.Z`."""
        found = variable("reach")

        def one(i: Expression) -> list[Statement]:
            return [
                Accumulate(found, abs(self.state(W.Z, 0, i)) + abs(self.state(W.Z, 1, i)) / root(self.number(1, i)))
            ]

        return [
            Assign(found, ZERO),
            loop_over("reach", self.count, one),
            Assign(slot("w", W.S_REACH), 1.1 * value_of("reach")),  # a tenth more than the sum of its modes
        ]

    def rate(self, i: Expression, y: Expression, u: Expression, force: Expression) -> Expression:
        """Acceleration (m/s^2) of mode ``i`` at displacement ``y`` and rate ``u`` under a force (N)."""
        g, k, c = (self.number(n, i) for n in range(3))
        return g * force - c * u - k * y

    def free_vibration(self, i: Expression, time: Expression) -> tuple[Expression, Expression]:
        """Way and rate of a free mode after a time, s, in closed form."""
        k, sigma = self.number(1, i), 0.5 * self.number(2, i)
        omega = root(k - sigma * sigma)
        turned = exponential(maximum(-(sigma * time), -700.0)), cosine(omega * time), sine(omega * time) / omega
        return free_vibration(self.state(W.Z, 0, i), self.state(W.Z, 1, i), k, sigma, turned)

    def propagate(self, time: Expression) -> For:
        """Loop that lets the free modes vibrate for a time, s, in place."""

        def one(i: Expression) -> list[Statement]:
            y, u = self.free_vibration(i, time)
            return [
                Assign(variable("y"), y), Assign(variable("u"), u),
                Assign(self.place(W.Z, 0, i), value_of("y")), Assign(self.place(W.Z, 1, i), value_of("u")),
            ]  # fmt: skip

        return loop_over("carried on", self.count, one)


def free_vibration(y: Any, u: Any, stiffness: Any, sigma: Any, turned: tuple[Any, Any, Any]) -> tuple[Any, Any]:
    """Way and rate of a free mode from ``y`` and ``u``; of expressions, or of arrays.

    ``turned``: what is left of 1 at half the damping ``sigma``, cosine, sine over the angular frequency.
    """
    fade, c, s = turned
    return fade * (y * c + (u + sigma * y) * s), fade * (u * c - (sigma * u + stiffness * y) * s)


@differentiate_once
def string_contact_force(
    given: Arguments, give: Expression, curve: Curve, damping: Expression
) -> tuple[Expression, ...]:
    """Whether felt presses on a string at ``given`` (depth m, rate m/s), the force (N), and its part for a slow press
    (N); ``give`` (m/N): of the modes left out; ``curve``: a, b, c; ``damping``: s/m.

    Felt and these modes are springs in a row.
    """
    x, rate = given
    f = intern("argument", "slow force")
    slow = solve_by_newton(f, f - maximum(loading_force(maximum(x - give * f, 0.0), curve), 0.0), 0.0)
    factor = 1.0 + damping * rate
    return (slow > 0.0) & (factor > 0.0), slow * factor, slow


@dataclass
class StringContact(Contact):
    """The contact in which a string stands for the bar; the string's ``sway`` and ``swing`` are names set before."""

    states: tuple[str, int] = ("w", W.AUDIT_Z)
    """Array and row of memories in which a single state holds the modes."""

    @cached_property
    def modes(self) -> Modes:
        return Modes(self.s, *self.states)

    @cached_property
    def depth_and_rate(self) -> tuple[Expression, Expression]:
        """Depth of the hammer in the string and its rate; m, m/s."""
        return self.gap[0] - value_of("sway"), self.relative_speeds[0] - value_of("swing")

    @cached_property
    def touches(self) -> Expression:
        """Whether the hammer meets a string that is awake."""
        return (value_of("awake") > 0.0) & (self.depth_and_rate[0] > 0.0)

    @property
    def awake(self) -> Expression:
        """Whether the modes of a single state are stepped."""
        return read(self.modes.array, self.modes.row + self.modes.first + L.SINCE) < 0.5 * AWAKE

    def string_state(self) -> list[Statement]:
        """Way and rate of the string at a single state, where it is awake: sets ``sway``, ``swing``, ``awake``."""
        sums = self.modes.sums(self.modes.row)
        return [Assign(variable("awake"), where(self.awake, 1.0, 0.0)), If(self.awake, sums)]

    @cached_property
    def felt(self) -> tuple[Expression, Expression]:
        """Whether the felt presses, and its force, N."""
        pressing, force, _ = self._string_force
        return pressing, force

    @cached_property
    def _string_force(self) -> tuple[Expression, Expression, Expression]:
        pressing, force, slow = string_contact_force(
            self.depth_and_rate, self.modes.give, self.curve, self.number(L.DAMP)
        )
        return pressing, force, slow

    def forces(self) -> list[Statement]:
        """Statements that add the contact's normal force, no friction, to the generalised forces, and set ``on the
        string`` to it, N; not a number where it touches modes that rest."""
        pressing, force = self.felt
        # modes that wait know of no contact: a step that comes upon it is tried again, shorter
        force = where(value_of("awake") > 0.0, force, NOT_A_NUMBER)
        pushes = self.push(force, ZERO)
        return [
            Assign(variable("on the string"), ZERO),
            If(self.depth_and_rate[0] > 0.0, [
                If(pressing | (value_of("awake") <= 0.0), [
                    Assign(variable("on the string"), force),
                    *(Accumulate(variable(f"f{k}"), e) for k, e in pushes.items()),
                ]),
            ]),
        ]  # fmt: skip

    def energy(self, label: str = "") -> list[Statement]:
        """Statements that add stored energy (J) of felt and string, and their dissipated power (W), to variables whose
        names end with ``label``."""
        modes, row = self.modes, self.modes.row
        pressing, force, slow = self._string_force
        x = self.depth_and_rate[0] - modes.give * slow
        kept = 0.5 * modes.give * slow * slow + curve_energy(x, self.curve)

        def mode_loss(i: Expression) -> list[Statement]:
            u = modes.state(row, 1, i)
            return [Accumulate(variable("string" + label), modes.number(2, i) * u * u / modes.number(0, i))]

        touch: list[Statement] = [
            Accumulate(variable("energy" + label), kept),
            Accumulate(variable("felt" + label), (where(pressing, force, 0.0) - slow) * self.depth_and_rate[1]),
        ]
        inside = [loop_over("lost", modes.count, mode_loss), *modes.sums(row), If(self.depth_and_rate[0] > 0.0, touch)]
        return [modes.add_stored_energy(row, variable("energy" + label)), If(self.awake, inside)]

    # what a step does with the modes ------------------------------------------------------------------------------

    def begin_step(self) -> list[Statement]:
        """Statements that wake the modes where the hammer is near, or let them vibrate freely where it is far, at the
        start of a step; set ``sway`` (m), ``swing`` (m/s) and ``awake`` (1 or 0)."""
        m, x = self.modes, self.gap[0]
        since, first_time = read("w", W.Z + m.first + L.SINCE), read("w", W.S_COUNT) <= 0.0
        reach, now = read("w", W.S_REACH), read("w", W.NOW)

        def copy_mode(i: Expression) -> list[Statement]:
            return [Assign(slot("w", W.S_NUMBERS + W.MOST_MODES * k, i), m.number(k, i)) for k in range(3)]

        rows = [W.Z_WEIGHT, *(W.Z_U + W.MOST_MEMORIES * k for k in range(W.MAX_STAGES))]

        def leave_mode(i: Expression) -> list[Statement]:
            return [Assign(m.place(row, half, i), ZERO) for row in rows for half in (0, 1)]

        released = m.head(W.Z, L.RELEASED)
        return [
            Assign(variable("bar"), x), If((since < 0.5 * AWAKE) | first_time, m.reach()), Reload(),
            If(first_time, [loop_over("copied", m.count, copy_mode),
                            Assign(slot("w", W.S_COUNT), read("p", self.s.offset[7]))]),
            If((since < 0.5 * AWAKE) & (-value_of("bar") - reach > FAR), [
                Assign(m.head(W.Z, L.SINCE), now), loop_over("left", m.count, leave_mode),
                *(Assign(m.head(row, k), ZERO) for row in rows for k in range(L.STRING_STATES)),
            ]), Reload(),
            If((since >= 0.5 * AWAKE) & (-value_of("bar") - reach <= NEAR), [
                Assign(variable("before"), ZERO), m.add_stored_energy(W.Z, variable("before")),
                m.propagate(now - since),
                Assign(variable("after"), ZERO), m.add_stored_energy(W.Z, variable("after"), -1.0),
                Accumulate(released, value_of("before") + value_of("after")),
                Assign(m.head(W.Z, L.SINCE), constant(AWAKE)), *m.reach(),
            ]), Reload(),
            Assign(variable("awake"), where(since < 0.5 * AWAKE, 1.0, 0.0)), Assign(variable("sway"), -reach),
            Assign(variable("swing"), ZERO),
            If(since < 0.5 * AWAKE, m.sums(W.Z)), Assign(slot("w", W.S_AWAKE), value_of("awake")), Reload(),
        ]  # fmt: skip

    def set_error_weights(self, worth: Expression) -> list[Statement]:
        """Statements that set the modes' error weights (`W.Z_WEIGHT`) where the variable ``awake``, set before, is 1;
        ``worth``: acceleration of a coordinate per m of the string."""
        m = self.modes

        def one(i: Expression) -> list[Statement]:
            return [
                Assign(m.place(W.Z_WEIGHT, 0, i), worth * LASTING),
                Assign(m.place(W.Z_WEIGHT, 1, i), worth * LASTING / root(m.number(1, i))),
            ]

        return [If(value_of("awake") > 0.0, [loop_over("weighed", m.count, one)])]

    def prepare_modes(self, inverse_gh: Expression, gh: Expression) -> list[Statement]:
        """Statements that eliminate the modes from the stage equations and set ``share``, what remains of a change of
        force, 1 where they rest.

        ``gh`` is the method's gamma times the step, ``inverse_gh`` one over it.
        """

        def one(i: Expression) -> list[Statement]:
            k, c = (read("w", W.S_NUMBERS + W.MOST_MODES * n, i) for n in (1, 2))
            ease = 1.0 / (inverse_gh + c + gh * k)
            gain = read("w", W.S_NUMBERS, i)
            return [Assign(slot("w", W.S_EASE, i), ease), Accumulate(variable("give"), ease * gain)]

        steep = gh * read("w", W.S_HARD) + read("w", W.S_LOSSY)
        share = ONE / (1.0 + steep * value_of("give"))
        return [
            Assign(variable("share"), ONE),
            If(read("w", W.S_AWAKE) > 0.0, [
                Assign(variable("give"), ZERO), loop_over("eased", make_shared_integer(read("w", W.S_COUNT)), one),
                Assign(variable("share"), share),
                Assign(slot("w", W.S_SHARE), value_of("share")),
            ]),
        ]  # fmt: skip

    def stage_modes(self, stage: Expression, rate: Expression) -> list[Statement]:
        """Statements for the string's modes at a stage: set ``sway``, ``swing``, ``awake``."""
        m = self.modes

        def start_mode(i: Expression) -> list[Statement]:
            return [
                statement
                for half in (0, 1)
                for statement in (
                    Assign(slot("w", W.S_TURN, m.half(half, i)), m.state(W.Z, half, i)),
                    Assign(slot("w", W.S_COUPLED, m.half(half, i)), ZERO),
                )
            ]

        def add_stage(j: Expression) -> list[Statement]:
            a, c = (
                read(array, 0, intern("whole_add", j, intern("whole_multiply", stage, W.MAX_STAGES))) for array in "ac"
            )

            def add_mode(i: Expression) -> list[Statement]:
                out: list[Statement] = []
                for half in (0, 1):
                    behind = intern("whole_add", m.half(half, i), intern("whole_multiply", j, W.MOST_MEMORIES))
                    x = read("w", W.Z_U + m.first + L.STRING_STATES, behind)
                    out += [Accumulate(slot("w", W.S_TURN, m.half(half, i)), a * x)]
                    out += [Accumulate(slot("w", W.S_COUPLED, m.half(half, i)), c * rate * x)]
                return out

            return [loop_over("modes of a stage", m.count, add_mode)]

        def finish_mode(i: Expression) -> list[Statement]:
            return [
                Accumulate(variable("sway"), read("w", W.S_TURN, i)),
                Accumulate(variable("swing"), read("w", W.S_TURN, m.half(1, i)))
            ]  # fmt: skip

        awake = read("w", W.S_AWAKE)
        return [
            Assign(variable("awake"), awake), Assign(variable("sway"), -read("w", W.S_REACH)),
            Assign(variable("swing"), ZERO),
            If(awake > 0.0, [
                loop_over("begun", m.count, start_mode), loop_over("stages", stage, add_stage),
                Assign(variable("sway"), ZERO),
                loop_over("summed", m.count, finish_mode),
            ]),
        ]  # fmt: skip

    def known_sides(self, gh: Expression) -> list[Statement]:
        """Statements for the right-hand sides of the modes' stage equations under the contact's force, ``gh``: gamma
        times the step; set ``given``, the change of that force by them."""
        m = self.modes

        def one(i: Expression) -> list[Statement]:
            y, u = read("w", W.S_TURN, i), read("w", W.S_TURN, m.half(1, i))
            coupled, driven = read("w", W.S_COUPLED, i), read("w", W.S_COUPLED, m.half(1, i))
            way, rate = u + coupled, m.rate(i, y, u, value_of("on the string"))
            known = read("w", W.S_EASE, i) * (rate + driven - gh * m.number(1, i) * way)
            return [
                Assign(variable("way"), way), Assign(variable("known"), known),
                Assign(slot("w", W.S_COUPLED, i), value_of("way")),
                Assign(slot("w", W.S_BACK, i), value_of("known")), Accumulate(variable("ways"), value_of("way")),
                Accumulate(variable("rates"), value_of("known")),
            ]  # fmt: skip

        hard, lossy = read("w", W.S_HARD), read("w", W.S_LOSSY)
        given = gh * hard * (value_of("ways") + value_of("rates")) + lossy * value_of("rates")
        return [
            Assign(variable("ways"), ZERO), Assign(variable("rates"), ZERO), loop_over("known", m.count, one),
            Assign(variable("given"), given),
        ]  # fmt: skip

    def solve_modes(self, stage: Expression, more: Expression, gh: Expression) -> list[Statement]:
        """Statements that write the modes' part of ``stage``, from ``more``, the change of the contact's force, N, and
        ``gh``, gamma times the step."""
        m, behind = self.modes, intern("whole_multiply", stage, W.MOST_MEMORIES)

        def one(i: Expression) -> list[Statement]:
            u = read("w", W.S_BACK, i) + read("w", W.S_EASE, i) * m.number(0, i) * more
            way = gh * (read("w", W.S_COUPLED, i) + u)
            start = W.Z_U + m.first + L.STRING_STATES
            return [
                Assign(slot("w", start, intern("whole_add", m.half(1, i), behind)), u),
                Assign(slot("w", start, intern("whole_add", i, behind)), way),
            ]

        return [loop_over("stepped", m.count, one)]
