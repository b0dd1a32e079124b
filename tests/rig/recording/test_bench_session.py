"""The recorder on the whole virtual bench: what is read agrees with the truth within what the bench file declares."""

from __future__ import annotations

import numpy as np
import pytest

from rig.backend import open_backend
from rig.configuration.profile import load_profile
from rig.configuration.rig_file import load_rig
from rig.recording.recorder import record_session
from rig.session import Session
from rig.simulated.backend import DEFAULT_BENCH
from rig.simulated.bench.sensors import load_sensors


@pytest.fixture(scope="module")
def forte(tmp_path_factory):
    """Two forte trials and the truth of each."""
    rig = load_rig("virtual")
    backend = open_backend("sim://?seed=11", rig.config)
    truths = []
    folder = tmp_path_factory.mktemp("bench") / "forte"
    record_session(
        folder, rig_config=rig, backend=backend, trials=2, after_trial=lambda t: truths.append(backend.plant.truth())
    )
    backend.close()
    return [(trial, trial.read(), truth) for trial, truth in zip(Session.open(folder).trials, truths, strict=True)]


def test_forte_spikes_at_key_bottom_as_in_the_thesis_and_comes_to_rest(forte) -> None:
    for trial, data, _ in forte:
        assert trial.status == "complete"
        assert 30 < data.force_n.max() < 37
        assert data.blow_start_s >= 0.3
        assert data.n_valid < 5000 * 3


def test_the_encoders_tell_the_true_angles_within_one_count_and_their_budget(forte) -> None:
    sensors = load_sensors(DEFAULT_BENCH).encoders
    for _, data, truth in forte:
        angle = truth.angles_at(data.time_s)[:, [0, 1, 4]]
        one_count = 2 * np.pi / np.array([e.counts_per_revolution for e in data.encoders])
        error = data.angle_rad() - (angle - angle[0])
        planted = [
            2 * s.interpolation_rad + s.eccentricity_rad * np.ptp(angle[:, i]) + 3 * s.pivot_shift_rad
            for i, s in enumerate(sensors)
        ]
        # the truth is looked up between edges, hence the small margin at the fastest moment
        assert np.all(np.abs(error).max(axis=0) < 1.05 * one_count + planted)
        for i, (encoder, s) in enumerate(zip(data.encoders, sensors, strict=True)):
            # the rig file states what the bench has: a sine's standard deviation, and each error is inside the budget
            assert encoder.u_interpolation_rad == pytest.approx(s.interpolation_rad / np.sqrt(2), rel=0.02)
            assert encoder.u_eccentricity_rad == pytest.approx(s.eccentricity_rad / np.sqrt(2), rel=0.02)
            assert encoder.u_pivot_shift_rad == s.pivot_shift_rad
            turned = angle[:, i] - angle[0, i]
            u = np.sqrt(encoder.u_change_rad**2 + (encoder.u_turn_relative * turned) ** 2 + one_count[i] ** 2 / 6)
            assert np.all(np.abs(error[:, i]) < 4 * u)


def test_the_force_is_the_true_one_delayed_with_the_declared_gain_offset_hum_and_noise(forte) -> None:
    for _, data, truth in forte:
        later = np.interp(data.time_s - data.force_info.group_delay_s, truth.time_s, truth.force_n)
        cell = load_sensors(DEFAULT_BENCH).force
        phase = 2 * np.pi * cell.hum_hz * data.time_s
        columns = [later, np.ones_like(later), *(f(k * phase) for k in (1, 3) for f in (np.sin, np.cos))]
        fit, *_ = np.linalg.lstsq(np.column_stack(columns), data.force_n, rcond=None)
        assert fit[0] == pytest.approx(1 + cell.gain_error, abs=2e-4)
        assert fit[1] == pytest.approx(cell.offset_n, abs=4 * cell.offset_scatter_n)
        assert np.hypot(*fit[2:4]) == pytest.approx(cell.hum_n[0], abs=0.003)
        assert np.hypot(*fit[4:6]) == pytest.approx(cell.hum_n[2], abs=0.003)
        residual = data.force_n - np.column_stack(columns) @ fit
        assert residual.std() == pytest.approx(cell.noise_n, rel=0.05)
        assert data.force_info.u_noise_n == cell.noise_n  # the rig file states what the bench has


def test_the_same_blow_is_repeated_but_not_identical(forte) -> None:
    (_, first, _), (_, second, _) = forte
    n = min(first.n_valid, second.n_valid)
    difference = first.angle_rad()[:n] - second.angle_rad()[:n]
    assert 0 < np.sqrt(np.mean(difference**2, axis=0)).max() < 0.02


def test_the_motor_was_told_what_the_profile_says(forte) -> None:
    _, data, _ = forte[0]
    start = int(round(0.35 * 5000))
    wanted = load_profile("forte").sample(5000) / 12
    np.testing.assert_array_equal(data.motor_command_v[start : start + wanted.size], wanted)
    assert not data.motor_command_v[:start].any() and not data.motor_command_v[start + wanted.size :].any()
