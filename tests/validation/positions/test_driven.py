"""The models under a measured key: what a blow did is done again when only its key is given."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import model
from rig.session.info import RulerInfo
from rig.session.ruler import Position
from validation.measurement.positions import Measured, Stroke
from validation.prediction.positions import (
    FREE,
    NAMES,
    SENSORS,
    Mixture,
    Nominal,
    NullAction,
    action_of,
    hammer_reading,
    of_model,
    of_null,
    predict_null,
    sensing_of,
    values_of,
)

ACTION = model.load_action("hirschkorn2004-regulated")
KEY_M, HAMMER_M = 0.012, 0.004
RATE = 2000.0


def sensor(body: str, value_m, travel_m) -> Measured:
    ruler = RulerInfo(body, "a", "b", (0.0, 0.3, 0.6, 1.0), tuple(travel_m * np.array([0.0, 0.3, 0.6, 1.0])), 1e-5)
    none = np.zeros(value_m.size)
    held = Position(body, ruler, none, value_m, none, none, none.astype(np.uint8), "")
    return Measured(held, held.displacement_m, travel_m, 0.0, none)


@pytest.fixture(scope="module")
def stroke() -> Stroke:
    """A forte of the regulated action, driven by force, through sensors as `sensing_of` ties them nominally."""
    time_s = np.arange(0.0, 0.7, 1.0 / RATE)
    blow = model.simulate(ACTION, *model.force_table("forte"), output_time_s=time_s, tolerance=1e-6)
    sensing = sensing_of(Nominal.of(ACTION), np.zeros(len(FREE)), KEY_M, HAMMER_M)
    key = (blow.angle_rad[0, 0] - blow.angle_rad[:, 0]) / sensing.key_rad_per_m
    hammer = np.clip((blow.angle_rad[0, 4] - blow.angle_rad[:, 4]) * sensing.hammer_m_per_rad, 0.0, HAMMER_M)
    return Stroke(1, "forte", "", time_s, sensor("key", key, KEY_M), sensor("hammer", hammer, HAMMER_M))


def test_the_model_repeats_its_own_blow(stroke) -> None:
    made = of_model(ACTION)(np.zeros(len(FREE)), stroke, None)
    error = np.abs(made - stroke.hammer.value_m) / HAMMER_M
    assert error[stroke.time_s < 0.45].max() < 0.02  # later the hammer bounces, and rounding grows


def test_a_changed_regulation_changes_the_answer(stroke) -> None:
    z = np.zeros(len(FREE))
    z[NAMES.index("check")] = -0.1
    moved = of_model(ACTION)(z, stroke, None) - of_model(ACTION)(np.zeros(len(FREE)), stroke, None)
    held = (stroke.time_s > 0.2) & (stroke.time_s < 0.3)
    assert 0.02 * HAMMER_M < np.abs(np.median(moved[held])) < 0.2 * HAMMER_M
    assert np.abs(moved[stroke.time_s < 0.1]).max() < 0.005 * HAMMER_M


def test_the_null_model_rises_strikes_and_comes_back(stroke) -> None:
    made = of_null(ACTION)(np.zeros(len(SENSORS)), stroke, None)
    top = int(np.argmax(made))
    assert made[top] > 0.98 * HAMMER_M and abs(stroke.time_s[top] - 0.112) < 0.005
    assert made[0] == pytest.approx(0.0, abs=1e-6) and made[-1] < 0.1 * HAMMER_M
    rising = stroke.time_s < 0.105
    assert np.abs(made - stroke.hammer.value_m)[rising].max() < 0.15 * HAMMER_M


def test_a_null_hammer_never_leaves_path_and_string(stroke) -> None:
    sensing = sensing_of(Nominal.of(ACTION), np.zeros(len(SENSORS)), KEY_M, HAMMER_M)
    wide = dataclasses.replace(sensing, key_rad_per_m=1.2 * sensing.key_rad_per_m)
    made = predict_null(NullAction.of(ACTION), stroke, wide)
    assert np.isfinite(made).all() and made.min() >= 0.0 and made.max() <= HAMMER_M


def test_readings_follow_the_curve_inside_the_ruler_and_are_held_at_its_ends() -> None:
    sensing = sensing_of(Nominal.of(ACTION), np.zeros(len(SENSORS)), KEY_M, HAMMER_M)
    more = dataclasses.replace(sensing, hammer_curve=(0.02, 0.05, 0.05, 0.0, -0.01))
    turn = np.array([-0.1, 0.0, 0.1, 0.7, 1.0, 1.3]) * HAMMER_M / sensing.hammer_m_per_rad
    assert hammer_reading(turn, more, HAMMER_M) / HAMMER_M == pytest.approx([0.0, 0.0, 0.15, 0.69, 1.0, 1.0])


def test_parameters_mean_what_they_say() -> None:
    z = np.zeros(len(FREE))
    z[NAMES.index("let_off")], z[NAMES.index("hammer_mass")] = 1.0, -1.0
    changed = action_of(ACTION, z)
    assert changed["contact08.second.y"] - ACTION["contact08.second.y"] == pytest.approx(2e-3)
    assert changed["hammer.inertia"] / ACTION["hammer.inertia"] == pytest.approx(np.exp(-0.2))
    assert values_of(z)["let_off"] == pytest.approx(2e-3)
    assert {path for path in ACTION.quantities if changed[path] != ACTION[path]} == {
        "contact08.second.y", "hammer.mass", "hammer.inertia",
    }  # fmt: skip
    with pytest.raises(model.ModelError):
        action_of(ACTION, 3000.0 * z)


def test_a_mixture_is_the_mean_of_the_sets_that_can_follow(stroke) -> None:
    def predict(z, stroke, displacement_m):
        if z[0] < 0.0:
            raise model.ModelError("cannot follow")
        return np.full(stroke.time_s.size, z[0])

    made = Mixture([[1.0], [3.0], [-1.0]], [0.45, 0.15, 0.4]).predict(predict, stroke)
    assert made == pytest.approx(np.full(stroke.time_s.size, 1.5))
    with pytest.raises(model.ModelError, match="cannot follow"):
        Mixture.of_one(np.array([-1.0])).predict(predict, stroke)
