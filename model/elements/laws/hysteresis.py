"""Felt whose loop no speed changes: F = f (1 + sum of beta z) / (1 + sum of beta), dz = (dx - |dx| z) / (eta x).

Equations, passivity and sources: docs/explanation/felt.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from model.compiler.expressions import ONE, ZERO, Expression, maximum, total
from model.compiler.programs import Statement
from model.elements.laws.curve import curve_energy, loading_force, loading_stiffness
from model.elements.laws.felt_law import Felt, Law, Number
from model.errors import InputError

MEMORIES = ("", "2", "3")
"""Ends of the names of the numbers, one for each memory."""
LONGEST_REACH = 0.4
"""Largest reach of a memory that is passive on every cubic whose stiffness is nowhere negative."""


def _pair(end: str, values: tuple[float, float], u: tuple[float, float], sources: tuple[str, str]) -> dict[str, Number]:
    beta = Number(values[0], "1", u[0], 0.0, 1.0, sources[0])
    return {f"beta{end}": beta, f"eta{end}": Number(values[1], "1", u[1], 1e-3, LONGEST_REACH, sources[1])}


class Hysteresis(Law):
    """Felt with one to three memories that fade with the way gone; parted, it starts anew."""

    name = "hysteresis"
    anew = 1.0
    numbers = {
        **_pair("", (0.25, 0.2), (0.1, 0.1), (
            "half width of the loop as a share of the force: a quarter to a half of a felt's work stays in it",
            "way after a turn in which the force crosses the loop, as a share of the depth",
        )),
        **_pair("2", (0.0, 0.05), (0.1, 0.03), (
            "a second memory, for minor loops of another width; 0 leaves it out", "a second memory",
        )),
        **_pair("3", (0.0, 0.01), (0.1, 0.005), ("a third memory; 0 leaves it out", "a third memory")),
    }  # fmt: skip

    def pack_numbers(
        self, contact: str, values: Mapping[str, float], curve: tuple[float, float, float]
    ) -> tuple[int, Sequence[float]]:
        """Count of internal variables, and (beta, eta) of each in a row, from ``values`` by name; without those whose
        beta is 0. `InputError` for none, a sum of beta above 1, or a softening ``curve`` (a, b, c)."""
        self.refuse_softening(contact, curve)
        rows = [(values[f"beta{k}"], values[f"eta{k}"]) for k in MEMORIES if values[f"beta{k}"] > 0.0]
        shares = sum(beta for beta, _ in rows)
        if not rows:
            raise InputError(f"{contact}.{self.name}.beta: found 0, allowed above 0; or choose another {contact}.law")
        if shares > 1.0:
            raise InputError(f"{contact}.{self.name}: sum of beta found {shares:g}, allowed to 1: felt cannot pull")
        return len(rows), [x for row in rows for x in row]

    @staticmethod
    def _curve_share(felt: Felt) -> Expression:
        """Share of the loading curve before its memories add to it."""
        return ONE / (1.0 + total(felt.numbers[::2]))

    def force(self, felt: Felt) -> tuple[Expression, Expression]:
        """The curve with what the memories add to it."""
        slow = loading_force(felt.depth, felt.curve)
        factor = 1.0 + total(share * z for share, z in zip(felt.numbers[::2], felt.memory, strict=True))
        return slow > 0.0, slow * (factor * self._curve_share(felt))

    def rates(self, felt: Felt) -> Sequence[Expression]:
        """Each follows the direction of the press within its reach of the depth."""
        x, rate = felt.depth, felt.rate
        return [(rate - abs(rate) * z) / (eta * x) for z, eta in zip(felt.memory, felt.numbers[1::2], strict=True)]

    def energy(self, felt: Felt, label: str) -> tuple[list[Statement], Expression, Expression]:
        """Statements, stored energy (J) and dissipated power (W) of the curve and the internal variables."""
        x, rate, left = felt.depth, felt.rate, self._curve_share(felt)
        f, steep = maximum(loading_force(x, felt.curve), 0.0), loading_stiffness(x, felt.curve)
        kept, lost = left * curve_energy(x, felt.curve), ZERO
        for z, share, reach in zip(felt.memory, felt.numbers[::2], felt.numbers[1::2], strict=True):
            kept = kept + left * (0.5 * share * reach * x * f * z * z)
            lost = lost + left * share * z * z * (f * abs(rate) - 0.5 * reach * (f + x * steep) * rate)
        return [], kept, lost
