"""Two heads on the key's scale: rotation without the false reading of a lift, and the lift itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import model
import rig
from validation.measurement.force_correction import Quiet
from validation.measurement.key_heads import two_heads
from validation.measurement.session import measure_session
from validation.prediction.model_under_test import ModelUnderTest


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[rig.Session, np.ndarray, np.ndarray]:
    """A session whose specimen's key lifts, and the truth of its only trial: rotation and lift since rest."""
    bench = rig.open_backend("sim://?effects=balance_rail", rig.load_rig("key_lift").config)
    folder: Path = tmp_path_factory.mktemp("heads") / "session"
    session = rig.record(folder, trials=1, rig_config="key_lift", backend=bench)
    truth = bench.plant.truth()  # type: ignore[attr-defined]
    bench.close()
    lift = truth.column("key_lift")
    return session, truth.angle_rad[:, 0] - truth.angle_rad[0, 0], lift - lift[0]


def test_rotation_and_lift_are_those_of_the_specimen(recorded: tuple[rig.Session, np.ndarray, np.ndarray]) -> None:
    session, rotation, lift = recorded
    data = session.trial(1).read()
    n = min(rotation.size, data.n_valid)
    one = data.angle_rad()[:, 0]
    heads = two_heads(data, one)
    assert heads is not None and lift.max() > 1e-4
    assert np.std(heads.lift_m[:n] - lift[:n]) < 1.5 * heads.u_lift_m < 1e-6
    assert np.abs(heads.lift_m[:n] - lift[:n]).max() < 6 * heads.u_lift_m + 2 * heads.u_radius_relative * lift.max()
    assert np.abs(one[:n] - rotation[:n]).max() > 4e-3  # one head reads the lift as rotation
    assert np.abs(heads.rotation_rad[:n] - rotation[:n]).max() < 2e-5
    note = heads.note(Quiet(stop=1500, start_s=0.0, end_s=0.3, onset_s=0.35))
    assert f"lifts by up to {1e3 * lift.max():.3f} mm (u 0.001 mm)" in note


def test_a_trial_with_one_head_has_no_second(tmp_path: Path) -> None:
    data = rig.record(tmp_path / "s", profile="piano", trials=1).trial(1).read()
    assert two_heads(data, data.angle_rad()[:, 0]) is None


def test_the_report_reads_the_key_by_both(recorded: tuple[rig.Session, np.ndarray, np.ndarray]) -> None:
    session, rotation, _ = recorded
    measured = measure_session(session, ModelUnderTest(model.load_action()).geometry_at, u_rest_level_m=5e-5)
    (trial,) = measured.trials
    assert any("lifts by up to" in note for note in trial.notes)
    n = min(rotation.size, trial.change_rad.shape[0])
    assert np.abs(trial.change_rad[:n, 0] - rotation[:n]).max() < 2e-5
