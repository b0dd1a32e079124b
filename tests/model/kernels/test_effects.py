"""The effects in the kernels: against the twin and differences; nothing of them where they are off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import model
from model.derived import load as scenes
from model.kernels import workspace as W
from model.scene.build import Scene, build_scene
from model.scene.selection import SceneChoice
from tests.model.compiler.machine import touched
from tests.model.conftest import random_states
from tests.model.kernels.linearised import Evaluation
from tests.model.verification.reference_equations import Twin

CHANGED = {
    "key.pivot.x": 0.003,
    "key.pivot.y": -0.002,
    "balance_rail.normal.a": 3e9,
    "balance_rail.normal.b": 2e7,
    "shank.hinge.y": 0.0015,
    "motor_arm.contact_a": 1e9,
    "motor_arm.contact_b": 1e7,
}
CHOICES = [
    pytest.param(("balance_rail",), marks=pytest.mark.slow),  # each structure compiles once, seconds
    pytest.param(("shank",), marks=pytest.mark.slow),
    pytest.param(("balance_rail", "shank", "motor_arm"), marks=pytest.mark.slow),
    ("balance_rail", "shank"),
]


@pytest.fixture(scope="module")
def changed(action: model.Action) -> model.Action:
    return replace(action.with_values(CHANGED), changed={})  # for scenes without these effects too


def states(count: int, scene: Scene, seed: int) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Random states of the five bodies, with lifts between compressed felt and 2 mm the shank bent by 10 mrad."""
    random = np.random.default_rng(seed)
    out = []
    for q, v, u in random_states(count, seed):
        for coordinate in scene.bodies[5:]:
            if coordinate == "motor":
                q, v, u = np.append(q, random.uniform(-0.02, 0.01)), np.append(v, 0.3 * random.normal()), 0.01 * u
            elif coordinate == "key_lift":
                q = np.append(q, random.choice([random.uniform(-4e-4, 5e-6), random.uniform(5e-6, 2e-3)]))
                v = np.append(v, random.normal() * 10.0 ** random.uniform(-4.0, -0.5))
            else:
                q = np.append(q, random.uniform(-0.01, 0.01))
                v = np.append(v, random.normal() * 10.0 ** random.uniform(-3.0, 1.0))
        out.append((q, v, u))
    return out


def generated(scene: Scene, q: np.ndarray, v: np.ndarray, u: float) -> dict[str, np.ndarray]:
    at = Evaluation(scene, q, v, u)
    return {"a": at.a, "M": at.mass, "f": at.f, "f_u": at.f_u, "n": at.touching, "K": at.stiff, "D": at.damp}


@pytest.mark.parametrize("effects", CHOICES)
def test_kernels_equal_the_twin(changed: model.Action, effects: tuple[str, ...]) -> None:
    scene, twin = build_scene(changed, SceneChoice(effects=effects)), Twin(changed, effects)
    assert list(scene.bodies) == twin.coordinates
    lifted = pressed = 0
    for q, v, u in states(300, scene, seed=21):
        ours = generated(scene, q, v, u)
        f, mass = twin.forces_and_mass(q, v, u)
        np.testing.assert_allclose(ours["M"], mass, rtol=1e-12, atol=1e-12 * np.abs(mass).max())
        theirs = np.linalg.solve(mass, f)
        np.testing.assert_allclose(ours["a"], theirs, rtol=1e-10, atol=1e-12 * np.abs(theirs).max())
        if "balance_rail" in effects:
            at = scene.bodies.index("key_lift")
            force = twin.rail_force(q[at], v[at])
            lifted, pressed = lifted + (force == 0.0), pressed + (force > 0.0)
    assert "balance_rail" not in effects or min(lifted, pressed) > 50


@pytest.mark.parametrize("effects", CHOICES[2:])
def test_jacobian_equals_central_differences(changed: model.Action, effects: tuple[str, ...]) -> None:
    scene = build_scene(changed, SceneChoice(effects=effects))
    h, worst, compared = 1e-7, 0.0, 0
    for q, v, u in states(100, scene, seed=5):
        at = generated(scene, q, v, u)
        for j, e in enumerate(h * np.eye(scene.size)):
            plus, minus = generated(scene, q + e, v, u), generated(scene, q - e, v, u)
            if plus["n"] != minus["n"]:
                continue  # a contact opens inside the difference
            compared += 1
            stiff = (plus["f"] - minus["f"] - (plus["M"] - minus["M"]) @ at["a"]) / (2 * h)
            worst = max(worst, np.abs(stiff - at["K"][:, j]).max() / (1e-3 + np.abs(at["K"]).max()))
            plus, minus = generated(scene, q, v + e, u), generated(scene, q, v - e, u)
            damp = (plus["f"] - minus["f"]) / (2 * h)
            worst = max(worst, np.abs(damp - at["D"][:, j]).max() / (1e-3 + np.abs(at["D"]).max()))
        f_u = (generated(scene, q, v, u + 1e-3)["f"] - generated(scene, q, v, u - 1e-3)["f"]) / 2e-3
        np.testing.assert_allclose(f_u, at["f_u"], atol=1e-5)
    assert worst < 2e-5 and compared > 600


def test_effects_that_are_off_leave_no_trace(action: model.Action) -> None:
    """Source, tables and numbers of the kernels are the same whatever the effects' parameters are."""
    scene = build_scene(action)
    other = build_scene(action.with_effects({"shank.frequency_hz": 80.0, "balance_rail.normal.c": 1e5}))
    assert scene.vector.tobytes() == other.vector.tobytes()
    for a, b in zip(scene.tables, other.tables, strict=True):
        np.testing.assert_array_equal(a, b)
    traces = {W.Q + 5, W.V + 5, W.POWER_RAIL, W.POWER_SHANK}
    assert not traces & (touched(scene.tables) | touched(scene.tables, "energy"))
    both = build_scene(action, SceneChoice(effects=("balance_rail", "shank"))).tables
    assert traces <= touched(both) | touched(both, "energy")


def test_a_changed_value_of_an_effect_compiles_nothing(action: model.Action) -> None:
    choice = SceneChoice(effects=("balance_rail", "shank"))
    before = build_scene(action, choice)
    scenes.kernels_of(before.tables)
    count = scenes.COMPILED["scenes"]
    after = build_scene(action.with_values({"shank.frequency_hz": 80.0, "balance_rail.normal.a": 1e9}), choice)
    scenes.kernels_of(after.tables)
    assert scenes.COMPILED["scenes"] == count
    assert np.count_nonzero(before.vector != after.vector) == 4  # k and d of the hinge, a and level of the felt
