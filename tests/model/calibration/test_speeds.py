"""Mean normal speeds: a motion whose rates are known, the rule for rest, measured angles."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model import InputError
from model.calibration import mean_normal_speeds

ACTION = model.load_action()


def pressed_hammer(rate_m_per_s: np.ndarray, step_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The hammer alone moves into the string by hand; gap by `model.observables`, an independent formula."""
    rest = model.rest_state(ACTION).angle_rad
    grid = np.linspace(rest[4] - 0.6, rest[4] + 0.6, 20001)
    gap = model.observables.hammer_height_from_angle(ACTION, grid)
    order = np.argsort(gap)
    depth = 1e-6 + np.concatenate([[0.0], np.cumsum(rate_m_per_s[:-1] * step_s)])
    angle = np.interp(-depth, gap[order], grid[order])
    t = step_s * np.arange(len(depth))
    angles = np.tile(rest, (len(t), 1))
    angles[:, 4] = angle
    speeds = np.zeros_like(angles)
    slope = np.interp(angle, grid, np.gradient(gap, grid))
    speeds[:, 4] = -rate_m_per_s / slope
    return t, angles, speeds


def test_mean_of_a_known_motion_leaves_rest_out() -> None:
    rate = np.concatenate([np.full(400, 0.8), np.zeros(3000), np.full(200, -0.2), np.full(100, 0.01)])
    means = mean_normal_speeds(ACTION, *pressed_hammer(rate, 1e-6))
    string = means.contacts.index("contact12")
    assert means.speed_m_per_s[string] == pytest.approx((400 * 0.8 + 200 * 0.2) / 600, rel=1e-4)  # 0.01 is below 2 %
    assert means.counted_s[string] == pytest.approx(600e-6, rel=1e-9)
    assert means.pressed_s[string] == pytest.approx(3700e-6, rel=1e-9)
    assert np.isnan(means.speed_m_per_s[means.contacts.index("contact02")])


def test_a_contact_never_pressed_has_no_mean() -> None:
    means = mean_normal_speeds(ACTION, *pressed_hammer(np.full(100, 0.5), 1e-6))
    with pytest.raises(InputError, match="contact02: never pressed"):
        means.of("contact02")
    with pytest.raises(InputError, match="contact14: not found"):
        means.of("contact14")


def test_speeds_from_angles_alone() -> None:
    t = np.arange(0.0, 0.2, 2e-4)
    force = np.interp(t, [0.0, 0.02, 0.1, 0.12, 0.2], [0.0, 0.0, 6.0, 6.0, 6.0])
    sol = model.simulate(ACTION, t, force)
    known = mean_normal_speeds(ACTION, sol.time_s, sol.angle_rad, sol.speed_rad_per_s)
    seen = mean_normal_speeds(ACTION, sol.time_s, sol.angle_rad)
    capstan = known.contacts.index("contact01")
    assert seen.speed_m_per_s[capstan] == pytest.approx(known.speed_m_per_s[capstan], rel=0.3)  # 2 ms of smoothing


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, q: (t, q[:, :4]), "shape"),
        (lambda t, q: (t, np.where(np.arange(50)[:, None] == 7, np.nan, q)), "row 8: found lost data"),
        (lambda t, q: (t[::-1], q), "times must increase"),
        (lambda t, q: (t**2, q), "not evenly spaced"),
    ],
)
def test_bad_motion(change: object, words: str) -> None:
    t, q = np.linspace(0.0, 0.1, 50), np.tile(model.rest_state(ACTION).angle_rad, (50, 1))
    with pytest.raises(InputError, match=words):
        mean_normal_speeds(ACTION, *change(t, q))  # type: ignore[operator]
