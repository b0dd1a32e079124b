"""Laws that a program adds: what is refused, and that a law's kernels are its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import model
from model.compiler.expressions import Expression, where
from model.elements.laws.curve import curve_energy, loading_force
from model.elements.laws.felt_law import Felt, Law, Number
from model.elements.laws.known import LAWS


def law_like(**changed: Any) -> Law:
    """A law without loss, but for what is changed; its stiffness times ``hardness``."""

    class Gel(Law):
        name = "gel"
        hardness = 1.0

        def force(self, felt: Felt) -> tuple[Expression, Expression]:
            slow = self.hardness * loading_force(felt.depth, felt.curve)
            return slow > 0.0, slow

        def energy(self, felt: Felt, label: str) -> tuple[list[Any], Expression, Expression]:
            return [], self.hardness * curve_energy(felt.depth, felt.curve), 0.0 * felt.rate

    return type("Gel", (Gel,), changed)()


def _two(self: Law, *given: Any) -> tuple[int, tuple[float, ...]]:
    return 2, ()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"name": "Gel 2"}, "found 'Gel 2', allowed an instance of Law whose name has lower-case letters"),
        ({"name": "stulov"}, "felt law stulov: the name of a law that is there"),
        ({"numbers": {"k": Number(2.0, "1", 0.1, 0.0, 1.0, "a guess")}}, "felt law gel: k: found Number(value=2.0"),
        ({"pack_numbers": lambda *_: (4, ())}, "felt law gel: found 4 memories, allowed to 3"),
        (
            {"pack_numbers": _two, "rates": lambda _, felt: felt.memory[:1]},
            "found 1, 2, 2 numbers from rates, recovery_rates",
        ),
        (
            {"pack_numbers": _two, "rates": lambda _, felt: [felt.memory[1] - felt.memory[0], felt.memory[0] * 0.5]},
            "found a memory whose rate hangs on another",
        ),
    ],
)
def test_what_is_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(model.InputError) as caught:
        model.add_law(law_like(**changed))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_law_that_was_changed_has_kernels_of_its_own() -> None:
    """The same name, another text: another blow, another hash of the action; back again, the first blow's bits."""
    model.add_law(law_like())
    action = model.load_action().with_laws({"contact02": "gel"})
    choice, force = model.load_scene("key"), (np.array([0.0, 0.05]), np.array([2.0, 20.0]))
    found = []
    for hardness in (1.0, 2.0, 1.0):
        model.add_law(law_like(hardness=hardness))
        blow = model.simulate(action, *force, scene=choice, output_time_s=np.array([0.05]), energy=True)
        assert blow.energy is not None and abs(blow.energy.residual) < 1e-5 * blow.energy.work_in
        found.append((float(blow.angle_rad[-1, 0]), action.content()))
    assert found[0] == found[2]
    assert found[0][0] != found[1][0] and found[0][1] != found[1][1]


def test_numbers_of_an_added_law_are_parameters_like_others() -> None:
    soft = {"soft": Number(0.5, "1", 0.1, 0.1, 1.0, "a guess")}

    def force(self: Law, felt: Felt) -> tuple[Expression, Expression]:
        slow = felt.numbers[0] * loading_force(felt.depth, felt.curve)
        return slow > 0.0, where(slow > 0.0, slow, 0.0)

    early = model.load_action()  # before the law is there
    model.add_law(law_like(name="gel-soft", numbers=soft, force=force))
    action = early.with_laws({"contact02": "gel-soft"})
    assert action["contact02.gel-soft.soft"] == 0.5
    assert action.effects["contact02.gel-soft.soft"].unit == "1"
    with pytest.raises(model.InputError, match=r"contact02.gel-soft.soft: found 2, allowed from 0.1 to 1"):
        action.with_values({"contact02.gel-soft.soft": 2.0})
    vector = model.build_scene(action).vector
    changed = model.build_scene(action.with_values({"contact02.gel-soft.soft": 0.7})).vector
    assert np.flatnonzero(vector != changed).size == 1
    table = {"contact02": {"law": "gel-soft", "gel-soft": {"soft": 0.3}}}
    assert model.scene_of(table, "mine.toml").on(model.load_action())["contact02.gel-soft.soft"] == 0.3


def test_a_law_that_nobody_added_is_named() -> None:
    with pytest.raises(model.InputError, match="felt law foam: not known in this process; call model.add_law"):
        LAWS["foam"]
