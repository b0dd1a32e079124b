"""Effects and laws together: what every job of the model says of a scene with several of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import model
from model.sensitivity import find_parameters
from model.simulation.statics import solve_rest
from tests.model.sensitivity.richardson import richardson

FORTE = model.force_table("forte")
ACTION = model.load_action("hirschkorn2004-regulated").with_laws({"contact02": "stulov", "contact04": "hysteresis"})
CHOICE = model.SceneChoice(effects=("balance_rail", "shank", "string", "hammer_pin"))
Job = Callable[[model.Action, model.SceneChoice], None]


def simulate(action: model.Action, choice: model.SceneChoice) -> None:
    """Energies close."""
    found = model.simulate(action, *FORTE, scene=choice, contact_forces=True, energy=True, tolerance=1e-8)
    assert found.energy is not None and found.contact_normal_n is not None
    assert abs(found.energy.residual) < 1e-5 * found.energy.work_in
    assert np.all(np.isfinite(found.angle_rad)) and np.all(found.contact_normal_n >= 0.0)


def go_on_by_blocks(action: model.Action, choice: model.SceneChoice) -> None:
    """As the virtual bench goes on: block by block, held."""
    scene = model.build_scene(choice.on(action), choice)
    run = model.Simulation(scene, model.State(0.0, solve_rest(scene), np.zeros(scene.size)), 1e-6)
    for k in range(100, 130):
        run.advance(1e-3 * (k - 99), np.array([0.0]), FORTE[1][5 * k : 5 * k + 1], held=True)
    whole = model.Simulation(scene, model.State(0.0, solve_rest(scene), np.zeros(scene.size)), 1e-6)
    ends = np.arange(31) * 1e-3  # the same blow as one table of steps
    steps = np.sort(np.concatenate([ends, ends[1:-1] - 1e-9]))
    whole.advance(0.03, steps, FORTE[1][500 + 5 * np.minimum((steps * 1e3 + 1e-7).astype(int), 29)])
    assert np.abs(run.state.angle_rad - whole.state.angle_rad).max() < 2e-5
    assert len(run.state.memory) > 0


def look_inside(action: model.Action, choice: model.SceneChoice) -> None:
    """What contacts and joints lose is what the audit of the same run finds, by another quadrature."""
    found = model.simulate(action, *FORTE, scene=choice, inside=True, energy=True, tolerance=1e-7)
    inside, audit = found.inside, found.energy
    assert inside is not None and audit is not None
    rubbed, felt, joint = (float(rows[-1].sum()) for rows in (inside.rubbed_j, inside.felt_j, inside.joint_j))
    share = 2e-5 * audit.work_in
    assert rubbed == pytest.approx(audit.lost_in_contact_friction, abs=share)
    turning = audit.lost_in_joint_friction + audit.lost_in_shank + audit.lost_in_pins
    assert felt + joint == pytest.approx(audit.lost_in_felt + audit.lost_in_rail + turning, abs=share)
    assert "balance_rail" in choice.effects or joint == pytest.approx(turning, abs=share)


@pytest.mark.parametrize("job", [simulate, go_on_by_blocks, look_inside])
def test_a_job_takes_several_effects_and_laws(job: Job) -> None:
    job(ACTION, CHOICE)


def test_derivatives_by_numbers_of_effects_and_laws_are_those_of_differences() -> None:
    """Of the printed set: a regulated contact only just touches at rest, on a kink."""
    laws = {c: ACTION.law(c) for c in ("contact02", "contact04")}
    action = CHOICE.on(model.load_action().with_laws(laws)).with_effects({"string.modes": 12.0})
    names = ["contact02.stulov.epsilon", "string.tension", "shank.frequency_hz", "hammer_pin.stiffness"]
    at = np.linspace(0.0, 0.125, 501)  # after strike and rebound
    options = model.SensitivityOptions(
        scene=CHOICE, tolerance=1e-10, relative_tolerance=3e-7, output_time_s=at, allow_idle=True
    )
    found = model.sensitivities(action, FORTE, names, options=options)
    for j, parameter in enumerate(find_parameters(action, names)):
        moves = max(float(np.abs(found.d_angles[:, :, j]).max()), 1e-9)
        step = min(2e-5 / moves, 1e-2 * abs(parameter.value))  # angles move by far more than runs are off
        limit, left = richardson(action, FORTE, parameter.name, step, scene=CHOICE, output_time_s=at, tolerance=1e-11)
        largest = np.max(np.abs(limit), axis=0)
        assert largest.any(), parameter.name
        counts = largest > 1e-3 * largest.max()
        apart = (np.abs(found.d_angles[:, :, j] - limit) / np.where(counts, largest, np.inf)).max(axis=1)
        assert np.quantile(apart, 0.9) < 1e-5 + left, parameter.name
        assert apart.max() < 5e-4 + 10.0 * left, parameter.name  # next to kinks
