"""A string of modes in place of the bar: against a blow computed apart, dense algebra, energy and rest."""

from __future__ import annotations

import runpy
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import model
from model.codegen.load import load_kernels
from model.elements.strings import AWAKE
from model.kernels import workspace as W
from model.scene.string_terms import moved_modes, string_of
from model.simulation.run import Simulation, State
from model.simulation.statics import solve_rest
from model.simulation.string_motion import string_loss, string_motion

STRUNG = model.load_scene("string")
FORTE = model.force_table("forte")
MID_BLOW_S = 0.112  # the hammer is on the string


@pytest.fixture(scope="module")
def action() -> model.Action:
    return model.load_action("hirschkorn2004-regulated")


def started(action: model.Action, tolerance: float = 1e-5, **keywords: bool) -> Simulation:
    scene = model.build_scene(action, STRUNG)
    return Simulation(scene, State(0.0, solve_rest(scene), np.zeros(scene.size)), tolerance, **keywords)


def test_a_stage_solves_the_system_with_the_jacobian_of_differences(action: model.Action) -> None:
    run = started(action.with_effects({"string.modes": 4}), 1e-7)
    run.advance(MID_BLOW_S, *FORTE)
    scene, n, z = run.scene, 5, len(run.state.memory)
    kernels, w = load_kernels(scene.tables), np.zeros(W.WITH_MEMORY)
    assert run.state.memory[0] == AWAKE

    def rates(y: np.ndarray) -> np.ndarray:
        w[W.Q : W.Q + n], w[W.V : W.V + n], w[W.Z + 2 : W.Z + z] = y[:n], y[n : 2 * n], y[2 * n :]
        w[W.Z] = AWAKE
        kernels.linearise(w, scene.vector, 12.0)
        k = (z - 2) // 2
        ways, speeds = y[2 * n : 2 * n + k], y[2 * n + k :]
        gain, stiffness, damping = w[W.S_NUMBERS : W.S_NUMBERS + 3 * W.MOST_MODES].reshape(3, -1)[:, :k]
        bent = gain * w[W.S_FORCE] - damping * speeds - stiffness * ways
        return np.concatenate([y[n : 2 * n], w[W.ACC : W.ACC + n], speeds, bent])

    y = np.concatenate([run.state.angle_rad, run.state.speed_rad_per_s, run.state.memory[2:]])
    sizes = np.concatenate([np.full(n, 1e-9), np.full(n, 1e-5), np.full(4, 1e-9), np.full(4, 1e-5)])
    columns = [
        (rates(y + size * row) - rates(y - size * row)) / (2.0 * size)
        for size, row in zip(sizes, np.eye(len(y)), strict=True)
    ]
    right, gh = rates(y), 1e-5
    assert w[W.S_FORCE] > 5.0
    assert kernels.prepare(w, gh) == 1
    kernels.stage(w, scene.vector, np.zeros(64), np.zeros(64), 0, gh, 1.0 / 4e-5, 12.0, 0.0, 0)
    u = np.concatenate([w[W.U : W.U + n], w[W.U + W.WIDTH : W.U + W.WIDTH + n], w[W.Z_U + 2 : W.Z_U + z]])
    dense = np.linalg.solve(np.eye(len(y)) / gh - np.column_stack(columns), right)
    for part in (slice(0, 5), slice(5, 10), slice(10, 14), slice(14, None)):
        np.testing.assert_allclose(u[part], dense[part], rtol=0, atol=1e-6 * np.max(np.abs(dense[part])))


def test_a_blow_is_that_of_the_string_computed_apart(action: model.Action) -> None:
    """A hammer alone, weightless, without friction, against `examples/thesis/string_blow.py` with all modes."""
    # the head level with the pivot where it touches: its arc is straight there, its lever constant
    level = {
        "contact12.first.y": 0.0,
        "contact12.second.y": action["hammer.pivot.y"] + action["contact12.first.radius"],
    }
    smooth = action.with_values({"gravity.g": 0.0, "hammer.joint_friction": 0, **level})
    smooth = smooth.with_effects({"string.modes": 100})
    off = tuple(f"contact{k:02d}" for k in range(1, 14) if k != 12)
    choice = model.SceneChoice(("key", "hammer"), without=off, effects=("string",))
    scene = model.build_scene(smooth, choice)
    arm = abs(smooth["contact12.first.x"])
    start = np.array([0.0, 1e-5 / arm])
    speed = 2.0
    run = Simulation(scene, State(0.0, start, np.array([0.0, -speed / arm])), 1e-7)
    at = np.linspace(0.0, 5e-3, 5001)
    angles, speeds = run.advance(5e-3, np.array([0.0, 1.0]), np.zeros(2), output_time_s=at)
    force = run.contact_forces(angles, speeds)[0][:, scene.contacts.index("contact12")]
    x, y = smooth["hammer.center_of_mass.x"], smooth["hammer.center_of_mass.y"]
    mass = (smooth["hammer.inertia"] + smooth["hammer.mass"] * (x * x + y * y)) / arm**2
    law = {k.lower(): smooth[f"contact12.normal.{k}"] for k in ("a", "b", "c", "D")}
    example = runpy.run_path(str(Path(__file__).parents[3] / "examples" / "thesis" / "string_blow.py"))
    string = example["String"](**asdict(string_of(smooth)))
    apart = example["strike"](string, example["Hammer"](mass, **law), speed, modes=200)
    ours, theirs = at[force > 0.0], apart.time_s[apart.force_n > 0.0]
    assert np.ptp(ours) == pytest.approx(np.ptp(theirs), rel=2e-3)
    assert force.max() == pytest.approx(apart.force_n.max(), rel=1e-3)
    shifted = np.interp(at - ours[0] + theirs[0], apart.time_s, apart.force_n, right=0.0)
    assert np.sqrt(np.mean((shifted - force) ** 2)) < 3e-3 * force.max()
    assert speeds[-1, 1] * arm / speed == pytest.approx(apart.rebound, abs=5e-4)


def test_energy_balances_and_a_ringing_string_is_met_again(action: model.Action) -> None:
    """The forte on a string that already rings: the modes are carried on in closed form, then stepped."""
    run = started(action, 1e-9, energy=True)
    count = len(moved_modes(action))
    run.state.memory[2 : 2 + 6] = 2e-4  # released before the first instant
    start, stored = run.state.copy(), run.stored_energy()
    run.advance(0.5, *FORTE)
    given, *lost = run.audit
    lost[-1] += string_loss(run.scene, (start.time_s, run.state.time_s), (start.memory, run.state.memory))
    assert abs(given - (run.stored_energy() - stored) - sum(lost)) < 1e-6 * given
    assert lost[-1] > 0.05 * given and run.state.memory[1] > 1e-6  # lost before the hammer came near
    assert len(run.state.memory) == 2 + 2 * count


def test_felt_that_leaves_a_string_faster_than_it_can_follow_loses_what_it_stored(action: model.Action) -> None:
    damped = action.with_values({"contact12.normal.D": 6.0})  # 1 + D dx/dt < 0: it presses no more, and is deep still
    run = model.simulate(damped, *FORTE, scene=STRUNG, tolerance=1e-8, energy=True)
    assert run.energy is not None and abs(run.energy.residual) < 1e-6 * run.energy.work_in


def test_free_modes_wait_and_swing_on_in_closed_form(action: model.Action) -> None:
    run = started(action)
    at = np.array([0.3, 0.3 + 1e-4, 0.4])
    run.advance(0.4, *FORTE, output_time_s=at)
    assert run.state.memory[0] > 0.11  # left alone since then
    seen = string_motion(run.scene, at, run.remembered)
    assert seen is not None
    y, u, omega = seen.mode_m, seen.mode_m_per_s, seen.omega_rad_per_s
    sigma = string_of(action).decay(moved_modes(action))
    swing = np.sqrt(omega**2 - sigma**2)
    later = np.exp(-1e-4 * sigma) * (y[0] * np.cos(1e-4 * swing) + (u[0] + sigma * y[0]) / swing * np.sin(1e-4 * swing))
    np.testing.assert_allclose(y[1], later, atol=1e-12)
    amplitude = np.hypot(y, (u + sigma * y) / swing)
    np.testing.assert_allclose(amplitude[2], amplitude[0] * np.exp(-0.1 * sigma), rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(seen.way_m, y.sum(axis=1))


@pytest.mark.parametrize(
    ("values", "laws", "message"),
    [
        ({"contact12.friction.A": 0.1}, {}, "string: found contact12.friction.A above 0"),
        ({}, {"contact12": "stulov"}, "string: found contact12.law stulov, allowed hunt-crossley"),
        ({"string.modes": 200.0}, {}, "string.modes: found 200, allowed from 0 to 100"),
    ],
)
def test_what_is_refused(action: model.Action, values: dict[str, float], laws: dict[str, str], message: str) -> None:
    with pytest.raises(model.InputError) as caught:
        model.build_scene(action.with_laws(laws).with_values(values), STRUNG)
    assert message in str(caught.value)


def test_a_string_without_its_contact_is_refused() -> None:
    with pytest.raises(model.InputError, match="add them or leave out string"):
        model.SceneChoice(without=("contact12",), effects=("string",))
