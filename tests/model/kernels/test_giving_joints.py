"""Joints that give in the kernels: against bodies that are all free, against differences, nothing where they are off.

Structures compile for ten to twenty seconds: ``python -m pytest -m slow tests/model/kernels/test_giving_joints.py``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

import model
from model.derived.load import kernels_of
from model.kernels import workspace as W
from model.scene.build import Scene, build_scene
from tests.model.compiler.machine import text_of, touched
from tests.model.conftest import random_states
from tests.model.verification.free_bodies import FreeBodies

HAMMER = ("hammer_pin",)
CHOICES = [HAMMER, ("key_pin", "jack_pin"), model.load_scene("giving-joints").effects]


class Linear(NamedTuple):
    """What a scene's kernel says at a state: accelerations, forces, mass matrix, K, D, df/du, contacts that touch."""

    a: np.ndarray
    f: np.ndarray
    mass: np.ndarray
    stiff: np.ndarray
    damp: np.ndarray
    f_u: np.ndarray
    touching: int


def linearised(scene: Scene, q: np.ndarray, v: np.ndarray, u: float) -> Linear:
    n, g = scene.size, len(scene.pins)
    k, w = n + g, np.zeros(W.WITH_MEMORY)
    w[W.Q : W.Q + n], w[W.V : W.V + n], w[W.Z : W.Z + g], w[W.Z + g : W.Z + 2 * g] = q[:n], v[:n], q[n:], v[n:]
    touching = kernels_of(scene.tables).linearise(w, scene.vector, u)
    lower, stiff, damp = (
        w[at : at + W.WIDE**2].reshape(W.WIDE, W.WIDE)[:k, :k].copy() for at in (W.P_MASS, W.P_STIFF, W.P_DAMP)
    )
    mass, a = np.tril(lower) + np.tril(lower, -1).T, w[W.P_ACC : W.P_ACC + k].copy()
    return Linear(a, mass @ a, mass, stiff, damp, w[W.P_INPUT : W.P_INPUT + k].copy(), touching)


def states(count: int, scene: Scene, seed: int) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Random states, joints giving by tenths of a millimetre, the key between pressed felt and 2 mm above."""
    random, g, out = np.random.default_rng(seed), len(scene.pins), []
    for q, v, u in random_states(count, seed):
        lifts = scene.size - len(q)
        q = np.concatenate([q, random.choice([-2e-4, 1e-3]) * random.uniform(0.1, 2.0, lifts)])
        q = np.concatenate([q, 3e-4 * random.normal(size=g)])
        speeds = 10.0 ** random.uniform(-3.0, -0.5, lifts + g) * random.normal(size=lifts + g)
        out.append((q, np.concatenate([v, speeds]), u))
    return out


@pytest.mark.slow
@pytest.mark.parametrize("effects", CHOICES)
def test_accelerations_are_those_of_free_bodies(effects: tuple[str, ...]) -> None:
    action = model.load_action().with_effects({"hammer_pin.stiffness": 3e4, "hammer_pin.load.x": 1.5})
    scene = build_scene(action, model.SceneChoice(effects=effects))
    reference = FreeBodies(action, scene.pins, "balance_rail" in effects)
    touching = 0
    for q, v, u in states(100, scene, 31):
        ours, theirs = linearised(scene, q, v, u), reference.acceleration(q, v, u)
        np.testing.assert_allclose(ours.a, theirs, rtol=1e-9, atol=1e-11 * np.abs(theirs).max())
        touching += ours.touching
    assert touching > 300


@pytest.mark.slow
@pytest.mark.parametrize("effects", CHOICES)
def test_jacobian_equals_central_differences(effects: tuple[str, ...]) -> None:
    scene = build_scene(model.load_action(), model.SceneChoice(effects=effects))
    h, worst, compared = 1e-7, 0.0, 0
    for q, v, u in states(40, scene, 8):
        at = linearised(scene, q, v, u)
        for j, e in enumerate(h * np.eye(len(q))):
            up, down = linearised(scene, q + e, v, u), linearised(scene, q - e, v, u)
            if up.touching != down.touching:
                continue  # a contact opens inside the difference
            compared += 1
            stiff = (up.f - down.f - (up.mass - down.mass) @ at.a) / (2 * h)
            worst = max(worst, np.abs(stiff - at.stiff[:, j]).max() / (1e-3 + np.abs(at.stiff).max()))
            damp = (linearised(scene, q, v + e, u).f - linearised(scene, q, v - e, u).f) / (2 * h)
            worst = max(worst, np.abs(damp - at.damp[:, j]).max() / (1e-3 + np.abs(at.damp).max()))
        f_u = (linearised(scene, q, v, u + 1e-3).f - linearised(scene, q, v, u - 1e-3).f) / 2e-3
        np.testing.assert_allclose(f_u, at.f_u, atol=1e-5)
    assert worst < 2e-6 and compared > 250


@pytest.mark.slow
def test_a_stage_solves_the_system_of_all_coordinates() -> None:
    """(1/(gamma h) - J) (U_q, U_d, U_v, U_dv) = rates, with J from the kernel's own K and D, by dense algebra."""
    scene = build_scene(model.load_action(), model.SceneChoice(effects=HAMMER))
    n, g, gh = scene.size, len(scene.pins), 2e-5
    k, kernels = n + g, kernels_of(scene.tables)
    for q, v, u in states(20, scene, 4):
        at, w = linearised(scene, q, v, u), np.zeros(W.WITH_MEMORY)
        w[W.Q : W.Q + n], w[W.V : W.V + n], w[W.Z : W.Z + g], w[W.Z + g : W.Z + 2 * g] = q[:n], v[:n], q[n:], v[n:]
        kernels.linearise(w, scene.vector, u)
        assert kernels.prepare(w, gh) == 1
        kernels.stage(w, scene.vector, np.zeros(64), np.zeros(64), 0, gh, 1.0 / gh, u, 0.0, 0)
        inverse = np.linalg.inv(at.mass)
        jacobian = np.block([[np.zeros((k, k)), np.eye(k)], [inverse @ at.stiff, inverse @ at.damp]])
        dense = np.linalg.solve(np.eye(2 * k) / gh - jacobian, np.concatenate([v, at.a]))
        z = w[W.Z_U : W.Z_U + 2 * g]
        ours = np.concatenate([w[W.U : W.U + n], z[:g], w[W.U + W.WIDTH : W.U + W.WIDTH + n], z[g:]])
        for part in (slice(0, k), slice(k, 2 * k)):
            np.testing.assert_allclose(ours[part], dense[part], rtol=0, atol=1e-9 * np.abs(dense[part]).max())


def test_joints_that_are_rigid_leave_no_trace() -> None:
    """Text and numbers of a scene's kernels are the same whatever the bushings' parameters are."""
    action = model.load_action()
    scene, other = build_scene(action), build_scene(action.with_effects({"hammer_pin.stiffness": 2e5}))
    assert scene.vector.tobytes() == other.vector.tobytes() and not scene.remembers
    traces = {W.Z, W.P_MASS, W.P_STIFF, W.P_ALLOWANCE + 5, W.POWER_PINS}
    assert not traces & (touched(scene.tables) | touched(scene.tables, "energy"))
    giving = build_scene(action, model.load_scene("giving-hammer")).tables
    assert traces <= touched(giving) | touched(giving, "energy")


def test_a_changed_bushing_compiles_nothing() -> None:
    action, choice = model.load_action(), model.load_scene("giving-hammer")
    changed = {"hammer_pin.stiffness": 2e5, "hammer_pin.damping": 3.0, "hammer_pin.load.y": 0.5}
    before, after = (build_scene(a, choice) for a in (action, action.with_effects(changed)))
    assert text_of(before.tables) == text_of(after.tables)
    assert np.count_nonzero(before.vector != after.vector) == 5  # two directions: stiffness and damping twice, one load
