"""A law of `examples/`, written as docs/howto/contact_law.md says: jobs take it and are right at once."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

import model
from model import Simulation, State
from tests.model.kernels.linearised import stages_off
from tests.model.simulation.test_effects_and_jobs import Job, go_on_by_blocks, look_inside, simulate

EXAMPLES = Path(__file__).parents[4] / "examples"
LAWS = {"two-times": ("felt_with_two_times", "TwoTimes")}
FELTS = ("contact02", "contact04", "contact12")  # key front, back check (with friction), hammer


@pytest.fixture(scope="module", params=LAWS)
def action(request: pytest.FixtureRequest) -> model.Action:
    """The regulated action with that law on three felts; the law is loaded as a user would, by running its file."""
    file, kind = LAWS[request.param]
    spec = spec_from_file_location(file, EXAMPLES / f"{file}.py")
    assert spec is not None and spec.loader is not None
    sys.modules[file] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[file])
    model.add_law(getattr(sys.modules[file], kind)())
    return model.load_action("hirschkorn2004-regulated").with_laws(dict.fromkeys(FELTS, request.param))


def test_a_stage_solves_the_system_with_the_jacobian_of_differences(action: model.Action) -> None:
    times, force = model.force_table("forte")
    scene = model.build_scene(action)
    run = Simulation(scene, State(0.0, model.rest_state(action).angle_rad, np.zeros(scene.size)), 1e-7)
    angles, speeds = run.advance(0.2, times, force, output_time_s=np.linspace(0.1, 0.2, 1001))
    wrong, checked = stages_off(run, angles, speeds, [*range(20, 1001, 25), *range(104, 112, 2)])
    assert checked == set(FELTS)
    assert max(wrong) < 1e-5


def test_along_a_press_the_law_is_followed_however_it_is_sampled(action: model.Action) -> None:
    """Through partings, and where one of two layers parts: a first-order error would be 2 % of the force."""
    felt = model.felt.NamedLaw(action.law("contact12"), 4.41e10, -1.02e7, 1.57e4)
    time_s = np.linspace(0.0, 0.02, 64_001)
    depth_m = 6e-4 * np.sin(2.0 * np.pi * 80.0 * time_s) * np.cos(2.0 * np.pi * 23.0 * time_s)
    fine, coarse = felt.response(time_s, depth_m), felt.response(time_s[::16], depth_m[::16])
    for of_fine, of_coarse in zip(fine, coarse, strict=True):
        np.testing.assert_allclose(of_coarse, of_fine[::16], rtol=0.0, atol=2e-4 * of_fine.max())


@pytest.mark.parametrize("job", [simulate, go_on_by_blocks, look_inside])
def test_jobs_are_right(action: model.Action, job: Job) -> None:
    """Energies close, as from outside so by what each contact loses; a run goes on block by block."""
    job(action, model.SceneChoice())
