"""Motor drive and finger without a run: limits, input tables, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.compiler.expressions import ONE, as_expression, differentiator
from model.elements.drives import amplifier, soft_limit
from model.scene.build import build_scene
from model.scene.pressing import RAMP_S, AmplifierCommand, FingerCommand, amplifier_voltage, steady_current
from tests.model.compiler.machine import given, machine

DRIVE = model.SCENES["motor-drive"]
H = 1e-6


def test_soft_limit_is_smooth_to_the_fourth_derivative_and_exact_below() -> None:
    limit, x = 3.0, given(0)
    held = soft_limit(x, as_expression(limit), as_expression(0.1))
    run = machine([held, differentiator({x: ONE})(held)])

    def limited(x: float) -> tuple[float, float]:
        value, slope = run(np.array([x]))[:2]
        return float(value), float(slope)

    for at in (0.0, 1.5, -2.69, 2.7):
        assert limited(at) == (at, 1.0)
    assert 2.7 < limited(2.9)[0] < 2.9
    assert limited(1e4)[0] == pytest.approx(limit, abs=1e-12)
    assert limited(-1e4)[0] == -limited(1e4)[0]
    # next to where it sets in it leaves x as the fifth power
    off = [at - limited(2.7 + at)[0] + 2.7 for at in (0.02, 0.04)]
    assert off[1] / off[0] == pytest.approx(32.0, rel=0.01)
    for at in (2.71, 2.95, 3.3, -3.1):
        slope = (limited(at + H)[0] - limited(at - H)[0]) / (2.0 * H)
        assert limited(at)[1] == pytest.approx(slope, abs=1e-8)


def test_amplifier_never_leaves_its_supply_and_its_slopes_are_right() -> None:
    numbers = (20.0, 12.0, 3.0, 100.0, 0.05)
    random = np.random.default_rng(1)
    u, i = given(0), given(1)
    volts = amplifier((u, i), *map(as_expression, numbers))
    run = machine([volts, differentiator({u: ONE})(volts), differentiator({i: ONE})(volts)])
    for at in np.column_stack([60.0 * random.normal(size=200), 2.0 * random.normal(size=200)]):
        found, of_source, of_current = run(at)[:3]
        assert abs(found) <= 12.0
        plain = amplifier_voltage(np.array([0.0, 0.0, *numbers]), at[:1], at[1:])[0]
        assert found == pytest.approx(plain, rel=1e-12, abs=1e-12)
        for slope, way, near in ((of_source, [H, 0.0], 1e-6), (of_current, [0.0, H], 1e-3)):
            assert slope == pytest.approx((run(at + way)[0] - run(at - way)[0]) / (2.0 * H), abs=near)


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
