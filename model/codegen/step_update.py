"""Programs of a step beside forces: stage sums, error norm, dense output, fit of the step; for one run and for lanes.

Events (surfaces about to touch or part, friction about to turn) only ever shorten a step, and only where they would
cost more than the tolerance. Nothing here is contracted, so that the numbers are those of the text on every machine.
"""

from __future__ import annotations

from model.compiler.expressions import (
    ONE,
    ZERO,
    Expression,
    argument,
    constant,
    intern,
    maximum,
    minimum,
    read,
    root,
    value_of,
    where,
)
from model.compiler.programs import Accumulate, Assign, If, Place, Program, Statement, loop_over, slot, variable
from model.elements.structure import Structure
from model.kernels import layout as L
from model.kernels import workspace as W

# found with work and error of five blows at 13 tolerances: fewer rejections at no more work for the same error
LAYER = 4.0  # threshold speeds from zero at which friction begins to turn round
TURN = 3.0  # threshold speeds a step may turn where friction changes a speed within a threshold's time by the tolerance
LEAST_TURN = 0.8  # threshold speeds a step may turn always
KINK = 0.5  # share of the tolerance of a speed that a kink within a step may cost
INFINITE = constant(float("inf"))
STAGE = 2 * W.WIDTH


def _divide_exactly(a: Expression, b: Expression) -> Expression:
    return intern("quotient", a, b)


def _scale_counter(counter: Expression, count: int) -> Expression:
    return intern("whole_multiply", counter, count)


def _w(row: int, *further: Expression) -> Expression:
    return read("w", row, *further)


class StepUpdate:
    """Programs of these kernels for a structure; whole numbers that they take are ``stages``, ``rows`` and ``n_z``."""

    def __init__(self, s: Structure) -> None:
        self._s = s
        self._remembers = bool(s.memory or s.pin or s.string)
        # where angles and speeds are: in the state, in that at the end, in the stages, in a state inside the step
        self._states = [
            place
            for i in range(s.own)
            for place in ((W.Q + i, W.Q1 + i, i, W.AUDIT_Q + i), (W.V + i, W.V1 + i, W.WIDTH + i, W.AUDIT_V + i))
        ]

    # events -------------------------------------------------------------------------------------------------------

    def fit(self) -> Program:
        """Program of a workspace and numbers that shortens the step in ``w[FITTED]`` to where a surface touches or
        parts, or friction turns, within it; it returns nothing."""
        bound = _w(W.SPEED_LIMIT)

        def body(i: Expression) -> list[Statement]:
            speed, rate, law = _w(W.V, i), _w(W.ACC, i), read("p", L.GLOBALS + L.JF_A, _scale_counter(i, L.BODY_SIZE))
            per, step = read("p", L.OMEGA_T), value_of("step")
            turn = _fit_to_turn(
                step,
                _divide_exactly(speed, per),
                _divide_exactly(rate, per),
                _divide_exactly(law, _w(W.M_DIAG, i)),
                bound,
            )
            return [If(intern("differs", law, ZERO), [If(speed * rate < 0.0, turn)])]

        def contact(c: Expression) -> list[Statement]:
            step, until = value_of("step"), value_of("until")
            rate, slide = _w(W.GAP_RATE, c), _w(W.SLIDE_RATE, c)
            # the force's slope jumps there by stiffness times speed; the Jacobian at the start does not know it
            jump = _w(W.KICK, c) * abs(rate + until * _w(W.GAP_ACC, c))
            past = step - until
            shorter = until + root(_divide_exactly(constant(2.0 * KINK) * bound, jump))
            costly = 0.5 * jump * past * past > KINK * bound
            per, left, grip = read("p", L.V_T), value_of("left"), _w(W.GRIP, c)
            turn = _fit_to_turn(left, _divide_exactly(_w(W.SLIDE, c), per), _divide_exactly(slide, per), grip, bound)
            return [
                Assign(variable("left"), step), *_time_to_zero(c, step),
                If(until < step, [If(costly, [Assign(variable("left"), shorter)])]),
                Assign(variable("step"), left), If((slide * _w(W.SLIDE, c) < 0.0) & (grip > 0.0), turn),
            ]  # fmt: skip

        out: list[Statement] = [Assign(variable("step"), _w(W.FITTED))]
        out.append(loop_over("body", constant(float(self._s.own)), body))
        if self._s.place:
            out.append(loop_over("contact", constant(float(len(self._s.place))), contact))
        out.append(Assign(slot("w", W.FITTED), value_of("step")))
        return Program(dict.fromkeys("wp", "array"), out, exact=True)

    # the end of a step, and what is inside ------------------------------------------------------------------------

    def end(self) -> Program:
        """Program that sets the states at the end of the step and its error norm; returns whether that is finite."""
        stages = argument("stages")

        def add_stage(m: Expression) -> list[Statement]:
            share = read("b", 0, m)
            return [
                Accumulate(variable(f"end{u}"), share * _w(W.U + u, _scale_counter(m, STAGE)))
                for _, _, u, _ in self._states
            ]

        def memory(i: Expression) -> list[Statement]:
            ended = loop_over(
                "stage of a memory",
                stages,
                lambda m: [Accumulate(variable("kept"), read("b", 0, m) * _w(W.Z_U, _memory_offset(m, i)))],
            )
            wrong = _divide_exactly(
                abs(_w(W.Z_U, _memory_offset(_predecessor(stages), i))) * _w(W.Z_WEIGHT, i), _w(W.SPEED_LIMIT)
            )
            error = value_of("error")
            return [
                Assign(variable("kept"), _w(W.Z, i)), ended, Assign(slot("w", W.Z1, i), value_of("kept")),
                Assign(variable("error"), where(wrong <= error, error, wrong)),
            ]  # fmt: skip

        out: list[Statement] = [Assign(variable(f"end{u}"), _w(start)) for start, _, u, _ in self._states]
        out.append(loop_over("stage", stages, add_stage))
        out += [Assign(slot("w", end), value_of(f"end{u}")) for _, end, u, _ in self._states]
        last = [
            (u < W.WIDTH, abs(_w(W.U + u, _scale_counter(_predecessor(stages), STAGE)))) for _, _, u, _ in self._states
        ]
        finite = last[0][1] < INFINITE
        for _, size in last[1:]:
            finite = finite & (size < INFINITE)
        angle, speed = (maximum(ZERO, *(size for of, size in last if of == mine)) for mine in (True, False))
        error = maximum(_divide_exactly(angle, _w(W.ANGLE_LIMIT)), _divide_exactly(speed, _w(W.SPEED_LIMIT)))
        out.append(Assign(variable("error"), error))
        if self._remembers:
            out.append(loop_over("memory", argument("n_z"), memory))
        out.append(Assign(slot("w", W.ERROR), value_of("error")))
        given = {"w": "array", "b": "plain", "stages": "whole", "n_z": "whole"}
        return Program(given, out, finite & (value_of("error") < INFINITE), exact=True)

    def dense(self) -> Program:
        """Program that sums the stages, weighted by ``dense``, to the polynomial of the step in the workspace."""
        stages = argument("stages")

        def state_row(m: Expression) -> list[Statement]:
            def add_stage(j: Expression) -> list[Statement]:
                share = read("dense", 0, intern("whole_add", j, intern("whole_multiply", m, stages)))
                return [
                    Accumulate(variable(f"sum{u}"), share * _w(W.U + u, _scale_counter(j, STAGE)))
                    for _, _, u, _ in self._states
                ]

            sums = [u for _, _, u, _ in self._states]
            return [
                *(Assign(variable(f"sum{u}"), ZERO) for u in sums), loop_over("stage", stages, add_stage),
                *(Assign(slot("w", W.DENSE + u, _scale_counter(m, STAGE)), value_of(f"sum{u}")) for u in sums),
            ]  # fmt: skip

        def memory_rows(i: Expression) -> list[Statement]:
            def memory_row(m: Expression) -> list[Statement]:
                def add_stage(j: Expression) -> list[Statement]:
                    share = read("dense", 0, intern("whole_add", j, intern("whole_multiply", m, stages)))
                    return [Accumulate(variable("part"), share * _w(W.Z_U, _memory_offset(j, i)))]

                summed = loop_over("stage of a memory", stages, add_stage)
                return [
                    Assign(variable("part"), ZERO),
                    summed,
                    Assign(slot("w", W.Z_DENSE, _memory_offset(m, i)), value_of("part")),
                ]

            return [loop_over("row of a memory", argument("rows"), memory_row)]

        given = {"w": "array", "dense": "plain", "rows": "whole", "stages": "whole", "n_z": "whole"}
        out: list[Statement] = [loop_over("row", argument("rows"), state_row)]
        if self._remembers:
            out.append(loop_over("memory", argument("n_z"), memory_rows))
        return Program(given, out, exact=True)

    def interpolate(self) -> Program:
        """Program of the state at the fraction `W.FRACTION` of the step, from the polynomial of ``dense``."""
        x, rows = _w(W.FRACTION), argument("rows")

        def reversed_row(m: Expression) -> Expression:
            return intern("whole_add", _predecessor(rows), _scale_counter(m, -1))

        def state_row(m: Expression) -> list[Statement]:
            at_row = _scale_counter(reversed_row(m), STAGE)
            return [
                Assign(variable(f"sum{u}"), _w(W.DENSE + u, at_row) + x * value_of(f"sum{u}"))
                for _, _, u, _ in self._states
            ]

        def memory(i: Expression) -> list[Statement]:
            def memory_row(m: Expression) -> list[Statement]:
                return [
                    Assign(variable("inner"), _w(W.Z_DENSE, _memory_offset(reversed_row(m), i)) + x * value_of("inner"))
                ]

            between = _interpolate(x, _w(W.Z, i), _w(W.Z1, i), value_of("inner"))
            return [
                Assign(variable("inner"), ZERO), loop_over("row of a memory", rows, memory_row),
                Assign(slot("w", W.AUDIT_Z, i), between),
            ]  # fmt: skip

        out: list[Statement] = [Assign(variable(f"sum{u}"), ZERO) for _, _, u, _ in self._states]
        out.append(loop_over("row", rows, state_row))
        for start, end, u, to in self._states:
            out.append(Assign(slot("w", to), _interpolate(x, _w(start), _w(end), value_of(f"sum{u}"))))
        if self._remembers:
            out.append(loop_over("memory", argument("n_z"), memory))
        return Program({"w": "array", "rows": "whole", "n_z": "whole"}, out, exact=True)


def _predecessor(count: Expression) -> Expression:
    return intern("whole_add", count, -1)


def _memory_offset(row: Expression, memory: Expression) -> Expression:
    """Where a stage, or a row of sums over them, of a memory is behind the first of the first."""
    return intern("whole_add", memory, _scale_counter(row, W.MOST_MEMORIES))


def _interpolate(x: Expression, start: Expression, end: Expression, inner: Expression) -> Expression:
    y = ONE - x
    return y * start + x * (end + y * inner)


def _time_to_zero(c: Expression, latest: Expression) -> list[Statement]:
    """Statements that set ``until``: first time in (0, ``latest``) at which the gap of contact ``c``, g + r t + a t^2 /
    2, changes sign; ``latest`` where there is none."""
    gap = _w(W.GAP, c)
    below = gap < 0.0
    x, rate, acc = (where(below, -y, y) for y in (gap, _w(W.GAP_RATE, c), _w(W.GAP_ACC, c)))
    clear = x + latest * (minimum(rate, 0.0) + 0.5 * latest * minimum(acc, 0.0)) > 0.0
    square = rate * rate - 2.0 * acc * x
    down = root(square) - rate
    found = [Assign(variable("until"), minimum(latest, _divide_exactly(2.0 * x, down)))]
    return [Assign(variable("until"), latest), If(~clear, [If(square > 0.0, [If(down > 0.0, list(found))])])]


def _fit_to_turn(
    step: Expression, z: Expression, rate: Expression, strength: Expression, bound: Expression
) -> list[Statement]:
    """Statements that shorten ``step`` for friction whose scaled speed ``z`` runs through zero at ``rate`` (1/s).

    Outside the layer |z| < LAYER the step ends at its edge; inside, a step turns z by no more than the ``bound`` of a
    speed's error bears: ``strength`` is the acceleration that friction gives (rad/s^2).
    """
    to: Place = variable("step")
    pace, left = abs(rate), abs(z) - LAYER
    edge = _divide_exactly(left, pace)
    slow = _divide_exactly(maximum(LEAST_TURN, TURN * root(root(_divide_exactly(bound * pace, strength)))), pace)
    ends = If((left < step * pace) & (strength * (step - edge) > bound), [Assign(to, edge)])
    # threshold speeds: nearer, the kink is as good as reached
    return [If(left > 0.01, [ends], [Assign(to, minimum(step, slow))])]
