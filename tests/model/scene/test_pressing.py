"""Motor drive and finger without a run: input tables, steady current, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.scene.build import build_scene
from model.scene.pressing import RAMP_S, AmplifierCommand, FingerCommand, steady_current

DRIVE = model.SCENES["motor-drive"]


def test_commands_are_cut_off_at_the_limit_where_they_reach_it() -> None:
    command = AmplifierCommand(per_volt=2.0, largest_v=10.0)
    times, source = command.table(np.array([0.0, 1.0, 2.0]), np.array([0.0, 10.0, -10.0]), False)
    np.testing.assert_allclose(times, [0.0, 0.5, 1.0, 1.25, 1.75, 2.0])
    np.testing.assert_allclose(source, [0.0, 10.0, 10.0, 10.0, -10.0, -10.0])
    times, source = command.table(np.array([0.0, 1.0]), np.array([8.0, -1.0]), True)
    np.testing.assert_array_equal(source, [10.0, -2.0])
    assert command.value(-7.0) == -10.0


def test_a_hand_that_moves_straight_gives_a_spring_force_and_a_damping_force() -> None:
    command = FingerCommand(0.1, 500.0, 2.0)
    times, torque = command.table(np.array([0.0, 0.1, 0.2]), np.array([0.0, 0.01, 0.01]), False)
    np.testing.assert_allclose(times, [0.0, 0.1 - RAMP_S / 2, 0.1 + RAMP_S / 2, 0.2], atol=1e-15)
    np.testing.assert_allclose(torque, 0.1 * np.array([0.2, 5.2, 5.0, 5.0]), rtol=1e-6)
    with pytest.raises(model.InputError, match="held from point to point"):
        command.table(np.array([0.0, 0.1]), np.array([0.0, 0.01]), True)


def test_steady_current_is_ohms_until_a_limit_holds_it(action: model.Action) -> None:
    voltage = model.SCENES["motor-voltage"]
    numbers = [1.0, 0.6, 0.0, 160.0, 20.0, 100.0, 0.05]
    assert steady_current(np.array(numbers), 7.0) == pytest.approx(7.0, rel=1e-12)
    assert 20.0 < steady_current(np.array(numbers), 100.0) < 21.0
    assert build_scene(voltage.on(action), voltage).command == AmplifierCommand(2.0, 320.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"motor_drive.voltage_gain": 1.0}, "torque mode"),
        ({"motor_drive.current_gain": 0.0}, "voltage mode"),
        ({"motor_drive.supply": 0.0}, "supply"),
        ({"motor_drive.inductance": 0.0}, "inductance"),
        ({"motor_drive.resistance": -1.0}, "resistance"),
        ({"motor_drive.limit_softness": 0.51}, "limit_softness"),
    ],
)
def test_drives_that_cannot_be_are_refused(action: model.Action, values: dict[str, float], words: str) -> None:
    with pytest.raises(model.InputError, match=words) as caught:
        build_scene(action.with_effects(values), DRIVE)
    assert "\n" not in str(caught.value)


def test_effects_that_do_not_go_together_are_refused(action: model.Action) -> None:
    for effects, words in ((("motor_drive",), "turns the motor_arm"), (("finger", "motor_arm"), "one of them")):
        with pytest.raises(model.InputError, match=words):
            model.SceneChoice(effects=effects)
    with pytest.raises(model.InputError, match="9 coordinates"):
        build_scene(action, model.SceneChoice(effects=("motor_arm", "motor_drive", "balance_rail", "shank")))
