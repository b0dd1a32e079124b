"""The kernels of a scene: a stage's linear system, the skip bound, the cache."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest

import model
from model import SceneChoice, build_scene
from model.codegen import load as scenes
from model.codegen.evaluate_observables import contacts_at
from model.codegen.observable_columns import DEPTH
from model.kernels import compile as compiling
from model.kernels import workspace as W
from model.kernels.kernel_value import Kernel
from model.kernels.signatures import STEP
from model.simulation import run as simulation
from tests.model.conftest import random_states, read_table
from tests.model.kernels.linearised import Evaluation


@pytest.mark.parametrize("effects", [(), ("motor_arm",)], ids=["force", "motor"])
def test_a_stage_solves_its_linear_system(action: model.Action, effects: tuple[str, ...]) -> None:
    stiffening = action.with_effects({"motor_arm.contact_a": 1e9, "motor_arm.contact_b": 1e7})
    scene = build_scene(stiffening, SceneChoice(effects=effects))
    n, p, t = scene.size, scene.vector, scene.tables
    kernels = scenes.load_kernels(t)
    solved = 0
    for q, v, u in random_states(150, seed=11):
        if effects:
            q, v, u = np.append(q, -0.01), np.append(v, 0.3), 0.01 * u
        at = Evaluation(scene, q, v, u)
        w = np.zeros(W.SIZE)
        w[W.Q : W.Q + n], w[W.V : W.V + n] = q, v
        kernels.linearise(w, p, u)

        def close(ours: np.ndarray, theirs: np.ndarray, share: float = 1e-11) -> None:
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=share * np.max(np.abs(theirs)))

        # one stage with a_10 = 1, C_10 = -0.5 and a known stage before it
        h, gh, weight = 1e-6, 0.25e-6, 0.3
        if not kernels.prepare(w, gh):
            continue
        solved += 1
        before = np.random.default_rng(0).normal(size=(2, n)) * 1e-7
        w[W.U : W.U + n], w[W.U + W.WIDTH : W.U + W.WIDTH + n] = before
        w[W.ALLOWANCE : W.ALLOWANCE + W.WIDTH] = 1.0
        coefficients, coupling = np.zeros(64), np.zeros(64)
        coefficients[8], coupling[8] = 1.0, -0.5
        kernels.stage(w, p, coefficients, coupling, 1, gh, 1.0 / h, u, weight, 0)
        a = Evaluation(scene, q + before[0], v + before[1], u).a
        r_q = v + before[1] - 0.5 / h * before[0]
        right = at.mass @ (a - 0.5 / h * before[1]) + gh * at.stiff @ r_q + weight * at.f_u
        u_v = np.linalg.solve(at.mass / gh - at.damp - gh * at.stiff, right)
        o = W.U + 2 * W.WIDTH
        close(w[o + W.WIDTH : o + W.WIDTH + n], u_v, 1e-9)
        close(w[o : o + n], gh * (r_q + u_v), 1e-9)
    assert solved > 135


def test_skipped_contacts_never_touch(action: model.Action) -> None:
    """Random states and moves within the allowance, over blows and far beyond them."""
    scene = build_scene(action)
    p, tables, kernels = scene.vector, scene.tables, scenes.load_kernels(scene.tables)

    near = (np.array([-0.03, 0.0, -0.1, 0.25, -0.1]), np.array([0.035, 0.12, 0.35, 0.6, 0.32]))
    anywhere = (np.full(5, -np.pi), np.full(5, np.pi))
    random, count = np.random.default_rng(7), 2_000
    for low, high in (near, anywhere):
        q = random.uniform(low, high, (count, 5))
        allowance = 10.0 ** random.uniform(-5.0, 0.0, (count, 1)) * random.uniform(0.0, 1.0, (count, 5))
        inside, corner = random.uniform(-1.0, 1.0, (count, 5)), random.choice([-1.0, 1.0], (count, 5))
        moved = q + allowance * np.where(random.random((count, 5)) < 0.5, corner, inside)  # the corners are the worst
        found, w = np.zeros(count, dtype=np.int64), np.zeros(W.SIZE)
        for k in range(count):
            w[W.Q : W.Q + 5], w[W.ALLOWANCE : W.ALLOWANCE + 5] = q[k], allowance[k]
            kernels.linearise(w, p, 0.0)
            found[k] = kernels.skip(w, p)
        touches = contacts_at(tables, p, moved, np.zeros_like(q))[:, :, DEPTH] > 0.0
        skipped = (found[:, None] >> np.arange(len(scene.contacts))) & 1 == 1
        assert touches.sum() > 1_000 and skipped.sum() > 1_000
        assert not np.any(touches & skipped)


def test_skipping_changes_no_bit_of_the_answer(action: model.Action, monkeypatch: pytest.MonkeyPatch) -> None:
    force = read_table("forte_force.csv")[:800]
    with_skips = model.simulate(action, force[:, 0], force[:, 1])
    none = numba.cfunc(STEP["skip"])(lambda w, p: 0)
    whole = scenes.load_kernels(build_scene(action).tables)._replace(skip=Kernel(none.address, STEP["skip"], none))
    monkeypatch.setattr(simulation, "load_kernels", lambda tables: whole)
    without = model.simulate(action, force[:, 0], force[:, 1])
    np.testing.assert_array_equal(with_skips.angle_rad, without.angle_rad)
    np.testing.assert_array_equal(with_skips.speed_rad_per_s, without.speed_rad_per_s)
    assert without.counters["n_contacts_skipped"] == 0
    both = with_skips.counters["n_contacts_skipped"] + with_skips.counters["n_contact_evaluations"]
    assert both == without.counters["n_contact_evaluations"]
    assert both == len(build_scene(action).contacts) * with_skips.counters["n_rhs"]  # each once a stage, skipped or not
    assert with_skips.counters["n_contacts_skipped"] > 0.4 * both


def test_a_switched_element_compiles_once_and_is_then_loaded(
    action: model.Action, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    times, forces = [0.0, 0.01], [0.0, 1.0]

    def counts(changed: model.Action) -> tuple[int, int]:
        before = dict(scenes.COMPILED)
        model.simulate(changed, times, forces, scene="key", initial=rest, output_time_s=[0.01])
        return tuple(scenes.COMPILED[k] - before[k] for k in ("scenes", "compiled"))  # type: ignore[return-value]

    full = model.rest_state(action)
    rest = replace(full, angle_rad=full.angle_rad[:1])
    monkeypatch.setattr(compiling, "FOLDER", tmp_path)
    monkeypatch.setattr(scenes, "_loaded", {})
    switched = action.with_values({"contact03": 0.0})
    assert counts(action) == (1, 1)
    assert counts(action.with_values({"key.mass": 0.1, "contact02.normal.D": 0.5})) == (0, 0)
    assert counts(switched) == (1, 1)
    assert counts(switched) == (0, 0) and counts(action) == (0, 0)
    monkeypatch.setattr(scenes, "_loaded", {})  # as in the next process
    assert counts(switched) == (1, 0) and counts(action) == (1, 0)
