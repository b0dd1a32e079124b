"""What parameters add to the forces against differences of the accelerations."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.integrators.tangents.nodes import linearise_node
from model.kernels import workspace as W
from model.scene.build import Scene
from model.sensitivity.parameter_names import directions
from model.sensitivity.tangents import Recorded, _Run
from model.simulation.run import with_memory
from model.simulation.statics import solve_rest
from tests.model.kernels.linearised import Evaluation


def accelerations(scene: Scene, state: tuple[np.ndarray, np.ndarray, float], vector: np.ndarray) -> np.ndarray:
    return Evaluation(scene, *state, vector).a


@pytest.mark.parametrize(
    "name",
    [
        "whole",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("motor-arm", "lifting-key-flexible-shank")),
    ],
)
def test_loads_of_all_numbers_agree_with_differences(action: model.Action, name: str) -> None:
    choice = model.load_scene(name)
    paths = model.sensitivity.effective_paths(action, choice)
    slopes = directions(action, choice, model.sensitivity.find_parameters(action, paths))
    scene, run = slopes.scene, _Run(slopes)
    n = scene.size
    rest = solve_rest(scene)
    random = np.random.default_rng(3)
    acted: set[str] = set()
    for turn in (4e-3, 0.03, 0.06, 0.09):
        q = rest + random.normal(0.0, turn, n) * np.where(np.array(scene.bodies) == "key_lift", 0.01, 1.0)
        v, u = random.normal(0.0, 0.3, n), 3.0
        run.space.point[:] = 0.0
        run.space.point[W.Q : W.Q + n], run.space.point[W.V : W.V + n] = q, v
        linearise_node(0, u, run.linear)
        pushes = run.space.point[W.GAP : W.GAP + scene.solved_contacts]
        assert np.min(np.abs(pushes)) > 1e-7  # no contact so near its edge that a difference steps over it
        found = np.linalg.solve(run.space.mass[0], run.space.load[0, :, : len(paths)])
        give = np.max(np.abs(np.linalg.solve(run.space.mass[0], run.space.stiff[0])))
        for j, parameter in enumerate(slopes.parameters):
            h = parameter.step
            ends = [accelerations(scene, (q, v, u), scene.vector + s * h * slopes.slope[j]) for s in (1.0, -1.0)]
            wanted = (ends[0] - ends[1]) / (2.0 * h)
            noise = (1e-14 * np.max(np.abs(ends)) + 1e-15 * give) / h
            np.testing.assert_allclose(
                found[:, j], wanted, rtol=3e-5, atol=3e-6 * np.max(np.abs(wanted)) + noise, err_msg=parameter.name
            )
            if np.any(found[:, j]):
                acted.add(parameter.name)
    contacts = {path.split(".")[0] for path in acted if path.startswith("contact")}
    assert len(contacts) >= 8  # so that curved, straight and round surfaces are among them


@pytest.mark.slow
def test_loads_where_felt_joints_and_string_remember(action: model.Action) -> None:
    """Accelerations, rates of memories and the string's force by all numbers, at states of a blow."""
    laws = {"contact01": "stulov", "contact02": "hysteresis", "contact07": "hysteresis", "contact08": "stulov"}
    choice = model.SceneChoice(effects=("string", "hammer_pin"))
    action = action.with_laws(laws).with_effects({"string.modes": 9.0})
    paths = [p for p in model.sensitivity.effective_paths(action, choice) if p != "string.struck_at"]
    slopes = directions(action, choice, model.sensitivity.find_parameters(action, paths))
    scene, blow = slopes.scene, model.force_table("forte")
    n, felts = scene.size, len(scene.tables.memory)
    rest = solve_rest(scene, whole=True)
    state = with_memory(scene, model.State(0.0, rest[:n].copy(), np.zeros(n)))
    recorded = Recorded(slopes, model.Simulation(scene, state, 1e-7), 0.125, blow, (rest, 0.0))
    run, vector, acted = recorded.run, scene.vector, set[str]()
    size = run.structure.free

    def put(time: float, vector: np.ndarray) -> np.ndarray:
        w = run.workspace()
        row = recorded.whole_states(np.array([time]))[0]
        w[W.Q : W.Q + n], w[W.V : W.V + n], w[W.Z : W.Z + len(row) - 2 * n] = np.split(row, [n, 2 * n])
        w[W.NOW] = time
        return w

    def found(time: float, vector: np.ndarray) -> np.ndarray:
        w = put(time, vector)
        run.kernels.linearise(w, vector, float(np.interp(time, *blow)))
        parts = w[W.P_ACC : W.P_ACC + size], w[W.Z_RATE : W.Z_RATE + felts], w[W.S_FORCE : W.S_FORCE + 1]
        return np.concatenate(parts)

    on_string = next(t for t in np.arange(0.1, 0.12, 2e-4) if found(t, vector)[-1] > 1.0)
    for time in (0.06, 0.1, on_string, 0.115, 0.119):
        run.space.point[:] = put(time, vector)
        linearise_node(0, float(np.interp(time, *blow)), run.linear)
        load, channels = run.space.load[0, :, : len(paths)], run.space.channels
        got = np.concatenate([np.linalg.solve(run.space.mass[0], load), channels.load[0, :, : len(paths)]])
        size_of = np.abs(found(time, vector)) + 1.0
        for j, parameter in enumerate(slopes.parameters):
            # what a difference of twice the step says otherwise is rounding: near a first touch rates go as 1 / depth
            coarse, wanted = (
                (found(time, vector + h * slopes.slope[j]) - found(time, vector - h * slopes.slope[j])) / (2.0 * h)
                for h in (2.0 * parameter.step, parameter.step)
            )
            noise = 4.0 * np.abs(coarse - wanted) + 1e-13 * size_of / parameter.step
            apart = np.abs(got[:, j] - wanted)
            noise += 1e-6 * np.max(np.abs(wanted))
            assert np.all(apart <= 3e-5 * np.abs(wanted) + noise), (time, parameter.name)
            acted |= {parameter.name} if np.any(got[:, j]) else set()
    assert {"contact01.stulov.tau", "contact07.hysteresis.eta", "contact12.normal.b", "hammer.pivot.x"} <= acted
