"""A motor driven by volts: closed forms, energy, errors of the request, limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import model
from model import build_scene

ACTION = model.load_action("hirschkorn2004-regulated")
FORTE = model.force_table("forte")
PER_VOLT = 0.1 / 1.2  # V for a newton at the tip: 100 mm, 1.2 N m/V
TORQUE, VOLTAGE = model.SCENES["motor-drive"], model.SCENES["motor-voltage"]
KEY_ALONE = {"bodies": ("key",)}
BARE = {"motor_arm.contact_c": 0.0, "motor_arm.joint_friction": 0.0, "motor_arm.spring_stiffness": 0.0}
BARE |= {"motor_arm.preload_n": 0.0, "motor_arm.inertia": 2e-4}
HELD = {"motor_drive.torque_constant": 1e-9}  # as if it could not turn
LIMITED = {"motor_drive.current_limit": 1.5, "motor_drive.supply": 20.0}


def _bare(choice: model.SceneChoice, values: dict[str, float], volts: float, at: np.ndarray, **options: float):
    """Speed of the arm and current after a step of the command; the arm touches nothing."""
    scene = build_scene(choice.on(ACTION.with_effects(BARE | values)), replace(choice, **KEY_ALONE))
    run = model.Simulation(scene, model.State(0.0, np.zeros(3), np.zeros(3)), options.pop("tolerance", 1e-9), **options)
    _, speed = run.advance(at[-1], np.array([0.0]), np.array([volts]), held=True, output_time_s=at)
    return speed[:, 1], speed[:, 2]


def test_current_in_a_locked_motor_rises_as_its_circuit_says() -> None:
    at = np.linspace(0.0, 0.02, 41)
    d = {k: VOLTAGE.on(ACTION)[f"motor_drive.{k}"] for k in ("resistance", "inductance")}
    _, current = _bare(VOLTAGE, HELD, 1.5, at)
    expected = 3.0 / d["resistance"] * -np.expm1(-at * d["resistance"] / d["inductance"])
    np.testing.assert_allclose(current, expected, atol=1e-7)
    at = np.linspace(0.0, 2e-3, 41)
    _, current = _bare(TORQUE, HELD, 1.5, at)
    np.testing.assert_allclose(current, -3.0 * np.expm1(-at * 21.0 / 3e-3), atol=1e-7)


def test_a_free_motor_runs_up_as_its_two_equations_say() -> None:
    at = np.linspace(0.0, 0.05, 51)
    speed, current = _bare(VOLTAGE, {}, 1.0, at)
    resistance, inductance, k, inertia = 1.0, 3e-3, 0.6, 2e-4
    a = np.array(
        [[0.0, k / inertia, 0.0], [-k / inductance, -resistance / inductance, 2.0 / inductance], [0.0, 0.0, 0.0]]
    )
    exact = np.array([(expm(a * t) @ [0.0, 0.0, 1.0])[:2] for t in at])
    np.testing.assert_allclose(speed, exact[:, 0], atol=1e-6)
    np.testing.assert_allclose(current, exact[:, 1], atol=1e-6)


def test_current_and_voltage_stay_within_their_limits() -> None:
    at = np.linspace(0.0, 0.02, 201)
    _, current = _bare(VOLTAGE, LIMITED | HELD, 10.0, at)
    over = 2.0 * LIMITED["motor_drive.supply"] / 100.0  # what it takes to give way to twice the supply
    assert 1.5 < current.max() < 1.5 + over
    _, current = _bare(TORQUE, LIMITED | HELD, 10.0, at)
    assert current.max() < 1.5
    # the supply, not the loop, says how fast it rises
    assert current[1] == pytest.approx(-20.0 * np.expm1(-1e-4 / 3e-3), rel=0.01)


def hand(depth_m: float, duration_s: float = 0.08) -> tuple[np.ndarray, np.ndarray]:
    """Way of a hand that sinks smoothly, holds and comes back."""
    t = np.linspace(0.0, 1.0, 25)
    down = depth_m * (3.0 * t**2 - 2.0 * t**3)
    return np.concatenate([[0.0], 0.05 + duration_s * t, [0.4, 0.45, 0.7]]), np.concatenate(
        [[0.0], down, [depth_m, 0, 0]]
    )


def test_energy_closes_and_errors_stay_within_ten_times_the_request() -> None:
    action = ACTION.with_effects(LIMITED)
    finest, lost = closes_and_keeps(action, TORQUE, FORTE[0], PER_VOLT * FORTE[1])
    current = finest.speed_rad_per_s[:, 6]
    heat = action["motor_drive.resistance"] * current**2
    assert lost == pytest.approx(np.sum(0.5 * (heat[1:] + heat[:-1]) * np.diff(finest.time_s)), rel=2e-3)
    assert np.abs(current).max() > 1.3


def test_so_they_do_with_a_finger() -> None:
    _, lost = closes_and_keeps(ACTION, model.SCENES["finger"], *hand(0.03), output_time_s=np.linspace(0.0, 0.7, 701))
    assert lost > 0.0


def closes_and_keeps(
    action: model.Action, choice: model.SceneChoice, times: np.ndarray, values: np.ndarray, **options: np.ndarray
) -> tuple[model.Solution, float]:
    """The finest run and what the drive of another lost."""
    runs = {
        tolerance: model.simulate(action, times, values, scene=choice, tolerance=tolerance, energy=True, **options)
        for tolerance in (1e-3, 1e-6, 1e-9, 1e-11)
    }
    finest = runs.pop(1e-11)
    for tolerance, found in runs.items():
        error = np.abs(found.angle_rad[:, :6] - finest.angle_rad[:, :6]).max()
        assert error < 10.0 * tolerance, (tolerance, error)
    audit = runs[1e-9].energy
    assert audit is not None and abs(audit.residual) < 1e-6 * audit.work_in
    return finest, audit.lost_in_drive
