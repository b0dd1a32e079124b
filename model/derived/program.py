"""A kernel before it is written: what it takes, what it does, what it returns."""

from __future__ import annotations

from dataclasses import dataclass

from model.compiler.expressions import Expression
from model.compiler.programs import Statement


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
