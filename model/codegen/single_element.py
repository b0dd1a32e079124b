"""Programs of single elements outside a scene: an amplifier, felt along a prescribed press.

Each is a kernel of four arrays, like those of `model.codegen.observable_programs`: what the law is differentiated by,
one that is not read, its numbers, what is found."""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import Any

from model.compiler.expressions import (
    ONE,
    ZERO,
    Expression,
    as_expression,
    differentiator,
    exponential,
    intern,
    maximum,
    minimum,
    read,
    subexpressions,
    substitute,
    total,
    value_of,
    where,
)
from model.compiler.programs import (
    Assign,
    If,
    Program,
    Reload,
    Statement,
    While,
    compute,
    make_shared_integer,
    slot,
    variable,
)
from model.elements.drives import amplifier
from model.elements.laws.curve import Power
from model.elements.laws.felt_law import Felt
from model.elements.laws.known import law_numbered

PRESS_NUMBERS = 5  # of `Alone.press` before those of its law
GAUSS = ((0.1127016653792583, 5.0 / 18.0), (0.5, 4.0 / 9.0), (0.8872983346207417, 5.0 / 18.0))
HALVINGS = 60.0  # of an interval in search of the instant the surfaces part or meet: to the last bit
MOST_TURNS = 8.0  # of the regime within an interval
DEPTH = value_of("depth of the felt")  # a place to put one, m
SHALLOWEST = 1e-15  # m: at the depth 0 a memory that fades along the way has no length


def _append_partials(found: Expression, by: tuple[Expression, ...]) -> list[Statement]:
    return [Assign(slot("y", k), x) for k, x in enumerate((found, *(differentiator({x: ONE})(found) for x in by)))]


class SingleElement:
    """Programs of these kernels.

    A press is of felt of the law ``number`` that has so many ``memories`` and ``numbers``, on a ``power`` or a cubic.
    """

    def __init__(self, number: int = 0, memories: int = 0, numbers: int = 0, power: int = 0) -> None:
        self._law, self._z = law_numbered(number), tuple(value_of(f"memory{j}") for j in range(memories))
        curve = [read("p", 1 + k) for k in range(3)]
        self._curve: Any = Power(*curve[:2]) if power else tuple(curve)
        self._numbers = tuple(read("p", PRESS_NUMBERS + k) for k in range(numbers))

    def _program(self, statements: list[Statement]) -> Program:
        return Program(dict.fromkeys("xupy", "array"), statements)

    def amplifier(self) -> Program:
        """Voltage (V) at a source (V) and a current (A), derivative by that; numbers of `elements.drives.amplifier`."""
        u, current = (read("x", k) for k in range(2))
        volts = amplifier((u, current), *(read("p", k) for k in range(5)))
        return self._program(_append_partials(volts, (current,)))

    # felt along a press ----------------------------------------------------------------------------------------------

    def press(self) -> Program:
        """Program of force (N) and stored energy (J), (n, 2), at rows (n, 3) of time (s), depth (m) and its rate (m/s).

        Numbers: n; a, b, c, or height and exponent of a power and 0; D; those of the law. Memories start as at a first
        touch and go from sample to sample in closed form: the value at which one would stay runs straight along its
        fading, and how fast it fades is summed along a depth that runs straight. Both are exact for one that follows
        the slow curve where that runs straight, and for one that follows the way. Where surfaces part or meet, or
        something else that the law decides by turns, an interval is divided.
        """
        row = make_shared_integer(value_of("row"))
        t, x, rate = (read("x", k, intern("whole_multiply", row, 3)) for k in range(3))
        lasting = bool(self._z) and self._law.anew is None
        touching, felt = self._touching(x, rate, self._z), self._felt(x, rate, self._z)
        asked_of = self._felt(maximum(x, 0.0), rate, self._z) if lasting else felt
        before, stored, _ = self._law.energy(asked_of, "pressed")
        force, energy = (slot("y", k, intern("whole_multiply", row, 2)) for k in range(2))
        keeps: list[Statement] = [*before, Assign(energy, stored)]
        start = as_expression(0.0 if self._law.anew is None else self._law.anew)
        onward: list[Statement] = [If(value_of("row") > 0.0, self._advance_memories(t, x)), Reload()] if self._z else []
        return self._program([
            *(Assign(variable(z.args[1]), start) for z in self._z),
            While(value_of("row") < read("p", 0), [
                *onward,
                Assign(force, ZERO), Assign(energy, ZERO), If(touching, [Assign(force, self._law.force(felt)[1])]),
                *(keeps if lasting else [If(x > 0.0, keeps)]),
                Assign(variable("time"), t), Assign(variable("depth"), x),
                Assign(variable("row"), value_of("row") + 1.0),
            ]),
        ])  # fmt: skip

    def _felt(self, x: Expression, rate: Expression, z: tuple[Expression, ...]) -> Felt:
        return Felt(x, rate, z, self._curve, read("p", PRESS_NUMBERS - 1), self._numbers)

    def _touching(self, x: Expression, rate: Expression, z: tuple[Expression, ...]) -> Expression:
        return (x > 0.0) & self._law.force(self._felt(x, rate, z))[0]

    def _advance_memories(self, t: Expression, x: Expression) -> list[Statement]:
        """Statements that carry the internal variables on from the sample before to time ``t`` and depth ``x``, regime
        after regime.

        The regime is whether surfaces press, and what else the law decides by: within it rates are smooth.
        """
        to, turns, low, high, left = (value_of(k) for k in ("to", "turns", "low", "high", "left"))
        rate, there = (x - value_of("depth")) / (t - value_of("time")), value_of("depth") + to * (x - value_of("depth"))
        tried = tuple(value_of(f"tried {k}") for k in range(len(self._z)))
        moves, holds = self._memory_rates(rate)
        flags = [variable(f"holds {k}") for k in range(len(holds))]

        def regime_bits(x: Expression, z: tuple[Expression, ...]) -> list[Expression]:
            by = {DEPTH: x, **dict(zip(self._z, z, strict=True))}
            return [where(substitute(one, by), 1.0, 0.0) for one in holds]

        ends = [self._decayed_memory(z, move, t, x) for z, move in zip(self._z, moves, strict=True)]
        differs = [
            intern("differs", now, value_of(str(of[1])))
            for now, of in zip(regime_bits(there, tried), flags, strict=True)
        ]
        turned = reduce(or_, differs) & (turns > 1.0)
        nearer = where(turned, low, to), where(turned, to, high)
        more = where(turned | (to < 1.0), left - 1.0, 0.0)
        next_to = where(more > 1.0, 0.5 * (nearer[0] + nearer[1]), where(more > 0.0, nearer[1], to))
        return [
            Assign(variable("begun"), ZERO), Assign(variable("turns"), as_expression(MOST_TURNS)),
            *(Assign(of, now) for of, now in zip(flags, regime_bits(value_of("depth"), self._z), strict=True)),
            While(turns > 0.0, [
                Assign(variable("low"), value_of("begun")), Assign(variable("high"), ONE), Assign(variable("to"), ONE),
                Assign(variable("left"), as_expression(HALVINGS)),
                While(left > 0.0, [
                    *(Assign(variable(z.args[1]), end) for z, end in zip(tried, ends, strict=True)),
                    compute(*nearer, more, next_to), Assign(variable("low"), nearer[0]),
                    Assign(variable("high"), nearer[1]),
                    Assign(variable("left"), more), Assign(variable("to"), next_to),
                ]), Reload(),
                *(Assign(variable(z.args[1]), end) for z, end in zip(self._z, tried, strict=True)),
                Assign(variable("begun"), to),
                *(Assign(of, now) for of, now in zip(flags, regime_bits(there, tried), strict=True)),
                Assign(variable("turns"), where(to < 1.0, turns - 1.0, 0.0)),
            ]),
        ]  # fmt: skip

    def _memory_rates(self, rate: Expression) -> tuple[list[Expression], list[Expression]]:
        """Rates of the internal variables at `DEPTH`, which changes at ``rate``, m/s, each selected by conditions, and
        these conditions: first whether surfaces press."""
        pressed, free = (self._felt(x, rate, self._z) for x in (maximum(DEPTH, SHALLOWEST), DEPTH))
        both = [*self._law.rates(pressed), *self._law.recovery_rates(free)]
        turning = {DEPTH, *self._z}
        decides = {
            one.args[0] for one in subexpressions(both) if one.op == "where" and turning & subexpressions(one.args[:1])
        }
        holds = [self._touching(DEPTH, rate, self._z), *sorted(decides, key=lambda one: one.order)]
        named = {one: value_of(f"holds {k}") > 0.0 for k, one in enumerate(holds) if k}
        count = len(self._z)
        rates = [substitute(one, named) for one in both]
        return [
            where(value_of("holds 0") > 0.0, *pair) for pair in zip(rates[:count], rates[count:], strict=True)
        ], holds

    def _decayed_memory(self, z: Expression, rate: Expression, t: Expression, x: Expression) -> Expression:
        """Internal variable ``z`` at the share ``to`` of an interval that ends at ``t`` and ``x``, from its value at
        ``begun``, within one regime of its ``rate``."""
        begun, to = value_of("begun"), value_of("to")
        lasts, way = (to - begun) * (t - value_of("time")), x - value_of("depth")
        fades = -differentiator({z: ONE})(rate)

        def memory_rate(share: Expression, where_z: Expression) -> tuple[Expression, Expression]:
            by = {DEPTH: value_of("depth") + share * way, z: where_z}
            return substitute(rate + fades * z, by), substitute(fades, by)

        def memory_after(where_z: Expression) -> Expression:
            (pull0, fades0), (pull1, fades1) = memory_rate(begun, where_z), memory_rate(to, where_z)
            inside = total(w * memory_rate(begun + g * (to - begun), where_z)[1] for g, w in GAUSS)
            gone_by = minimum(maximum(lasts * inside, -700.0), 700.0)
            kept, small = exponential(-gone_by), abs(gone_by) < 0.01  # the series is exact there to 1e-12
            series = 1.0 - gone_by / 2.0 * (1.0 - gone_by / 3.0 * (1.0 - gone_by / 4.0 * (1.0 - gone_by / 5.0)))
            mean = where(small, series, (1.0 - kept) / where(small, 1.0, gone_by))
            steady = (fades0 > 0.0) & (fades1 > 0.0)
            first, last = pull0 / where(steady, fades0, 1.0), pull1 / where(steady, fades1, 1.0)
            onward = z * kept + 0.5 * lasts * (pull0 + pull1) * mean
            return where(steady, last + (z - first) * kept - (last - first) * mean, onward)

        end = memory_after(z)
        if z in subexpressions([fades]):  # how fast it fades hangs on itself: as in the middle of its way
            end = memory_after(0.5 * (z + end))
        return end if self._law.anew is None else where(value_of("holds 0") > 0.0, end, self._law.anew)
