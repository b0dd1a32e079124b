"""A finger on the key, driven by the motion of its hand: a soft one hands on a force, a hard one its motion."""

from __future__ import annotations

import numpy as np

import model

ACTION = model.load_action("hirschkorn2004-regulated")
FORTE = model.force_table("forte")


def test_a_soft_finger_hands_a_force_on() -> None:
    """Weak muscle, hand far away: what is pressed is the force, whatever the key does; the rest falls with k."""
    at, apart = np.linspace(0.0, 0.3, 301), []
    force = model.simulate(
        ACTION, FORTE[0], FORTE[1], output_time_s=at, tolerance=1e-8,
        initial=model.rest_state(ACTION), contact_forces=True,
    )  # fmt: skip
    for stiffness in (10.0, 1.0):
        finger = {"finger.stiffness": stiffness, "finger.mass": 1e-6, "finger.damping": 0.0, "finger.preload_n": 1e-3}
        action = ACTION.with_effects(finger | {"finger.pad_a": 0.0, "finger.pad_c": 1e5, "finger.length": 1.0})
        found = model.simulate(action, FORTE[0], FORTE[1] / stiffness, scene="finger", tolerance=1e-8, output_time_s=at)
        apart.append(np.abs(found.angle_rad[at < 0.105, :5] - force.angle_rad[at < 0.105]).max())
    assert apart[1] < 2e-3
    assert apart[0] / apart[1] > 5.0, apart


def test_a_rigid_finger_hands_its_motion_on() -> None:
    """The front of the key follows the hand, and the force is that of a motion-driven run."""
    at = np.arange(0.0, 0.104, 5e-5)  # up to key bottom, where it is smooth
    blow = model.simulate(ACTION, FORTE[0], FORTE[1], tolerance=1e-9, output_time_s=at)
    key = blow.angle_rad[:, 0]
    x, y = ACTION["drive.point.x"], ACTION["drive.point.y"]
    level = x * np.sin(0.029) + y * np.cos(0.029)  # of the key's front where the hand's way counts from
    way = level - (x * np.sin(key) + y * np.cos(key))
    driven = model.simulate_motion(ACTION, at, key)
    apart = []
    for stiffness in (1e5, 1e6):
        rigid = {"finger.stiffness": stiffness, "finger.pad_c": stiffness, "finger.pad_a": 0.0, "finger.mass": 1e-4}
        rigid |= {"finger.damping": 20.0, "finger.pad_damping": 0.0, "finger.preload_n": 1e-3}
        found = model.simulate(ACTION.with_effects(rigid), at, way, scene="finger", tolerance=1e-7, contact_forces=True)
        apart.append(np.abs(found.angle_rad[:, 0] - key).max())
        assert found.contact_normal_n is not None
        force = found.contact_normal_n[:, found.contacts.index("finger")]
    assert apart[1] < 2e-4 and apart[0] / apart[1] > 5.0, apart
    average = np.ones(40) / 40.0  # 2 ms: a hand that moves straight from point to point shakes a rigid finger
    inside = (at > 0.07) & (at < 0.10)
    expected = np.interp(at, driven.time_s, driven.force_n)
    wrong = np.abs(np.convolve(force - expected, average, "same"))[inside].max()
    assert wrong < 0.05 * expected.max()
