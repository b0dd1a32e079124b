"""Laws by themselves, for what is simulated without a scene: a hammer's felt on a string, a motor's amplifier.

Each is a kernel of four arrays, like those of `model.derived.watched`: what the law is differentiated by, one that is
not read, its numbers, what is found.
"""

from __future__ import annotations

from model.compiler.expressions import ONE, ZERO, Expression, read, slopes
from model.compiler.programs import If, Program, Put, at
from model.elements.drives import amplifier
from model.elements.laws.felt_law import Felt, asked
from model.elements.laws.known import LAWS, USUAL


def _found(found: Expression, by: tuple[Expression, ...]) -> list[Put]:
    """A number and its derivatives, one behind the other."""
    return [Put(at("y", k), x) for k, x in enumerate((found, *(slopes({x: ONE})(found) for x in by)))]


class Alone:
    """Programs of these kernels."""

    def _program(self, statements: list[Put | If]) -> Program:
        return Program(dict.fromkeys("xupy", "array"), list(statements))

    def felt(self) -> Program:
        """Normal force (N) at a depth (m) and its rate (m/s), derivatives by these; numbers a, b, c, D."""
        x, rate, a, b, c, damping = (*(read("x", k) for k in range(2)), *(read("p", k) for k in range(4)))
        pressing, force = asked(LAWS[USUAL].force, Felt(x, rate, (), (a, b, c), damping, ()))
        cleared = [Put(at("y", k), ZERO) for k in range(3)]
        return self._program([*cleared, If((x > 0.0) & pressing, list(_found(force, (x, rate))))])

    def amplifier(self) -> Program:
        """Voltage (V) at a source (V) and a current (A), derivative by that; numbers of `elements.drives.amplifier`."""
        u, current = (read("x", k) for k in range(2))
        volts = amplifier((u, current), *(read("p", k) for k in range(5)))
        return self._program(list(_found(volts, (current,))))
