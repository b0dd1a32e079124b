"""Mistakes in a user's force law: each ends in one line that names the law and what to write, when it is added."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import model
from model.compiler.expressions import maximum, minimum, power, root, sine, where
from model.elements.laws.curve import curve_energy, loading_force, loading_stiffness
from model.elements.laws.felt_law import Felt, Law, Number
from model.elements.laws.known import LAWS
from model.elements.laws.stulov import surface_energy
from model.simulation.negative_contact_force import describe_jumps


@pytest.fixture(autouse=True)
def laws_as_before() -> Iterator[None]:
    before = dict(LAWS)
    yield
    LAWS.clear()
    LAWS.update(before)


def slow(felt: Felt) -> Any:
    return loading_force(felt.depth, felt.curve)


class Plain(Law):
    """No loss."""

    name = "plain"

    def force(self, felt: Felt) -> Any:
        return slow(felt) > 0.0, slow(felt)

    def energy(self, felt: Felt, label: str) -> Any:
        return [], curve_energy(felt.depth, felt.curve), 0.0 * felt.rate


class Lasting(Plain):
    """One memory (N) that follows the curve in a millisecond, and does not act."""

    def pack_numbers(self, contact: str, values: Any, curve: Any) -> Any:
        return 1, ()

    def rates(self, felt: Felt) -> Any:
        return [(slow(felt) - felt.memory[0]) / 1e-3]

    def recovery_rates(self, felt: Felt) -> Any:
        return [-(felt.memory[0] / 1e-3)]


def changed(base: type[Law] = Plain, **methods: Any) -> Law:
    return type(base.__name__, (base,), methods)()


def forced(force: Callable[[Felt], Any], base: type[Law] = Plain) -> Law:
    return changed(base, force=lambda self, felt: force(felt))


class Unfinished(Law):
    """States nothing but its name."""

    name = "unfinished"


class WithoutEnergy(Unfinished):
    """Has a force."""

    def force(self, felt: Felt) -> Any:
        return slow(felt) > 0.0, slow(felt)


MISTAKES: dict[str, tuple[Callable[[], Law], str]] = {
    "if on an expression": (
        lambda: forced(lambda felt: (slow(felt) > 0.0, slow(felt) if felt.depth < 1e-9 else 0.5 * slow(felt))),
        "write where(condition, a, b)",
    ),
    "chained comparison": (lambda: forced(lambda felt: (0.0 < slow(felt) < 50.0, slow(felt))), "&, |, ~"),
    "math": (lambda: forced(lambda felt: (slow(felt) > 0.0, slow(felt) * math.sqrt(felt.depth))), "root, exponential"),
    "numpy": (lambda: forced(lambda felt: (slow(felt) > 0.0, slow(felt) * np.sqrt(felt.depth))), "numpy.sqrt"),
    "half power": (lambda: forced(lambda felt: (slow(felt) > 0.0, slow(felt) ** 0.5)), "root(x) in place of x ** 0.5"),
    "power without derivative": (
        lambda: forced(lambda felt: (slow(felt) > 0.0, power(felt.depth, 2.5 + 0.0 * felt.rate) * 1e9)),
        "power(), which has no derivative",
    ),
    "plain number": (lambda: forced(lambda felt: 5.0), "force: found 5.0, allowed a pair"),
    "constant force": (lambda: forced(lambda felt: (felt.depth > 0.0, 5.0)), "found the number 5 N for every depth"),
    "force alone": (lambda: forced(slow), "allowed a pair: whether the felt presses"),
    "pair the wrong way round": (lambda: forced(lambda felt: (slow(felt), slow(felt) > 0.0)), "allowed a condition"),
    "plain truth": (lambda: forced(lambda felt: (True, slow(felt))), "whether it presses: found True"),
    "condition for a force": (lambda: forced(lambda felt: (slow(felt) > 0.0, slow(felt) > 1.0)), "found a condition"),
    "array": (lambda: forced(lambda felt: (slow(felt) > 0.0, np.array([1.0, 2.0]))), "allowed an expression of felt"),
    "misspelt member": (lambda: forced(lambda felt: (felt.depht > 0.0, slow(felt))), "AttributeError"),
    "nothing but a name": (Unfinished, "force is missing; return whether the felt presses"),
    "no energy": (WithoutEnergy, "energy is missing; return statements, the energy stored"),
    "energy as a number": (
        lambda: changed(energy=lambda self, felt, label: curve_energy(felt.depth, felt.curve)),
        "energy: found a Expression, allowed a list of statements",
    ),
    "negative force": (
        lambda: forced(lambda felt: (felt.depth > 0.0, slow(felt) * (1.0 + 2.0 * felt.rate))),
        "felt never pulls; say that it does not press there",
    ),
    "division by zero": (
        lambda: forced(lambda felt: (felt.depth > 0.0, slow(felt) * (1.0 + felt.rate / (felt.rate - felt.rate)))),
        "not finite",
    ),
    "root of a negative number": (
        lambda: forced(lambda felt: (felt.depth > 0.0, slow(felt) * root(felt.rate))),
        "each root from below it",
    ),
    "rates as one expression": (lambda: changed(Lasting, rates=lambda self, felt: felt.memory[0]), "allowed a list"),
    "rate as text": (lambda: changed(Lasting, rates=lambda self, felt: ["fast"]), "rate of memory 1: found 'fast'"),
    "packed without numbers": (
        lambda: changed(pack_numbers=lambda self, *given: 0),
        "pack_numbers: found 0, allowed the number",
    ),
    "stiffness as text": (lambda: changed(stiffness=lambda self, felt: "hard"), "stiffness: found 'hard'"),
    "rate as a plain number": (lambda: changed(Lasting, rates=lambda self, felt: [0.0]), "write 0.0 * ONE, or ZERO"),
    "loss as a plain number": (
        lambda: changed(energy=lambda self, felt, label: ([], curve_energy(felt.depth, felt.curve), 0.0)),
        "power lost: found the plain number 0.0",
    ),
    "equal to a number": (
        lambda: forced(lambda felt: (slow(felt) > 0.0, slow(felt) if felt.rate == 0.0 else 0.5 * slow(felt))),
        "== or != between an expression and a number",
    ),
    "text in a sum": (lambda: forced(lambda felt: (slow(felt) > 0.0, slow(felt) + "1")), "'1' beside an expression"),
    "divided by the rate": (
        lambda: forced(lambda felt: (felt.depth > 0.0, slow(felt) * (1.0 + 1e-9 / felt.rate))),
        "and rate 0 m/s",
    ),
    "milliseconds": (
        lambda: changed(numbers={"tau": Number(1.0, "ms", 0.1, 0.0, 2.0, "a guess")}),
        "found the unit 'ms', allowed",
    ),
    "unit and u exchanged": (
        lambda: changed(numbers={"tau": Number(1.0, 0.1, "s", 0.0, 2.0, "a guess")}),  # type: ignore[arg-type]
        "Number(value, unit, u, low, high, source)",
    ),
    "no Number": (lambda: changed(numbers={"tau": 1e-3}), "tau: found 0.001, allowed a Number"),
    "numbers as a list": (lambda: changed(numbers=[1e-3]), "allowed a dict of Number by name"),
    "anew as text": (lambda: changed(Lasting, anew="yes"), "anew: found 'yes', allowed a finite number or None"),
    "damped as text": (lambda: changed(damped="yes"), "damped: found 'yes', allowed True or False"),
    "method with an error": (lambda: changed(stiffness=lambda self, felt: 1 / 0), "stiffness: ZeroDivisionError"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_when_the_law_is_added(mistake: str) -> None:
    make, words = MISTAKES[mistake]
    with pytest.raises(model.InputError) as caught:
        model.add_law(make())
    said = str(caught.value)
    assert words in said and "\n" not in said
    assert "felt law" in said and (mistake == "pack_numbers" or __file__ in said)
    assert "plain" not in LAWS and "unfinished" not in LAWS


class Zener(Law):
    """F = f + beta s, tau ds/dt = tau df/dt - s: Stulov's felt in another variable."""

    name = "zener"
    numbers = {
        "beta": Number(9.0, "1", 2.0, 0.0, 1e3, "a guess"),
        "tau": Number(5e-5, "s", 3e-5, 1e-9, 10.0, "a guess"),
    }

    def pack_numbers(self, contact: str, values: Any, curve: Any) -> Any:
        return 1, (values["beta"], values["tau"])

    def force(self, felt: Felt) -> Any:
        force = slow(felt) + felt.numbers[0] * felt.memory[0]
        return force > 0.0, force

    def rates(self, felt: Felt) -> Any:
        return [loading_stiffness(felt.depth, felt.curve) * felt.rate - felt.memory[0] / felt.numbers[1]]

    def recovery_rates(self, felt: Felt) -> Any:
        return [-(felt.memory[0] / (felt.numbers[1] * (1.0 + felt.numbers[0])))]

    def energy(self, felt: Felt, label: str) -> Any:
        beta, tau = felt.numbers
        pressing, _ = self.force(felt)
        f = maximum(slow(felt), 0.0)
        h = where(pressing & (felt.depth > 0.0), f - felt.memory[0], -(1.0 + beta) * felt.memory[0])
        return surface_energy(label, felt.depth, h, felt.curve, beta / (1.0 + beta), tau)

    def stiffness(self, felt: Felt) -> Any:
        return felt.curve[2] * (1.0 + felt.numbers[0])

    def rest_memories(self, depth: Any, curve: Any, numbers: Any, memories: Any) -> Any:
        return [0.0]


def test_a_rate_that_jumps_is_told_when_added() -> None:
    with pytest.warns(UserWarning, match=r"felt law zener: the rate of memory 1 jumps by .* derivatives of those that"):
        model.add_law(Zener())


@pytest.mark.parametrize("built_in", ["hunt-crossley", "stulov", "hysteresis"])
def test_laws_that_are_continuous_are_added_without_a_word(built_in: str) -> None:
    own = type("Own", (type(LAWS[built_in]),), {"name": f"own-{built_in}"})()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.add_law(own)
    assert own.jump == ""


def test_a_force_that_jumps_inside_is_told() -> None:
    law = forced(lambda felt: (slow(felt) > 0.0, where(felt.depth > 3e-4, 1.2 * slow(felt), slow(felt))))
    with pytest.warns(UserWarning, match=r"its force jumps by .* at depth 0.3 mm"):
        model.add_law(law)


def test_a_run_that_stops_at_a_jump_names_the_law() -> None:
    law = forced(lambda felt: (slow(felt) > 0.0, where(felt.depth > 3e-4, 1.2 * slow(felt), slow(felt))))
    with pytest.warns(UserWarning, match="its force jumps"):
        model.add_law(law)
    action = model.load_action()
    scene = model.build_scene(action.with_laws({"contact12": law.name}), model.choice_of(action))
    assert f"contact12.law {law.name}: its force jumps by" in describe_jumps(scene)
    assert describe_jumps(model.build_scene(action, model.choice_of(action))) == ""


def test_a_row_of_numbers_and_names_that_no_path_can_have_are_refused() -> None:
    class Named(Plain):
        name = "named"
        numbers = {"d.0": Number(1.0, "1", 0.1, 0.0, 10.0, "a guess")}

    with pytest.raises(model.InputError, match="felt law named: numbers: found 'd.0', allowed a name of letters"):
        model.add_law(Named())
    packs = type(
        "Packs", (Plain,), {"name": "packs", "pack_numbers": lambda self, contact, values, curve: dict(values)}
    )
    with pytest.raises(model.InputError, match="felt law packs: pack_numbers: found .* allowed the number of memories"):
        model.add_law(packs())


def test_numbers_of_numpy_and_whole_powers_calculate_as_plain_ones() -> None:
    law = forced(lambda felt: (slow(felt) > 0.0, np.float64(2.0) * felt.depth**3 * np.float64(1e9) + slow(felt) / 2))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.add_law(law)
    kept = minimum(1.0, law.force(_felt(law))[1])
    assert kept.op == "smaller"


def _felt(law: Law) -> Felt:
    from model.compiler.expressions import argument

    curve = argument("a"), argument("b"), argument("c")
    return Felt(argument("depth"), argument("rate"), (), curve, argument("damping"), ())


def test_a_force_below_zero_that_no_tried_press_shows_is_named_when_it_happens() -> None:
    """A ripple on the curve: with its usual number it never pulls, with the run's it does in parts of a press."""

    class Ripple(Plain):
        name = "ripple"
        numbers = {"height": Number(0.1, "1", 0.1, 0.0, 10.0, "a guess")}

        def force(self, felt: Felt) -> Any:
            return felt.depth > 0.0, slow(felt) * (1.0 + felt.numbers[0] * sine(felt.depth * 3e4))

    model.add_law(Ripple())
    action = model.load_action().with_laws({"contact12": "ripple"})
    time_s, force_n = (column[:650] for column in model.force_table("forte"))
    model.simulate(action, time_s, force_n)
    pulls = action.with_effects({"contact12.ripple.height": 1.4})
    told = r"contact12.law ripple: force -.* N at 0\.11.* s, allowed from 0: felt never pulls"
    with pytest.raises(model.InputError, match=told):
        model.simulate(
            action.with_effects({"contact12.ripple.height": 1.4}), time_s, force_n, output_time_s=[0.0, 0.12]
        )
    members = model.simulate_many(pulls, [(time_s, force_n)] * 8, lanes=True)
    assert all(re.match(told, str(member.error)) for member in members)
    with pytest.raises(model.InputError, match=told):
        model.sensitivities(pulls, (time_s, force_n), ["hammer.mass"])


def test_derivatives_refuse_a_jump_that_no_tried_press_shows() -> None:
    """A step of the rate whose height is 0 with the usual number, and not with the run's."""

    class Stepped(Lasting):
        name = "stepped"
        numbers = {"height": Number(0.0, "1", 0.1, 0.0, 1.0, "a guess")}

        def pack_numbers(self, contact: str, values: Any, curve: Any) -> Any:
            return 1, (values["height"],)

        def rates(self, felt: Felt) -> Any:
            own = (slow(felt) - felt.memory[0]) / 1e-3
            return [where(felt.depth > 1e-4, (1.0 + felt.numbers[0]) * own, own)]

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.add_law(Stepped())
    action = model.load_action().with_laws({"contact12": "stepped"})
    time_s, force_n = model.force_table("forte")
    table = time_s[:650], force_n[:650]
    options = model.SensitivityOptions(tolerance=1e-6)
    assert model.sensitivities(action, table, ["hammer.mass"], options=options).d_angles.shape[2] == 1
    jumps = action.with_effects({"contact12.stepped.height": 1.0})
    told = r"contact12.law stepped: the rate of a memory jumps at t = 0\.11"
    with pytest.raises(model.InputError, match=told):
        model.sensitivities(jumps, table, ["hammer.mass"], options=options)
