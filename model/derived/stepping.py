"""What a step loop does with the numbers of a step beside forces, the same text for one run and for lanes.

``fit``: the step in ``FITTED``, shortened to the first event that it cannot cross: surfaces about to touch or part,
friction about to turn. A step that ends just after a kink of the forces, or just before friction turns round, is rarely
rejected; one that runs across is nearly always. Each event counts only where it would cost more than the tolerance. All
estimates are of second order at most and only ever shorten a step.
``end``: the state at the end of the step from its stages, and what the last stage, the estimate of its error, is of the
tolerances. ``dense``: sums over the stages that states inside the step are made of. ``inside``: state at ``FRACTION``.
Nothing here is contracted, so that the numbers are those of the text on every machine.
"""

from __future__ import annotations

from model.compiler.expressions import (
    ONE,
    ZERO,
    Expression,
    argument,
    constant,
    largest,
    local,
    make,
    read,
    root,
    smaller,
    where,
)
from model.compiler.programs import Add, If, Place, Program, Put, Statement, at, each, name
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


def _over(a: Expression, b: Expression) -> Expression:
    """A quotient, rounded once."""
    return make("quotient", a, b)


def _times(counter: Expression, count: int) -> Expression:
    return make("whole_multiply", counter, count)


def _w(row: int, *further: Expression) -> Expression:
    return read("w", row, *further)


class Stepping:
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
        """See the module."""
        bound = _w(W.SPEED_LIMIT)

        def body(i: Expression) -> list[Statement]:
            speed, rate, law = _w(W.V, i), _w(W.ACC, i), read("p", L.GLOBALS + L.JF_A, _times(i, L.BODY_SIZE))
            per, step = read("p", L.OMEGA_T), local("step")
            turn = _fit_to_turn(step, _over(speed, per), _over(rate, per), _over(law, _w(W.M_DIAG, i)), bound)
            return [If(make("differs", law, ZERO), [If(speed * rate < 0.0, turn)])]

        def contact(c: Expression) -> list[Statement]:
            step, until = local("step"), local("until")
            rate, slide = _w(W.GAP_RATE, c), _w(W.SLIDE_RATE, c)
            # the force's slope jumps there by stiffness times speed; the Jacobian at the start does not know it
            jump = _w(W.KICK, c) * abs(rate + until * _w(W.GAP_ACC, c))
            past = step - until
            shorter = until + root(_over(constant(2.0 * KINK) * bound, jump))
            costly = 0.5 * jump * past * past > KINK * bound
            per, left, grip = read("p", L.V_T), local("left"), _w(W.GRIP, c)
            turn = _fit_to_turn(left, _over(_w(W.SLIDE, c), per), _over(slide, per), grip, bound)
            return [
                Put(name("left"), step), *_time_to_zero(c, step),
                If(until < step, [If(costly, [Put(name("left"), shorter)])]),
                Put(name("step"), left), If((slide * _w(W.SLIDE, c) < 0.0) & (grip > 0.0), turn),
            ]  # fmt: skip

        out: list[Statement] = [Put(name("step"), _w(W.FITTED))]
        out.append(each("body", constant(float(self._s.own)), body))
        if self._s.place:
            out.append(each("contact", constant(float(len(self._s.place))), contact))
        out.append(Put(at("w", W.FITTED), local("step")))
        return Program(dict.fromkeys("wp", "array"), out, exact=True)

    # the end of a step, and what is inside ------------------------------------------------------------------------

    def end(self) -> Program:
        """See the module; returns whether the estimate is finite."""
        stages = argument("stages")

        def of_stage(m: Expression) -> list[Statement]:
            share = read("b", 0, m)
            return [Add(name(f"end{u}"), share * _w(W.U + u, _times(m, STAGE))) for _, _, u, _ in self._states]

        def memory(i: Expression) -> list[Statement]:
            ended = each(
                "stage of a memory", stages, lambda m: [Add(name("kept"), read("b", 0, m) * _w(W.Z_U, _of(m, i)))]
            )
            wrong = _over(abs(_w(W.Z_U, _of(_before(stages), i))) * _w(W.Z_WEIGHT, i), _w(W.SPEED_LIMIT))
            error = local("error")
            return [
                Put(name("kept"), _w(W.Z, i)), ended, Put(at("w", W.Z1, i), local("kept")),
                Put(name("error"), where(wrong <= error, error, wrong)),
            ]  # fmt: skip

        out: list[Statement] = [Put(name(f"end{u}"), _w(start)) for start, _, u, _ in self._states]
        out.append(each("stage", stages, of_stage))
        out += [Put(at("w", end), local(f"end{u}")) for _, end, u, _ in self._states]
        last = [(u < W.WIDTH, abs(_w(W.U + u, _times(_before(stages), STAGE)))) for _, _, u, _ in self._states]
        finite = last[0][1] < INFINITE
        for _, size in last[1:]:
            finite = finite & (size < INFINITE)
        angle, speed = (largest(ZERO, *(size for of, size in last if of == mine)) for mine in (True, False))
        error = largest(_over(angle, _w(W.ANGLE_LIMIT)), _over(speed, _w(W.SPEED_LIMIT)))
        out.append(Put(name("error"), error))
        if self._remembers:
            out.append(each("memory", argument("n_z"), memory))
        out.append(Put(at("w", W.ERROR), local("error")))
        given = {"w": "array", "b": "plain", "stages": "whole", "n_z": "whole"}
        return Program(given, out, finite & (local("error") < INFINITE), exact=True)

    def dense(self) -> Program:
        """See the module."""
        stages = argument("stages")

        def of_row(m: Expression) -> list[Statement]:
            def of_stage(j: Expression) -> list[Statement]:
                share = read("dense", 0, make("whole_add", j, make("whole_multiply", m, stages)))
                return [Add(name(f"sum{u}"), share * _w(W.U + u, _times(j, STAGE))) for _, _, u, _ in self._states]

            sums = [u for _, _, u, _ in self._states]
            return [
                *(Put(name(f"sum{u}"), ZERO) for u in sums), each("stage", stages, of_stage),
                *(Put(at("w", W.DENSE + u, _times(m, STAGE)), local(f"sum{u}")) for u in sums),
            ]  # fmt: skip

        def of_memory(i: Expression) -> list[Statement]:
            def of_row_of(m: Expression) -> list[Statement]:
                def of_stage(j: Expression) -> list[Statement]:
                    share = read("dense", 0, make("whole_add", j, make("whole_multiply", m, stages)))
                    return [Add(name("part"), share * _w(W.Z_U, _of(j, i)))]

                summed = each("stage of a memory", stages, of_stage)
                return [Put(name("part"), ZERO), summed, Put(at("w", W.Z_DENSE, _of(m, i)), local("part"))]

            return [each("row of a memory", argument("rows"), of_row_of)]

        given = {"w": "array", "dense": "plain", "rows": "whole", "stages": "whole", "n_z": "whole"}
        out: list[Statement] = [each("row", argument("rows"), of_row)]
        if self._remembers:
            out.append(each("memory", argument("n_z"), of_memory))
        return Program(given, out, exact=True)

    def inside(self) -> Program:
        """See the module."""
        x, rows = _w(W.FRACTION), argument("rows")

        def back(m: Expression) -> Expression:
            return make("whole_add", _before(rows), _times(m, -1))

        def of_row(m: Expression) -> list[Statement]:
            at_row = _times(back(m), STAGE)
            return [Put(name(f"sum{u}"), _w(W.DENSE + u, at_row) + x * local(f"sum{u}")) for _, _, u, _ in self._states]

        def memory(i: Expression) -> list[Statement]:
            def of_row_of(m: Expression) -> list[Statement]:
                return [Put(name("inner"), _w(W.Z_DENSE, _of(back(m), i)) + x * local("inner"))]

            between = _between(x, _w(W.Z, i), _w(W.Z1, i), local("inner"))
            return [
                Put(name("inner"), ZERO), each("row of a memory", rows, of_row_of), Put(at("w", W.AUDIT_Z, i), between),
            ]  # fmt: skip

        out: list[Statement] = [Put(name(f"sum{u}"), ZERO) for _, _, u, _ in self._states]
        out.append(each("row", rows, of_row))
        for start, end, u, to in self._states:
            out.append(Put(at("w", to), _between(x, _w(start), _w(end), local(f"sum{u}"))))
        if self._remembers:
            out.append(each("memory", argument("n_z"), memory))
        return Program({"w": "array", "rows": "whole", "n_z": "whole"}, out, exact=True)


def _before(count: Expression) -> Expression:
    return make("whole_add", count, -1)


def _of(row: Expression, memory: Expression) -> Expression:
    """Where a stage, or a row of sums over them, of a memory is behind the first of the first."""
    return make("whole_add", memory, _times(row, W.MOST_MEMORIES))


def _between(x: Expression, start: Expression, end: Expression, inner: Expression) -> Expression:
    y = ONE - x
    return y * start + x * (end + y * inner)


def _time_to_zero(c: Expression, most: Expression) -> list[Statement]:
    """``until``: first time in (0, most) at which a gap g + r t + a t^2 / 2 changes sign; most where there is none."""
    gap = _w(W.GAP, c)
    below = gap < 0.0
    x, rate, acc = (where(below, -y, y) for y in (gap, _w(W.GAP_RATE, c), _w(W.GAP_ACC, c)))
    clear = x + most * (smaller(rate, 0.0) + 0.5 * most * smaller(acc, 0.0)) > 0.0
    square = rate * rate - 2.0 * acc * x
    down = root(square) - rate
    found = [Put(name("until"), smaller(most, _over(2.0 * x, down)))]
    return [Put(name("until"), most), If(~clear, [If(square > 0.0, [If(down > 0.0, list(found))])])]


def _fit_to_turn(
    step: Expression, z: Expression, rate: Expression, strength: Expression, bound: Expression
) -> list[Statement]:
    """Shorten ``step`` for friction whose scaled speed z runs through zero at ``rate`` (1/s): they have unlike signs.

    Outside the layer |z| < LAYER the step ends at its edge; inside, a step turns z by no more than the ``bound`` of a
    speed's error bears: ``strength`` is the acceleration that friction gives (rad/s^2).
    """
    to: Place = name("step")
    pace, left = abs(rate), abs(z) - LAYER
    edge = _over(left, pace)
    slow = _over(largest(LEAST_TURN, TURN * root(root(_over(bound * pace, strength)))), pace)
    ends = If((left < step * pace) & (strength * (step - edge) > bound), [Put(to, edge)])
    return [If(left > 0.01, [ends], [Put(to, smaller(step, slow))])]
