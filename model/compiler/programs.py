"""Programs of a kernel: assignments, branches and loops over symbolic expressions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from model.compiler.expressions import Expression, as_expression, intern

Place = tuple[str, int | str, Expression | None]
"""Array, or ``local``; place in it, or a name; a whole number behind that, or None."""


@dataclass(frozen=True)
class Assign:
    """Statement that stores a value at a place."""

    place: Place
    value: Expression


@dataclass(frozen=True)
class Accumulate:
    """Statement that adds a value to what a place holds."""

    place: Place
    value: Expression


@dataclass(frozen=True)
class Compute:
    """Compute numbers here, for all blocks behind; ``alike`` ones side by side in a vector where the processor can."""

    values: tuple[Expression, ...]
    alike: bool = False


@dataclass(frozen=True)
class If:
    condition: Expression
    then: list[Statement]
    otherwise: list[Statement] = field(default_factory=list)


@dataclass(frozen=True)
class While:
    """Do it again for as long as the condition, computed anew, holds."""

    condition: Expression
    body: list[Statement]


@dataclass(frozen=True)
class For:
    """Do it for each ``counter`` from 0 to ``count`` - 1."""

    counter: Expression
    count: Expression
    body: list[Statement]


@dataclass(frozen=True)
class Reload:
    """Statement after which places are read anew, since they may have changed."""


@dataclass(frozen=True)
class ClearMask:
    """Where the condition holds, all blocks that a mask would leave out (`is_unmasked`) are done after all."""

    condition: Expression


Statement = ClearMask | Assign | Accumulate | Compute | If | While | For | Reload


@dataclass(frozen=True)
class Program:
    """A kernel: its arguments by kind, statements, and what it returns.

    ``result`` is None for 0, a truth value, conditions that clear their bit of a mask, a name that holds a count, or
    ``"exceeded"``: whether contacts were reconsidered. ``exact``: no product is rounded with the sum it stands in.
    """

    arguments: dict[str, str]
    statements: list[Statement]
    result: Expression | list[tuple[int, Expression]] | str | None = None
    exact: bool = False


def slot(array: str, place: int, further: Expression | None = None) -> Place:
    return array, place, further


def variable(text: str) -> Place:
    """A name of the program; it holds 0 until something is put to it."""
    return "local", text, None


def compute(*values: Expression) -> Compute:
    return Compute(values)


def compute_vectorised(*values: Expression) -> Compute:
    return Compute(values, True)


def loop_over(label: str, count: Expression, body: Callable[[Expression], list[Statement]]) -> For:
    """Statement that runs ``body(counter)`` ``count`` times; ``label`` makes the counter's name unique."""
    counter = intern("counter", label)
    return For(counter, count, body(counter))


def is_unmasked(bit: int) -> Expression:
    return intern("bit", bit)


def make_shared_integer(e: Expression) -> Expression:
    """Integer expression, as an offset of `read`; all lanes use the first lane's value."""
    return intern("whole", as_expression(e))


def make_lane_integer(e: Expression) -> Expression:
    """Integer expression that differs by lane; `read` gathers at it."""
    return intern("whole_per_lane", as_expression(e))


def map_assignments(
    statements: list[Statement], replacement: Callable[[Assign | Accumulate], list[Statement]]
) -> list[Statement]:
    """Copy with each Assign or Accumulate replaced by ``replacement`` of it; an If that is left empty is dropped."""
    out: list[Statement] = []
    for s in statements:
        if isinstance(s, Assign | Accumulate):
            out += replacement(s)
        elif isinstance(s, If):
            then, otherwise = map_assignments(s.then, replacement), map_assignments(s.otherwise, replacement)
            if then or otherwise:
                out.append(If(s.condition, then, otherwise))
        elif isinstance(s, For):
            out.append(For(s.counter, s.count, map_assignments(s.body, replacement)))
        elif isinstance(s, While):
            out.append(While(s.condition, map_assignments(s.body, replacement)))
        else:
            out.append(s)
    return out


def accumulated_places(statements: list[Statement]) -> list[Place]:
    """Places that the statements, or blocks within them, add to, in order and with repeats."""
    out: list[Place] = []

    def one(s: Assign | Accumulate) -> list[Statement]:
        out.extend([s.place] if isinstance(s, Accumulate) else [])
        return [s]

    map_assignments(statements, one)
    return out
