"""The slow press: the key goes where it is told, the force is what it takes."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model import hand_set_rest
from model.motion_driven.slow_press import Press, key_angle_at_dip, slow_press


@pytest.fixture(scope="module")
def pressed(action: model.Action) -> Press:
    return slow_press(action, hand_set_rest(action), [4e-3, 0.0], speed_m_per_s=0.01, hold_s=0.2)


def test_key_is_where_it_should_be(pressed: Press) -> None:
    at = np.searchsorted(pressed.time_s, np.array(pressed.arrived) + 0.15)
    np.testing.assert_allclose(pressed.dip_m[at], [4e-3, 0.0], atol=2e-5)
    moving = (pressed.time_s > 0.1) & (pressed.time_s < 0.35)
    speed = np.gradient(pressed.dip_m, pressed.time_s)[moving]
    assert np.median(speed) == pytest.approx(0.01, rel=0.01)


def test_friction_opposes_both_ways(pressed: Press) -> None:
    middle = (pressed.dip_m > 1.5e-3) & (pressed.dip_m < 3.5e-3)
    down, up = (float(np.median(pressed.force_n[middle & (pressed.leg == leg)])) for leg in (0, 1))
    assert 0.35 < down < 0.6 and 0.1 < up < 0.3


def test_the_force_moves_the_free_action_the_same(action: model.Action, pressed: Press) -> None:
    """Until the jack meets its button a press is stable: the force that holds the front, given, moves it as before."""
    time, force = np.append(0.0, pressed.time_s), np.append(pressed.force_n[0], pressed.force_n)
    down = time <= 0.35
    free = model.simulate(action, time[down], force[down], tolerance=1e-7)
    dip = model.observables.key_dip_m(action, free.angle_rad)
    assert np.max(np.abs(dip - np.append(0.0, pressed.dip_m)[down])) < 1e-4


def test_the_front_goes_there_in_a_scene_with_effects(action: model.Action) -> None:
    own = model.load_scene("flexible-shank").on(action)
    found = slow_press(own, hand_set_rest(own), [4e-3, 0.0], speed_m_per_s=0.01, hold_s=0.2)
    rigid = slow_press(action, hand_set_rest(action), [4e-3, 0.0], speed_m_per_s=0.01, hold_s=0.2)
    np.testing.assert_allclose(found.dip_m, rigid.dip_m, atol=1e-8)
    assert found.angle_rad.shape == rigid.angle_rad.shape
    middle = (found.dip_m > 1.5e-3) & (found.dip_m < 3.5e-3)
    assert np.median(np.abs(found.force_n - rigid.force_n)[middle]) < 0.06
    assert 1e-9 < np.max(np.abs(found.angle_rad - rigid.angle_rad)) < 0.02


def test_angle_at_dip_inverts_the_observable(action: model.Action) -> None:
    rest = hand_set_rest(action)
    for dip in (-2e-3, 0.0, 9.3e-3):
        angles = rest.copy()
        angles[0] = key_angle_at_dip(action, rest, dip)
        assert model.observables.key_dip_m(action, angles[None, :], rest)[0] == pytest.approx(dip, abs=1e-15)
    with pytest.raises(model.InputError, match="dip: found 500 mm"):
        key_angle_at_dip(action, rest, 0.5)


def test_speed_is_checked(action: model.Action) -> None:
    with pytest.raises(model.InputError, match="speed of the press: found 0 m/s"):
        slow_press(action, hand_set_rest(action), [1e-3], speed_m_per_s=0.0)


def test_a_press_that_cannot_go_on_says_when(action: model.Action, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("model.simulation.run.STEPS_AT_LEAST", 3)
    monkeypatch.setattr("model.simulation.run.STEPS_PER_SECOND", 0)
    with pytest.raises(model.IntegrationError, match=r"stopped at t = 0\.0\d+ s.*too many steps"):
        slow_press(action, hand_set_rest(action), [4e-3])
