"""Base class of a constitutive law of felt: parameters, force, rates of internal variables, energy."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

from model.compiler.expressions import ZERO, Arguments, Expression, constant, differentiate_once, where
from model.compiler.programs import Statement
from model.elements.laws.curve import Curve
from model.errors import InputError

PULL_N = 1e-6
"""Below zero this is more than rounding leaves of forces to some 1e9 N."""


class Number(NamedTuple):
    """A parameter that a law adds to each contact: usual value, unit, standard uncertainty, allowed range, source."""

    value: float
    unit: str
    u: float
    low: float
    high: float
    source: str


@dataclass(frozen=True)
class Felt:
    """A felt under load, as a law sees it."""

    # depth, rate: m, positive where the surfaces meet, and m/s
    depth: Expression
    rate: Expression
    memory: tuple[Expression, ...]  # what it remembers
    curve: Curve  # a, b, c of its slow loading curve
    damping: Expression  # ``normal.D`` of the contact, s/m; 0 unless the law is `damped`
    numbers: tuple[Expression, ...]  # what the law has `pack_numbers`


class Law:
    name: ClassVar[str]  # as ``contact02.law`` takes it; lower case
    numbers: ClassVar[Mapping[str, Number]] = {}  # parameters by name; a contact's paths are ``contact02.<law>.<name>``
    damped: ClassVar[bool] = False  # whether ``normal.D`` is a parameter of it; otherwise its felt has D = 0
    # value that memories have at the next touch, whatever was before; None where they go on by `recovery_rates`
    anew: ClassVar[float | None] = None
    added = False
    """Whether a program has added it: then its force is watched, which may not go below zero."""
    number: int
    """By which a scene's tables name it; set when it is listed or added."""
    jump: str = ""
    """Where its force or a rate jumps, as found when it was added; empty where they are continuous."""

    def __init__(self) -> None:
        """Stamp it with its name; that of an added law changes with what the law does."""
        self.stamp = self.name

    def pack_numbers(
        self, contact: str, values: Mapping[str, float], curve: tuple[float, float, float]
    ) -> tuple[int, Sequence[float]]:
        """Number of internal variables for these parameter values, and the numbers that the kernels read."""
        return 0, tuple(values.values())

    def force(self, felt: Felt) -> tuple[Expression, Expression]:
        """Whether felt whose surfaces meet presses, and its force (N) where it does; felt never pulls."""
        raise NotImplementedError

    def rates(self, felt: Felt) -> Sequence[Expression]:
        """Rate of each memory while the felt presses: of its own state, depth and rate, of no other memory."""
        return self.recovery_rates(felt)

    def recovery_rates(self, felt: Felt) -> Sequence[Expression]:
        """Rate of each memory while the felt does not press."""
        return [ZERO for _ in felt.memory]

    def energy(self, felt: Felt, label: str) -> tuple[list[Statement], Expression, Expression]:
        """Energy stored (J) and power lost (W), and statements that these need, their names ending with ``label``.

        Asked where surfaces meet; of felt whose memories go on when left alone always, with the depth 0 where it is.
        """
        raise NotImplementedError

    def stiffness(self, felt: Felt) -> Expression:
        """Force per depth that a first touch brings at once, N/m; steps are kept short enough for it."""
        return felt.curve[2]

    def rest_memories(
        self, depth: float, curve: tuple[float, float, float], numbers: Sequence[float], memories: int
    ) -> Sequence[float]:
        return [self.anew or 0.0] * memories

    def refuse_softening(self, contact: str, curve: tuple[float, float, float]) -> None:
        """Raise `InputError` for a loading ``curve`` (a, b, c of a x^3 + b x^2 + c x) with a negative slope, on which a
        hereditary law would generate energy."""
        a, b, c = curve
        if b < 0.0 and b * b > 3.0 * a * c * (1.0 + 1e-9):
            raise InputError(
                f"{contact}.law: found {self.name} on felt with normal.b {b:g}, allowed from "
                f"{-math.sqrt(3.0 * a * c):.6g}: felt that softens as it is pressed would give energy"
            )


def checked_force(of: Law, felt: Felt) -> tuple[Expression, Expression]:
    """Whether felt presses, and its force, which is no number where an added law would have it pull: no step stays."""
    pressing, force = evaluate_law(of.force, felt)
    return pressing, where(force < -PULL_N, constant(math.nan), force) if of.added else force


def evaluate_law(method: Callable[[Felt], Any], felt: Felt) -> tuple[Expression, ...]:
    """Values of ``method`` (of a law, given a felt) at the felt's state, each an expression whose derivatives by depth,
    rate and internal variables are formed only once, when they are needed; the tuple holds values, no derivatives."""

    def evaluate(given: Arguments) -> tuple[Expression, ...]:
        return tuple(method(replace(felt, depth=given[0], rate=given[1], memory=given[2:])))

    out: tuple[Expression, ...] = differentiate_once(evaluate)((felt.depth, felt.rate, *felt.memory))
    return out
