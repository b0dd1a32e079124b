"""Derivatives of normal forces in closed form, against differences of the forces written as loops."""

from __future__ import annotations

import numpy as np

import model
from model.codegen.evaluate_observables import contacts_at
from model.codegen.observable_columns import NORMAL
from model.kernels.lanes import allocate_aligned
from model.sensitivity.parameter_names import directions
from model.sensitivity.tangents import RecordedMotion, _Run
from model.simulation.statics import solve_rest


def test_normal_forces_of_all_numbers_agree_with_differences(action: model.Action) -> None:
    choice = model.load_scene("whole")
    ends = (".x", ".y", ".radius", ".arc_start", ".arc_end", ".c", ".D")
    paths = [path for path in action.quantities if path.endswith(ends) and "second.normal" not in path]
    paths = [path for path in paths if "contact" in path or ".pivot." in path]
    slopes = directions(action, choice, model.sensitivity.find_parameters(action, paths))
    scene, random, count, m = slopes.scene, np.random.default_rng(5), len(paths), 12
    recorded = object.__new__(RecordedMotion)  # without a motion: states that no blow would give are tested too
    recorded.run, recorded.directions = _Run(slopes), slopes
    angle = solve_rest(scene) + random.normal(0.0, 0.05, (m, scene.size))
    speed = random.normal(0.0, 0.3, (m, scene.size))
    filled = recorded.run.space.load.shape[2]
    moved = (
        allocate_aligned(m, scene.size, filled),
        allocate_aligned(m, scene.size, filled),
        allocate_aligned(m, 0, filled),
    )
    for part in moved[:2]:
        part[:, :, :count] = random.normal(0.0, 1.0, (m, scene.size, count))
    found_force, found = recorded.normal_forces(np.concatenate([angle, speed], axis=1), moved)
    assert found.shape == (m, len(scene.contacts), count)

    def forces(j: int, state: float, number: float) -> np.ndarray:
        q, v = (x + state * d[:, :, j] for x, d in zip((angle, speed), moved[:2], strict=True))
        return contacts_at(scene.tables, scene.vector + number * slopes.slope[j], q, v)[:, :, NORMAL]

    np.testing.assert_allclose(found_force, forces(0, 0.0, 0.0), rtol=1e-12, atol=1e-12)
    pushing = set(np.flatnonzero((found_force > 0.0).any(axis=0)).tolist())
    assert len(pushing) >= 8  # round, straight and curved surfaces
    for j, path in enumerate(paths):
        h, number = 1e-8, slopes.parameters[j].step
        wanted = (forces(j, h, 0.0) - forces(j, -h, 0.0)) / (2.0 * h)
        wanted += (forces(j, 0.0, number) - forces(j, 0.0, -number)) / (2.0 * number)
        noise = 1e-14 * np.max(found_force) / min(h, number)
        np.testing.assert_allclose(
            found[:, :, j], wanted, rtol=3e-5, atol=1e-7 * np.max(np.abs(wanted)) + noise, err_msg=path
        )
    silent = found_force == 0.0
    assert not np.any(found[silent])
