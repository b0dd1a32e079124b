"""What parameters add to the forces against differences of the accelerations."""

from __future__ import annotations

import numpy as np

import model
from model import Scene
from model.integrators.tangents.linearised_nodes import linearise_node
from model.kernels import workspace as W
from model.sensitivity.parameter_names import directions
from model.sensitivity.tangents import _Run
from model.simulation.statics import solve_rest
from tests.model.kernels.linearised import Evaluation


def accelerations(scene: Scene, state: tuple[np.ndarray, np.ndarray, float], vector: np.ndarray) -> np.ndarray:
    return Evaluation(scene, *state, vector).a


def test_loads_of_all_numbers_agree_with_differences(action: model.Action) -> None:
    choice = model.load_scene("whole")
    paths = model.sensitivity.effective_paths(action, choice)
    slopes = directions(action, choice, model.sensitivity.find_parameters(action, paths))
    scene, run = slopes.scene, _Run(slopes)
    n = scene.size
    rest = solve_rest(scene)
    random = np.random.default_rng(3)
    acted: set[str] = set()
    for turn in (4e-3, 0.03, 0.06, 0.09):
        q = rest + random.normal(0.0, turn, n)
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
