"""A hammer's joint that gives, in the kernels: against bodies that are all free, and by dense algebra."""

from __future__ import annotations

import numpy as np

import model
from model import build_scene
from model.codegen.load import load_kernels
from model.kernels import workspace as W
from tests.model.kernels.linearised import Evaluation, placed, states
from tests.model.verification.free_bodies import FreeBodies

HAMMER = ("hammer_pin",)


def test_accelerations_are_those_of_free_bodies() -> None:
    action = model.load_action().with_effects({"hammer_pin.stiffness": 3e4, "hammer_pin.load.x": 1.5})
    scene = build_scene(action, model.SceneChoice(effects=HAMMER))
    reference = FreeBodies(action, scene.pins)
    touching = 0
    for q, v, u in states(100, scene, 31):
        ours, theirs = Evaluation(scene, q, v, u), reference.acceleration(q, v, u)
        np.testing.assert_allclose(ours.a, theirs, rtol=1e-9, atol=1e-11 * np.abs(theirs).max())
        touching += ours.touching
    assert touching > 300


def test_a_stage_solves_the_system_of_all_coordinates() -> None:
    """(1/(gamma h) - J) (U_q, U_d, U_v, U_dv) = rates, with J from the kernel's own K and D, by dense algebra."""
    scene = build_scene(model.load_action(), model.SceneChoice(effects=HAMMER))
    n, g, gh = scene.size, len(scene.pins), 2e-5
    k, kernels = n + g, load_kernels(scene.tables)
    for q, v, u in states(20, scene, 4):
        at, w = Evaluation(scene, q, v, u), placed(scene, q, v)
        kernels.linearise(w, scene.vector, u)
        assert kernels.prepare(w, gh) == 1
        kernels.stage(w, scene.vector, np.zeros(64), np.zeros(64), 0, gh, 1.0 / gh, u, 0.0, 0)
        u_v = np.linalg.solve(at.mass / gh - at.damp - gh * at.stiff, at.mass @ at.a + gh * at.stiff @ v)
        dense = np.concatenate([gh * (v + u_v), u_v])
        z = w[W.Z_U : W.Z_U + 2 * g]
        ours = np.concatenate([w[W.U : W.U + n], z[:g], w[W.U + W.WIDTH : W.U + W.WIDTH + n], z[g:]])
        for part in (slice(0, k), slice(k, 2 * k)):
            np.testing.assert_allclose(ours[part], dense[part], rtol=0, atol=1e-9 * np.abs(dense[part]).max())
