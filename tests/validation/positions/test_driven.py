"""A trial that its key drives: a blow of the model is done again, null model and sensors in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import model
import validation
from rig.session import Session
from tests.validation.positions.planted import REGULATED, SHIPPED, STRING_RAD
from validation.measurement.position_sensors import PRIOR_U, PositionSensors, SensorCalibration
from validation.measurement.positions import measure_positions
from validation.measurement.trial import MeasuredTrial
from validation.prediction.key_driven import run_key_driven, run_null_key_driven

KEY_M, HAMMER_M = 0.012, 0.004
TIME_S = np.arange(0.0, 0.7, 5e-4)
REST = np.asarray(model.rest_state(REGULATED).angle_rad)[:5]
BY_RULER = SensorCalibration()


def sensors(key_m, z=None) -> PositionSensors:
    calibration = BY_RULER if z is None else SensorCalibration(tuple(z))
    return PositionSensors(TIME_S, key_m, KEY_M, HAMMER_M, calibration, {})


@pytest.fixture(scope="module")
def blow() -> tuple[MeasuredTrial, np.ndarray]:
    """A forte of the regulated action as a trial of position sensors, and its true turns (n, 5)."""
    run = model.simulate(REGULATED, *model.force_table("forte"), output_time_s=TIME_S, tolerance=1e-6)
    turn = run.angle_rad[:, :5] - run.angle_rad[0, :5]
    seen = sensors(-turn[:, 0] * REGULATED["drive.point.x"] / 0.010 * KEY_M)
    shipped = measure_positions(Session.open(SHIPPED).trial(7).read(), BY_RULER)
    change = np.column_stack([-seen.key_turn_rad(), np.full(TIME_S.size, np.nan), seen.read_hammer(turn[:, 4])])
    return replace(shipped, time_s=TIME_S, change_rad=change, sensors=seen), turn


def test_the_model_repeats_its_own_blow(blow) -> None:
    m, turn = blow
    made, _, counters = run_key_driven(REGULATED, m, REST, 1e-5)
    early = TIME_S < 0.45  # later the hammer bounces, and rounding grows
    assert np.abs(made[:, 0] - turn[:, 0]).max() < 5e-4 and counters["n_rhs"] > 0
    assert np.abs(made[:, 1] - turn[:, 1])[early].max() < 0.02 * np.ptp(turn[:, 1])
    assert np.abs(made[:, 4] - m.change_rad[:, 2])[early].max() < 0.02 * STRING_RAD


def test_an_encoder_s_key_drives_as_a_position_sensor_s(blow) -> None:
    m, turn = blow
    by_encoder = replace(
        m, sensors=None, change_rad=turn[:, [0, 1, 4]], resolution_rad=np.full(3, 4e-5), u_rad=np.zeros(3),
        scale_relative_u=np.zeros(3),
    )  # fmt: skip
    assert by_encoder.channels == ("whippen", "hammer")
    made, _, _ = run_key_driven(REGULATED, by_encoder, REST, 1e-5)
    assert np.abs(made[:, 4] - turn[:, 4])[TIME_S < 0.45].max() < 0.02 * STRING_RAD


def test_the_null_model_rises_strikes_and_comes_back(blow) -> None:
    m, _ = blow
    made = -run_null_key_driven(REGULATED, m)[:, 4]
    top = int(np.argmax(made))
    assert made[top] > 0.98 * STRING_RAD and abs(TIME_S[top] - 0.112) < 0.005
    assert made[0] == pytest.approx(0.0, abs=1e-6) and made[-1] < 0.1 * STRING_RAD
    assert np.abs(made + m.change_rad[:, 2])[TIME_S < 0.105].max() < 0.15 * STRING_RAD


def test_readings_follow_the_errors_inside_the_ruler_and_are_held_at_its_ends() -> None:
    errors = np.array([0.0, 0.0, 0.0, np.log(1.1), 2e-5, 0.02, 0.05, 0.05, 0.0, -0.01])
    seen = sensors(np.zeros(TIME_S.size), errors / PRIOR_U)
    share = np.array([-0.1, 0.0, 0.1, 0.4, 0.7, 1.3])  # of the ruler, as the sensor is gained
    read = seen.read_hammer(-share / 1.1 * STRING_RAD) / seen.as_turn(np.array([HAMMER_M]))
    assert read == pytest.approx([0.0, 0.005, 0.155, 0.405, 0.695, 1.0], abs=2e-5)


def test_the_key_turns_by_its_gain_from_its_rest_and_bows_between_the_ends() -> None:
    errors = np.array([np.log(0.9), 1e-4, 0.2, *np.zeros(7)])
    key_m = np.resize([0.0, 0.5 * KEY_M, KEY_M], TIME_S.size)
    turn = sensors(key_m, errors / PRIOR_U).key_turn_rad()[:3]
    per_m = 0.9 * 0.010 / REGULATED["drive.point.x"] / KEY_M
    assert turn == pytest.approx(per_m * (KEY_M * np.array([0.0, 0.55, 1.0]) - 1e-4))


def test_by_motion_drives_the_model_by_the_key_where_a_force_was_recorded() -> None:
    options = {"by_motion": True, "budget": False, "explain": False, "keep_predictions": False, "rivals": ("null",)}
    result = validation.compare(SHIPPED.parent / "example_forte", "hirschkorn2004", **options)
    assert set(result.scores["channel"]) == {"whippen", "hammer"}
    assert result.provenance["driven_by"] == "key" and len(result.motion_driven) == 1
    assert "driven by its own measured motion of the key" in result.verdict
    assert result.scores["null_rmse_rad"].notna().all() and result.scores["rmse_over_range"].max() < 0.2
