"""The energy audit: the work of the force is what is lost in felt, contacts and joints, and what is stored."""

from __future__ import annotations

import numpy as np
import pytest

import model
from tests.model.conftest import read_table


def read_force(name: str) -> tuple[np.ndarray, np.ndarray]:
    force = read_table(f"{name}_force.csv")
    return force[:, 0], force[:, 1]


def test_it_closes_and_closes_better_at_tighter_tolerance(action: model.Action) -> None:
    time, force = read_force("noisy")
    for tolerance, most in ((1e-5, 1e-5), (1e-9, 2e-9)):
        energy = model.simulate(action, time, force, output_time_s=[0.6], tolerance=tolerance, energy=True).energy
        assert energy is not None and abs(energy.residual) < most * energy.work_in
        lost = (energy.lost_in_felt, energy.lost_in_contact_friction, energy.lost_in_joint_friction)
        assert min(lost) > 0.02 * energy.work_in


def test_work_is_that_of_the_force(action: model.Action) -> None:
    """Work of the force from its table and the key's motion."""
    time, force = read_force("forte")
    fine = np.linspace(0, 0.6, 60_001)
    solution = model.simulate(action, time, force, output_time_s=fine, energy=True)
    height = model.observables.key_front_height_m(action, solution.angle_rad)
    pressed = np.interp(fine, time, force)
    work = -float(np.sum(0.5 * (pressed[1:] + pressed[:-1]) * np.diff(height)))
    assert solution.energy is not None
    assert solution.energy.work_in == pytest.approx(work, rel=1e-5)


def test_it_closes_without_any_loss(action: model.Action) -> None:
    off: dict = {f"{c}.normal.D": 0.0 for c in model.build_scene(action).contacts}
    off |= {f"{c}.friction": 0.0 for c in model.build_scene(action).contacts}
    off |= {f"{b}.joint_friction": 0.0 for b in model.BODIES}
    time, force = read_force("forte")
    for tolerance, most in ((1e-5, 1e-4), (1e-9, 1e-8)):
        energy = model.simulate(
            action.with_values(off), time, force, output_time_s=[0.3], tolerance=tolerance, energy=True
        ).energy
        assert energy is not None
        assert energy.lost_in_felt == energy.lost_in_contact_friction == energy.lost_in_joint_friction == 0.0
        assert abs(energy.residual) < most * energy.work_in
