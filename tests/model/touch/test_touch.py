"""Feel of an action: hammer speed against the plain derivative, repetition, the figure."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import model
from model.observables import head_approach_m_per_s
from model.touch import fastest_repetition, hammer_speeds
from model.touch.figure import draw
from model.touch.hammer_speed import string_contact_starts
from model.touch.measure import strikes_string


def test_approach_speed_is_that_of_a_point_on_a_turning_body(action: model.Action) -> None:
    angle, speed, i = np.array([0.1, -0.02]), np.array([-20.0, -30.0]), model.BODIES.index("hammer")
    rows, rates = np.zeros((2, 5)), np.zeros((2, 5))
    rows[:, i], rates[:, i] = angle, speed
    x, y = action["contact12.first.x"], action["contact12.first.y"]  # the string lies level
    expected = speed * (x * np.cos(angle) - y * np.sin(angle))
    np.testing.assert_allclose(head_approach_m_per_s(action, model.BODIES, rows, rates), expected, rtol=1e-8)


def test_touches_are_counted_once() -> None:
    assert string_contact_starts(np.array([2.0, 1.0, -1.0, -2.0, 1.0, 3.0, 0.0, 1.0])).tolist() == [1, 5]


def test_hammer_speed_against_a_fine_run(action: model.Action) -> None:
    speeds = hammer_speeds(action, [0.3, 2.0, 20.0])
    assert math.isnan(speeds[0])  # too soft to reach the string
    assert 1.0 < speeds[1] < 1.3 < speeds[2] < 5.0
    time = np.arange(0, 0.05, 1e-5)
    fine = model.simulate(action, [0.0, 0.02, 0.05], [0.0, 20.0, 20.0], output_time_s=time, tolerance=1e-7)
    height = model.observables.hammer_height_m(action, fine.angle_rad)
    k = int(np.argmax(height <= 0.0))
    assert speeds[2] == pytest.approx((height[k - 2] - height[k]) / 2e-5, rel=2e-3)


def test_repetition_tells_a_regulated_action_from_one_that_is_not(
    action: model.Action, regulated: model.Action
) -> None:
    good, bad = fastest_repetition(regulated), fastest_repetition(action)
    assert good > 9.0 and 3.0 <= bad < 7.0
    assert strikes_string(regulated, 4.0, 4.0).all()
    assert not strikes_string(action, 8.0, 4.0)[2:].all()
    assert math.isnan(fastest_repetition(regulated, [0.3]))  # too soft ever to reach the string


def test_figure_shows_every_action(action: model.Action, tmp_path: Path) -> None:
    one = model.measure_touch(action, [0.3, 3.0], name="first")
    assert list(one.rows())[-2] == "hammer at 3 N, m/s" and one.rows()["down weight, g"] == pytest.approx(45.4, abs=1)
    from dataclasses import replace

    draw([one, replace(one, name="second", repetition_hz=math.nan)], tmp_path / "f.svg")
    assert [p.name for p in tmp_path.iterdir()] == ["f.svg"]
    assert (tmp_path / "f.svg").read_text(encoding="utf-8").rstrip().endswith("</svg>")
    with pytest.raises(model.InputError, match=r"ending found '\.jpeg'"):
        draw([one], tmp_path / "f.jpeg")


def test_repetition_of_a_key_that_no_force_drives_is_refused(action: model.Action) -> None:
    """Newtons of the pulses would be taken for newton metres of the motor."""
    with pytest.raises(model.InputError, match="driven by torque_nm, allowed one with all bodies driven by force_n"):
        fastest_repetition(model.load_scene("motor-arm").on(action))
