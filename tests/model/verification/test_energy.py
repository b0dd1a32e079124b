"""Energies and powers against the twin by finite differences, and against a pendulum and a flywheel in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import model
from tests.model.conftest import random_states, read_table
from tests.model.verification.energy import energy_terms, felt_energy
from tests.model.verification.energy_audit import audit
from tests.model.verification.reference_equations import Twin

FREE = {f"contact{i:02d}": 0.0 for i in range(1, 14)} | {f"{b}_spring": 0.0 for b in ("jack", "repetition")}
SMOOTH = {f"{b}.joint_friction": 0.0 for b in model.BODIES}


def total(action: model.Action, q: np.ndarray, v: np.ndarray) -> float:
    return float(sum(part[0] for part in energy_terms(action, q, v, 0.0)[0].values()))


def test_kinetic_energy_is_that_of_the_twins_mass_matrix(action: model.Action, twin: Twin) -> None:
    for q, v, force in random_states(50, 3):
        _, mass = twin.forces_and_mass(q, v, force)
        assert energy_terms(action, q, v, force)[0]["kinetic"][0] == pytest.approx(0.5 * v @ mass @ v, rel=1e-12)


def test_slope_of_the_energy_is_the_twins_force_at_rest(action: model.Action, twin: Twin) -> None:
    step, still = 1e-6, np.zeros(5)
    for q, _, _ in random_states(25, 4):
        force, _ = twin.forces_and_mass(q, still, 0.0)
        slope = [total(action, q + step * e, still) - total(action, q - step * e, still) for e in np.eye(5)]
        np.testing.assert_allclose(np.array(slope) / (2 * step), -force, rtol=0, atol=1e-7 * np.abs(force).max())


@pytest.mark.parametrize("pocket", [False, True])
def test_energy_changes_by_what_flows(action: model.Action, pocket: bool) -> None:
    """d(stored)/dt along the twin's motion = input - losses; with friction, damping, separation and contact.

    With ``pocket`` every felt's static law is negative over part of its range; it still takes energy only.
    """
    if pocket:
        felts = [f"contact{i:02d}.normal" for i in range(1, 14)]
        action = action.with_values({f"{f}.b": -((6.0 * action[f"{f}.a"] * action[f"{f}.c"]) ** 0.5) for f in felts})
    twin = Twin(action)
    step = 1e-9
    for q, v, force in random_states(80, 5):
        a = twin.acceleration(q, v, force)
        late, early = (q + s * v + 0.5 * s * s * a for s in (step, -step))
        rate = (total(action, late, v + step * a) - total(action, early, v - step * a)) / (2 * step)
        stored, powers = energy_terms(action, q, v, force)
        pull = np.abs(twin.forces_and_mass(q, np.zeros(5), force)[0]).sum()  # what a rounded angle is worth
        rounding = 4e-16 * (pull + max(abs(part[0]) for part in stored.values())) / step
        flow = {name: power[0] for name, power in powers.items()}
        net = flow["input"] - flow["joint_friction"] - flow["contact_friction"] - flow["felt_damping"]
        size = max(abs(power) for power in flow.values())
        assert rate == pytest.approx(net, rel=1e-5, abs=1e-5 * size + rounding)
        assert min(flow["joint_friction"], flow["contact_friction"], flow["felt_damping"]) >= 0.0


@pytest.mark.parametrize("a, b, c", [(3e10, -1e7, 6e3), (1e10, -3e7, 1e4), (0.0, -1e6, 1e3), (1e9, 1e6, 1e3)])
def test_felt_energy_is_the_integral_of_a_force_that_never_pulls(a: float, b: float, c: float) -> None:
    s = np.linspace(0.0, 3e-3, 300_001)
    force = np.maximum(0.0, ((a * s + b) * s + c) * s)
    steps = 0.5 * (force[1:] + force[:-1]) * np.diff(s)
    expected = np.concatenate([[0.0], np.cumsum(steps)])
    np.testing.assert_allclose(felt_energy(a, b, c, s), expected, rtol=1e-6, atol=1e-12)
    assert felt_energy(a, b, c, np.array([-1e-3]))[0] == 0.0


def states_of(action: model.Action, start: np.ndarray, tolerance: float, times: np.ndarray, force: np.ndarray):
    scene = model.build_scene(action)

    def states(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        run = model.Simulation(scene, model.State(float(times[0]), start.copy(), np.zeros(5)), tolerance=tolerance)
        return run.advance(float(at[-1]), times, force, output_time_s=at)

    return states


def test_pendulum_in_closed_form(action: model.Action) -> None:
    """The hammer alone is a pendulum: its speed at an angle follows from the height of its centre of mass."""
    free = action.with_values(FREE | SMOOTH)
    m, inertia, g = (free[p] for p in ("hammer.mass", "hammer.inertia", "gravity.g"))
    x, y = free["hammer.center_of_mass.x"], free["hammer.center_of_mass.y"]
    lever, lean = np.hypot(x, y), np.arctan2(y, x)
    q = np.zeros((7, 5))
    q[:, 4] = np.linspace(0.0, 2.0, 7)
    drop = lever * (np.sin(lean) - np.sin(lean + q[:, 4]))
    v = np.zeros((7, 5))
    v[:, 4] = np.sqrt(np.maximum(0.0, 2.0 * m * g * drop / (inertia + m * lever**2)))
    stored, powers = energy_terms(free, q, v, np.zeros(7))
    falls = drop >= 0.0
    assert falls.sum() > 3
    sums = sum(stored.values())[falls]
    np.testing.assert_allclose(sums, sums[0], rtol=1e-12)
    assert np.ptp(stored["kinetic"][falls]) > 1e-3
    assert all(np.all(p == 0.0) for p in powers.values())
    times = np.array([0.0, 0.4])
    balance = audit(free, states_of(free, q[0], 1e-9, times, np.zeros(2)), (0.0, 0.4), (times, np.zeros(2)))
    assert balance.residual < 1e-8 and balance.turnover_j > 1e-3


def test_a_weightless_hammer_loses_what_its_joint_takes(action: model.Action) -> None:
    """Constant torque A against a free spin: lost work = A times the turned angle."""
    free = action.with_values(FREE | SMOOTH | {"gravity.g": 0.0, "hammer.joint_friction.A": 2e-3})
    scene = model.build_scene(free)
    times, nothing = np.array([0.0, 0.3]), np.zeros(2)
    speed = np.array([0.0, 0.0, 0.0, 0.0, 40.0])

    def states(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        run = model.Simulation(scene, model.State(0.0, np.zeros(5), speed.copy()), tolerance=1e-9)
        return run.advance(float(at[-1]), times, nothing, output_time_s=at)

    balance = audit(free, states, (0.0, 0.3), (times, nothing))
    turned = states(times)[0][-1, 4]
    assert balance.flow_j["joint_friction"][-1] == pytest.approx(2e-3 * turned, rel=1e-7)
    assert balance.residual < 1e-8


def test_balance_of_a_blow_closes_and_follows_the_tolerance(action: model.Action) -> None:
    table = read_table("forte_force.csv")
    times, force = table[:, 0], table[:, 1]
    start = model.rest_state(action).angle_rad
    residual = {}
    for tolerance in (1e-3, 1e-5, 1e-7):
        states = states_of(action, start, tolerance, times, force)
        residual[tolerance] = audit(action, states, (times[0], times[-1]), (times, force), goal=1e-8).residual
    assert residual[1e-5] < 1e-5
    assert residual[1e-7] < 3e-8
    assert residual[1e-7] < residual[1e-5] < residual[1e-3]


def test_a_wrong_motion_is_noticed(action: model.Action) -> None:
    """A hundredth of the hammer's speed amiss opens the balance by far more than a good solution's."""
    table = read_table("forte_force.csv")
    times, force = table[:, 0], table[:, 1]
    good = states_of(action, model.rest_state(action).angle_rad, 1e-6, times, force)

    def states(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q, v = good(at)
        return q, v * np.array([1.0, 1.0, 1.0, 1.0, 1.01])

    assert audit(action, states, (times[0], times[-1]), (times, force)).residual > 1e-3
