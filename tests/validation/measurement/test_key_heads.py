"""Two heads on the key's scale: rotation without the false reading of a lift, and the lift itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

import model
import rig
from rig.session.force_correction import Quiet
from rig.simulated import ActionPlant, SimulatedBackend, build_device
from rig.simulated.backend import DEFAULT_BENCH
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, PlantBlock
from rig.simulated.bench.sensors import load_sensors
from validation.measurement.measure_session import measure_session
from validation.measurement.trial import join_key_heads
from validation.prediction.model_under_test import ModelUnderTest

FORCE_PER_VOLT_N = 12.0


class PushedSpecimen(ActionPlant):
    """A specimen pushed by the commanded force itself, without a motor's arm: a scene that other tests compile, too."""

    def advance(self, command_v: ArrayLike) -> PlantBlock:
        force = np.asarray(command_v) * FORCE_PER_VOLT_N
        edges = np.arange(self._edge, self._edge + len(force) + 1) / self.sample_rate_hz
        angles, speeds = self._run.advance(
            edges[-1], edges, np.append(force, force[-1]), held=True, output_time_s=edges[:-1]
        )
        self._edge += len(force)
        self._record.append((edges[:-1], angles, speeds, force))
        encoded = angles[:, [model.BODIES.index(body) for body in ENCODED_BODIES]]
        lift = angles[:, self._names.index("key_lift")]
        return PlantBlock(edges[:-1], force, encoded, np.zeros_like(force), lift)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[rig.Session, np.ndarray, np.ndarray]:
    """A session whose specimen's key lifts, and the truth of its only trial: rotation and lift since rest."""
    config = rig.load_rig("key_lift").config
    choice = model.SceneChoice(effects=("balance_rail", "shank"))
    plant = PushedSpecimen(model.load_action(), choice, 1.0, {}, 1, config.device.sample_rate_hz)
    bench = SimulatedBackend(build_device(config, plant, load_sensors(DEFAULT_BENCH)))
    folder: Path = tmp_path_factory.mktemp("heads") / "session"
    session = rig.record(folder, trials=1, rig_config="key_lift", backend=bench)
    truth = plant.truth()
    bench.close()
    lift = truth.column("key_lift")
    return session, truth.angle_rad[:, 0] - truth.angle_rad[0, 0], lift - lift[0]


def test_rotation_and_lift_are_those_of_the_specimen(recorded: tuple[rig.Session, np.ndarray, np.ndarray]) -> None:
    session, rotation, lift = recorded
    data = session.trial(1).read()
    n = min(rotation.size, data.n_valid)
    one = data.angle_rad[:, 0]
    heads = join_key_heads(data, one)
    assert heads is not None and lift.max() > 1e-4
    assert np.std(heads.lift_m[:n] - lift[:n]) < 1.5 * heads.u_lift_m < 1e-6
    assert np.abs(heads.lift_m[:n] - lift[:n]).max() < 6 * heads.u_lift_m + 2 * heads.u_radius_relative * lift.max()
    assert np.abs(one[:n] - rotation[:n]).max() > 4e-3  # one head reads the lift as rotation
    assert np.abs(heads.rotation_rad[:n] - rotation[:n]).max() < 2e-5
    note = heads.note(Quiet(stop=1500, start_s=0.0, end_s=0.3, onset_s=0.35))
    assert f"lifts by up to {1e3 * lift.max():.3f} mm (standard uncertainty 0.001 mm)" in note


def test_a_correction_of_the_first_head_for_its_scale_goes_before_the_two_are_joined(recorded: Any) -> None:
    data = recorded[0].trial(1).read()
    key, *others = data.encoders
    corrected = replace(data, encoders=(replace(key, arc_gain=1.004), *others))
    heads, plain = join_key_heads(corrected, corrected.angle_rad[:, 0]), join_key_heads(data, data.angle_rad[:, 0])
    np.testing.assert_allclose(heads.lift_m, plain.lift_m, atol=1e-12)
    np.testing.assert_allclose(heads.rotation_rad, plain.rotation_rad, atol=1e-12)


def test_a_trial_with_one_head_has_no_second(tmp_path: Path) -> None:
    data = rig.record(tmp_path / "s", profile="piano", trials=1).trial(1).read()
    assert join_key_heads(data, data.angle_rad[:, 0]) is None


def test_the_report_reads_the_key_by_both(recorded: tuple[rig.Session, np.ndarray, np.ndarray]) -> None:
    session, rotation, _ = recorded
    measured = measure_session(session, ModelUnderTest(model.load_action()).geometry_at, u_rest_level_m=5e-5)
    (trial,) = measured.trials
    assert any("lifts by up to" in note for note in trial.notes)
    n = min(rotation.size, trial.change_rad.shape[0])
    assert np.abs(trial.change_rad[:n, 0] - rotation[:n]).max() < 2e-5
