"""The kernels agree with the plain NumPy twin and their derivatives with differences; what is off leaves no trace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import model
from model import SceneChoice, build_scene
from model.kernels import layout as L
from tests.model.kernels.linearised import Evaluation, off_differences, states
from tests.model.verification.reference_equations import Twin

CHANGED = {
    "key.pivot.x": 0.003,
    "key.pivot.y": -0.002,
    "balance_rail.normal.a": 3e9,
    "balance_rail.normal.b": 2e7,
    "shank.hinge.y": 0.0015,
    "motor_arm.contact_a": 1e9,
    "motor_arm.contact_b": 1e7,
    "motor_drive.current_limit": 3.0,
    "motor_drive.supply": 12.0,
}
BOTH = ("balance_rail", "shank")
DRIVE = model.SCENES["motor-drive"].effects
CHOICES = [(), ("motor_arm",), BOTH, DRIVE]


@pytest.fixture(scope="module")
def changed(action: model.Action) -> model.Action:
    return replace(action.with_values(CHANGED), changed={})  # for scenes without these effects too


@pytest.mark.parametrize("effects", CHOICES)
def test_kernels_equal_the_twin(changed: model.Action, effects: tuple[str, ...]) -> None:
    scene, twin = build_scene(changed, SceneChoice(effects=effects)), Twin(changed, effects)
    assert list(scene.bodies) == twin.coordinates
    lifted = pressed = limited = 0
    touching = set()
    for q, v, u in states(300, scene, seed=1):
        ours = Evaluation(scene, q, v, u)
        f, mass = twin.forces_and_mass(q, v, u)
        np.testing.assert_allclose(ours.mass, mass, rtol=1e-12, atol=1e-12 * np.abs(mass).max())
        theirs = np.linalg.solve(mass, f)
        np.testing.assert_allclose(ours.a, theirs, rtol=1e-10, atol=1e-12 * np.abs(theirs).max())
        touching |= {c for c in twin.contacts if twin.gap(c)[0] > 0}
        limited += effects == DRIVE and abs(v[-1]) > 3.0
        if "balance_rail" in effects:
            at = scene.bodies.index("key_lift")
            force = twin.rail_force(q[at], v[at])
            lifted, pressed = lifted + (force == 0.0), pressed + (force > 0.0)
    # the random states exercise nearly every contact; the jack's stop and the string among them
    assert len(touching) >= 11, sorted(touching)
    assert "balance_rail" not in effects or min(lifted, pressed) > 50
    assert effects != DRIVE or limited > 40


@pytest.mark.parametrize("effects", [*CHOICES, ("hammer_pin",)])
def test_jacobian_equals_central_differences(changed: model.Action, effects: tuple[str, ...]) -> None:
    scene = build_scene(changed, SceneChoice(effects=effects))
    worst, compared = off_differences(scene, states(100, scene, seed=5))
    assert worst < 2e-5 and compared > 0.85


def test_switched_off_elements_leave_the_scene(action: model.Action) -> None:
    full = build_scene(action)
    less = build_scene(action.with_values({"contact12": 0, "jack_spring": 0}))
    assert "contact12" not in less.contacts
    assert len(less.contacts) == len(full.contacts) - 1
    assert len(less.tables.spring) == len(full.tables.spring) - 1
    assert less.vector.size == full.vector.size - L.CONTACT_SIZE - L.SPRING_SIZE


GIVING = model.load_scene("giving-hammer").effects


@pytest.mark.parametrize(
    ("effects", "values"),
    [
        ((), {"shank.frequency_hz": 80.0, "balance_rail.normal.c": 1e5, "hammer_pin.stiffness": 2e5}),
        (("motor_arm",), {"motor_drive.resistance": 5.0, "finger.mass": 1.0}),
    ],
)
def test_effects_that_are_off_leave_no_trace(
    action: model.Action, effects: tuple[str, ...], values: dict[str, float]
) -> None:
    """Tables, of which kernels are made, and numbers are the same whatever the parameters of other effects are."""
    choice = SceneChoice(effects=effects)
    scene, other = build_scene(action, choice), build_scene(action.with_effects(values), choice)
    assert scene.vector.tobytes() == other.vector.tobytes()
    assert not scene.remembers and scene.command is None
    for a, b in zip(scene.tables, other.tables, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("effects", "values", "numbers"),
    [
        ((), {"contact04.friction.A": 0.2}, 1),
        (BOTH, {"shank.frequency_hz": 80.0, "balance_rail.normal.a": 1e9}, 4),  # k, d of the hinge; a, level of felt
        # two directions: stiffness and damping twice, one load
        (GIVING, {"hammer_pin.stiffness": 2e5, "hammer_pin.damping": 3.0, "hammer_pin.load.y": 0.5}, 5),
    ],
)
def test_a_changed_value_compiles_nothing(
    action: model.Action, effects: tuple[str, ...], values: dict[str, float], numbers: int
) -> None:
    choice = SceneChoice(effects=effects)
    before, after = build_scene(action, choice), build_scene(action.with_values(values), choice)
    for a, b in zip(before.tables, after.tables, strict=True):
        np.testing.assert_array_equal(a, b)
    assert np.count_nonzero(before.vector != after.vector) == numbers
