"""Felt laws with memory inside the moving action: derivatives, order, energy, rules of rest and reset."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import model
from model.codegen.evaluate_observables import contacts_at
from model.codegen.observable_columns import DEPTH
from model.felt import Hysteresis, Stulov
from model.parameters.action import CONTACTS
from model.simulation.run import Simulation, State
from tests.model.kernels.linearised import stages_off

# a memory of each kind, two in one contact (string), with friction and on a chain of three joints (knuckle)
MIXED = {"contact02": "stulov", "contact07": "hysteresis", "contact12": "hysteresis"}
VALUES = {"contact12.hysteresis.beta": 0.4, "contact12.hysteresis.beta2": 0.2}


@pytest.fixture(scope="module")
def mixed() -> model.Action:
    return model.load_action("hirschkorn2004-regulated").with_laws(MIXED).with_values(VALUES)


@pytest.fixture(scope="module")
def blow(mixed: model.Action) -> Iterator[tuple[Simulation, np.ndarray, np.ndarray]]:
    """The forte from rest to 0.2 s: the run, angles and speeds every 0.1 ms."""
    times, force = model.force_table("forte")
    scene = model.build_scene(mixed)
    run = Simulation(scene, State(0.0, model.rest_state(mixed).angle_rad, np.zeros(scene.size)), 1e-7)
    at = np.linspace(0.1, 0.2, 1001)
    yield run, *run.advance(0.2, times, force, output_time_s=at)


def test_the_thesis_s_law_named_is_the_thesis_s_law() -> None:
    """Tables of the kernels, numbers and steps are those of an action that names no law."""
    plain = model.load_action("hirschkorn2004")
    named = plain.with_laws(dict.fromkeys(CONTACTS, "hunt-crossley"))
    assert named.content() == plain.content()
    scene, same = (model.build_scene(a) for a in (plain, named))
    assert all(np.array_equal(a, b) for a, b in zip(scene.tables, same.tables, strict=True))
    times, force = model.force_table("forte")
    ours, theirs = (model.simulate(a, times, force) for a in (named, plain))
    assert np.array_equal(ours.angle_rad, theirs.angle_rad)
    assert ours.counters == theirs.counters


def test_a_stage_solves_the_system_with_the_jacobian_of_differences(
    blow: tuple[Simulation, np.ndarray, np.ndarray],
) -> None:
    wrong, checked = stages_off(*blow, range(20, 1001, 8))
    assert checked == set(MIXED)
    # a difference that steps across a kink (touching, friction turning, v = 0) is no derivative
    assert np.quantile(wrong, 0.9) < 1e-5
    assert np.median(wrong) < 1e-6


def test_forces_are_those_of_the_laws_in_reference_form(mixed: model.Action) -> None:
    """Followed by themselves along the depth that the motion gives, from first touch on."""
    scene = model.build_scene(mixed)
    run = Simulation(scene, State(0.0, model.rest_state(mixed).angle_rad, np.zeros(scene.size)), 1e-7)
    at = np.linspace(0.1, 0.12, 2001)
    angles, speeds = run.advance(0.12, *model.force_table("forte"), output_time_s=at)
    depth = contacts_at(scene.static_tables, scene.vector, angles, speeds)[:, :, DEPTH]
    normal, _ = run.contact_forces(angles, speeds)
    c, share = scene.contacts.index("contact12"), (0.4, 0.2)
    a, b, k = (mixed[f"contact12.normal.{x}"] / (1.0 + sum(share)) for x in "abc")
    reference = Hysteresis(a, b, k, share, (0.2, 0.05)).response(at, depth[:, c]).force_n
    assert np.count_nonzero(depth[:, c] > 0.0) > 100
    # turning points lie between samples, 0.01 ms apart
    assert np.max(np.abs(reference - normal[:, c])) < 0.002 * normal[:, c].max()


def test_stulov_in_a_blow_is_stulov_in_reference_form() -> None:
    """Key felt of a pure cubic, so that both forms of the law are the same."""
    pure = {"contact02.normal.a": 2e10, "contact02.normal.b": 0.0, "contact02.normal.c": 0.0}
    action = model.load_action("hirschkorn2004").with_values(pure).with_laws({"contact02": "stulov"})
    choice = model.load_scene("key")
    times = np.array([0.0, 0.3])
    scene = model.build_scene(action, choice)
    run = Simulation(scene, State(0.0, model.rest_state(action, 2.0, scene).angle_rad, np.array([-3.0])), 1e-9)
    at = np.linspace(0.0, 0.01, 3001)
    angles, speeds = run.advance(0.01, times, np.array([2.0, 2.0]), output_time_s=at)
    depth = contacts_at(scene.static_tables, scene.vector, angles, speeds)[:, :, DEPTH]
    c = scene.contacts.index("contact02")
    normal = run.contact_forces(angles, speeds)[0][:, c]
    still = np.concatenate([[depth[0, c]] * 2, depth[:, c]])  # the felt had rested at the first depth
    law = Stulov(2e10 / (1.0 - 0.9), 3.0, 0.9, 5e-5)
    reference = law.response(np.concatenate([[-2.0, -1.0], at]), still).force_n[2:]
    assert normal.max() > 5.0 and normal.min() == 0.0
    np.testing.assert_allclose(normal, reference, atol=1e-3 * normal.max())


@pytest.mark.parametrize("law", ["stulov", "hysteresis"])
def test_the_method_keeps_its_order(law: str) -> None:
    """Key felt pressed deeper by a rising force, without a turn: errors fall with the fourth power of the step."""
    action = model.load_action("hirschkorn2004").with_laws({"contact02": law})
    scene = model.build_scene(action, model.load_scene("key"))
    start = State(0.0, model.rest_state(action, 10.0, scene).angle_rad, np.array([-0.05]))

    def end(step: float) -> np.ndarray:
        run = Simulation(scene, replace(start.copy(), step_s=step), 1e-2, largest_step_s=step)
        run.advance(1.6e-3, np.array([0.0, 1.0]), np.array([10.0, 6e4]))
        assert run.work()["n_steps"] == round(1.6e-3 / step)
        return np.concatenate([run.state.angle_rad, 1e-3 * run.state.speed_rad_per_s, 1e-3 * run.state.memory])

    exact = end(1e-6)
    errors = [float(np.max(np.abs(end(step) - exact))) for step in (4e-5, 2e-5, 1e-5)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.5), (errors, orders)


def test_felt_that_is_left_alone_loses_what_it_stored() -> None:
    """The key is let go: its felt parts with force in it, which fades; before, steps ran over that (2 % at 1e-5)."""
    action = model.load_action("hirschkorn2004").with_laws({"contact02": "stulov"})
    action = action.with_values({"contact02.stulov.tau": 5e-4})
    scene = model.build_scene(action, model.load_scene("key"))
    pressed = model.rest_state(action, 50.0, scene).angle_rad
    for tolerance, closes in ((1e-5, 1e-3), (1e-7, 1e-5), (1e-9, 1e-6)):
        run = Simulation(scene, State(0.0, pressed, np.zeros(1)), tolerance, energy=True)
        stored = run.stored_energy()
        run.advance(0.1, np.array([0.0, 1e-4, 1.0]), np.array([50.0, 0.0, 0.0]))
        given, *lost = run.audit
        assert abs(given - (run.stored_energy() - stored) - sum(lost)) < closes * sum(lost)
        assert run.state.memory[0] < 0.01 * 50.0


def test_felt_at_rest_presses_as_its_slow_curve_says(mixed: model.Action) -> None:
    plain = mixed.with_laws(dict.fromkeys(MIXED, "hunt-crossley"))
    plain = replace(plain, changed={})
    rest, before = model.rest_state(mixed, 20.0), model.rest_state(plain, 20.0)  # the key's felt is pressed
    assert np.array_equal(rest.angle_rad, before.angle_rad)
    scene = model.build_scene(mixed)
    run = Simulation(scene, State(0.0, rest.angle_rad, np.zeros(scene.size)))
    pressed = rest.contact_normal_n[scene.contacts.index("contact02")]
    law = np.array([mixed.law(scene.contacts[c]) for c in scene.tables.memory])
    assert pressed > 5.0
    np.testing.assert_allclose(run.state.memory[law == "stulov"], pressed, rtol=1e-12)
    assert np.all(run.state.memory[law == "hysteresis"] == 1.0)
    held = np.array([20.0, 20.0])
    moved, _ = run.advance(0.2, np.array([0.0, 1.0]), held, output_time_s=np.array([0.1, 0.2]))
    assert np.max(np.abs(moved - rest.angle_rad)) < 1e-9  # and stays there


def test_felt_that_parted_starts_anew(blow: tuple[Simulation, np.ndarray, np.ndarray]) -> None:
    run, angles, speeds = blow
    scene = run.scene
    string = scene.contacts.index("contact12")
    memory = int(np.flatnonzero(scene.tables.memory == string)[0])
    normal, _ = run.contact_forces(angles, speeds)
    struck = np.flatnonzero(normal[:, string] > 0.0)
    assert run.remembered[struck, memory].min() < -0.5  # on its way out
    assert run.remembered[struck[0], memory] == 1.0 and run.remembered[struck[-1] + 2, memory] == 1.0


@pytest.mark.parametrize(
    ("laws", "values", "message"),
    [
        ({"contact02": "kelvin"}, {}, "contact02.law: found 'kelvin', allowed hunt-crossley, stulov, hysteresis"),
        ({"contact14": "stulov"}, {}, "found 'contact14', allowed contact01 to contact13"),
        ({}, {"contact02.stulov.tau": 1e-4}, "contact02 follows the law hunt-crossley"),
        ({"contact02": "stulov"}, {"contact02.hysteresis.eta": 0.3}, "contact02 follows the law stulov"),
        ({"contact02": "stulov"}, {"contact02.normal.b": -1e9}, "felt that softens"),
        ({"contact02": "hysteresis"}, {"contact02.hysteresis.eta": 0.5}, "allowed from 0.001 to 0.4"),
        ({"contact02": "hysteresis"}, {"contact02.hysteresis.beta2": 0.9}, "sum of beta found 1.15, allowed to 1"),
        ({"contact02": "hysteresis"}, {"contact02.hysteresis.beta": 0.0}, "found 0, allowed above 0"),
    ],
)
def test_what_is_refused(laws: dict[str, str], values: dict[str, float], message: str) -> None:
    with pytest.raises(model.InputError) as caught:
        model.build_scene(model.load_action().with_laws(laws).with_values(values))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_state_of_another_scene_is_refused(mixed: model.Action) -> None:
    scene = model.build_scene(mixed)
    state = State(0.0, scene.start.copy(), np.zeros(scene.size), memory=np.ones(2))
    with pytest.raises(model.InputError, match="allowed 4 finite numbers, or none"):
        Simulation(scene, state)
    plain = model.build_scene(model.load_action())
    with pytest.raises(model.InputError, match="allowed 0 finite numbers, or none"):
        Simulation(plain, state)
