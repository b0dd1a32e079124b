"""Events of whole strokes: check, release, rest, and the same definitions for model and trial."""

from __future__ import annotations

import numpy as np
import pytest

from validation.events.detect import (
    check,
    find_events,
    find_hold,
    key_bottom,
    key_release,
    read_level,
    rest,
)
from validation.measurement.geometry import Motion

RATE_HZ = 5000.0
REST_M = 0.0481
TOUCH_M = 0.0093


def motion(time, dip=None, height=None, **u):
    values = {"u_dip_m": 2e-6, "u_height_m": 3e-6, "u_dip_still_m": 0.0, "u_height_still_m": 0.0}
    values |= {"u_dip_zero_m": 0.0, "u_height_zero_m": 0.0} | u
    dip = np.zeros_like(time) if dip is None else dip
    height = np.full_like(time, REST_M) if height is None else height
    return Motion(
        time_s=time,
        key_dip_m=dip,
        hammer_height_m=height,
        hammer_way_m=height,
        u_speed_relative=0.0,
        rest_height_m=REST_M,
        key_touch_dip_m=TOUCH_M,
        **values,
    )


def caught(stroke, after_s=0.3, until_s=np.inf):
    return check(stroke, find_hold(stroke, after_s, until_s))


def clock(length_s=1.0):
    return np.arange(int(length_s * RATE_HZ)) / RATE_HZ


def pressed_m(time, down_s=0.2, up_s=0.6, deep_m=0.0098):
    """Key dip: 20 ms down, held, 40 ms up."""
    return deep_m * np.clip((time - down_s) / 0.02, 0, 1) * np.clip(1 - (time - up_s) / 0.04, 0, 1)


def test_key_bottom_is_the_crossing_of_the_touching_dip():
    event = key_bottom(motion(clock(), pressed_m(clock()), u_dip_zero_m=5e-5))
    assert event.status == "found"
    assert event.value == pytest.approx(0.2 + 0.02 * TOUCH_M / 0.0098, abs=1e-6)
    assert event.u == pytest.approx(5e-5 / (0.0098 / 0.02), rel=0.02)


def test_a_key_that_stops_short_has_no_bottom():
    event = key_bottom(motion(clock(), pressed_m(clock(), deep_m=0.008)))
    assert event.status == "absent"
    assert "deepest dip 8.00 mm, touch at 9.30 mm" in event.note


def test_a_key_that_grazes_its_felt_is_ambiguous():
    event = key_bottom(motion(clock(), pressed_m(clock(), deep_m=TOUCH_M + 2e-5), u_dip_zero_m=5e-5))
    assert event.status == "ambiguous"
    assert "grazes" in event.note


def test_release_is_not_mistaken_for_a_key_that_lifts_off_the_balance_rail():
    time = clock()
    dip = pressed_m(time)
    # the false reading of thesis 3.2.2: more than half the dip is gone for some milliseconds
    dip -= 0.006 * np.exp(-(((time - 0.23) / 0.003) ** 2))
    event = key_release(motion(time, dip))
    assert event.value == pytest.approx(0.6 + 0.04 * (1 - 0.5 * TOUCH_M / 0.0098), abs=1e-5)


def test_a_key_held_to_the_end_or_never_pressed_is_not_released():
    assert key_release(motion(clock(), pressed_m(clock(), up_s=2.0))).status == "absent"
    assert key_release(motion(clock(), pressed_m(clock(), deep_m=0.004))).status == "absent"


def caught_m(time, impact_s=0.3, held_m=0.0158, until_s=0.6, hold_starts_s=0.31):
    """Hammer height after an impact: falls to a height, is held, falls on to rest."""
    fall = np.clip((time - impact_s) / (hold_starts_s - impact_s), 0, 1) * held_m
    return np.where(time < until_s, fall, held_m + (REST_M - held_m) * np.clip((time - until_s) / 0.1, 0, 1))


def test_check_time_and_height():
    when, height = caught(motion(clock(), height=caught_m(clock()), u_height_zero_m=5e-5))
    assert height.status == when.status == "found"
    assert height.value == pytest.approx(0.0158, abs=1e-9)
    assert height.u == pytest.approx(5e-5, rel=0.05)
    # it enters the band of 0.25 mm around 15.8 mm at 1.58 m/s
    assert when.value == pytest.approx(0.31 - 0.25e-3 / 1.58, abs=2e-6)
    # the band is around the hammer's own height: where zero is does not matter for the time
    assert when.u == caught(motion(clock(), height=caught_m(clock())))[0].u


def test_a_short_hold_is_ambiguous_and_a_bounce_is_none():
    time = clock()
    when, height = caught(motion(time, height=caught_m(time, until_s=0.325)))
    assert height.status == when.status == "ambiguous"
    bounce = np.minimum(REST_M, 2.0 * np.clip(time - 0.3, 0, None))
    assert caught(motion(time, height=bounce))[1].status == "absent"
    assert check(motion(time), None, struck=False)[0].note == "no string impact"


def test_the_unknown_end_of_a_prediction_hides_no_event():
    """The model knows no force for the last group delay: its angles are NaN there."""
    time = clock()
    height, dip = caught_m(time, until_s=2.0), pressed_m(time, up_s=2.0)
    height[-400:] = dip[-400:] = np.nan
    lost = motion(time, dip, height)
    assert caught(lost)[1].value == pytest.approx(0.0158, abs=1e-9)
    assert caught(lost, 0.95)[1].status == "absent"
    assert "15.80 mm away" in rest(lost, 1000).note
    assert key_bottom(lost).status == "found"
    assert key_release(lost).status == "absent"


def test_a_later_strike_ends_the_search_for_a_check():
    time = clock()
    late = caught_m(time, impact_s=0.3, hold_starts_s=0.45, until_s=0.7)
    assert caught(motion(time, height=late), until_s=0.4)[1].status == "absent"
    assert caught(motion(time, height=late))[1].status == "found"


def test_rest_is_the_last_exit_from_the_band():
    time = clock()
    swing = 2e-3 * np.exp(-np.clip(time - 0.5, 0, None) / 0.05) * (time > 0.3)
    event = rest(motion(time, height=REST_M - swing), 1000)
    assert event.value == pytest.approx(0.5 + 0.05 * np.log(20), abs=1e-4)
    assert event.status == "found"


def test_a_rest_that_hangs_on_the_band_is_ambiguous():
    time = clock()
    ripple = 0.1005e-3 * np.cos(2 * np.pi * 10 * (time - 0.3)) * ((time > 0.3) & (time < 0.71))
    stroke = 0.02 * np.clip(1 - np.abs(time - 0.25) / 0.04, 0, 1)
    event = rest(motion(time, height=REST_M - stroke + ripple, u_height_m=2e-6), 1000)
    assert event.status == "ambiguous"
    assert event.u > 0.3


def test_a_hammer_still_moving_at_the_end_is_not_at_rest():
    time = clock()
    event = rest(motion(time, height=REST_M - 3e-3 * (time > 0.3)), 1000)
    assert event.status == "absent"
    assert "3.00 mm away" in event.note


@pytest.fixture(scope="module")
def reference_action():
    model = pytest.importorskip("model")
    return model, model.load_action("hirschkorn2004")


def events_of(model, action, time, force):
    from validation.measurement.geometry import geometry_of, motion_of

    rest_state = model.rest_state(action)
    solution = model.simulate(action, time, force, initial=rest_state)
    change = (solution.angle_rad - rest_state.angle_rad)[:, [0, 1, 4]]
    geometry = geometry_of(action, rest_state.angle_rad)
    return find_events(motion_of(geometry, time, change, np.full(3, 1e-6)), 200), solution, geometry


def test_events_of_a_simulated_forte_agree_with_its_contact_forces(reference_action, make):
    model, action = reference_action
    time = np.arange(0, 0.8, 1 / RATE_HZ)
    force = make.force(time, onset_s=0.05)
    found, _, _ = events_of(model, action, time, force)
    fine = np.arange(0.09, 0.4, 2e-5)
    forces = model.simulate(action, time, force, output_time_s=fine, contact_forces=True)
    normal = dict(zip(forces.contacts, forces.contact_normal_n.T, strict=True))

    def first_touch(contact):
        return fine[np.argmax(normal[contact] > 0)]

    assert found["key_bottom"].value == pytest.approx(first_touch("contact02"), abs=3e-5)
    assert found["string_impact"].value == pytest.approx(first_touch("contact12"), abs=3e-5)
    at = np.argmax(normal["contact12"] > 0)
    head = 0.1321 * np.cos(forces.angle_rad[at, 4]) + 0.0356 * np.sin(forces.angle_rad[at, 4])
    assert found["hammer_speed"].value == pytest.approx(-forces.speed_rad_per_s[at, 4] * head, rel=2e-3)
    checked = fine[np.argmax((normal["contact04"] > 1) & (fine > found["string_impact"].value))]
    assert 0 < found["check_time"].value - checked < 5e-3
    assert 0.010 < found["check_height"].value < 0.020
    assert found["second_strike"].status == "absent"
    assert found["rest"].status == "found"


def test_a_second_strike_is_found_in_a_double_blow(reference_action):
    model, action = reference_action
    time = np.arange(0, 1.1, 1 / RATE_HZ)

    def blow(onset):
        t = time - onset
        return 10 * np.clip(t / 0.06, 0, 1) ** 1.5 * np.clip(1 - (t - 0.11) / 0.03, 0, 1)

    found, _, _ = events_of(model, action, time, blow(0.05) + blow(0.25))
    assert found["second_strike"].status == "found"
    assert 0.17 < found["second_strike"].value - found["string_impact"].value < 0.25
    assert found["key_release"].value > found["second_strike"].value


def test_events_have_the_same_values_where_no_uncertainty_is_asked_for(reference_action, make):
    from validation.measurement.geometry import geometry_of, motion_of

    model, action = reference_action
    time = np.arange(0, 0.8, 1 / RATE_HZ)
    solution = model.simulate(action, time, make.force(time, onset_s=0.05))
    change = (solution.angle_rad - solution.angle_rad[0])[:, [0, 1, 4]]
    moving = motion_of(geometry_of(action, solution.angle_rad[0]), time, change, np.full(3, 1e-6))
    found, plain = find_events(moving, 200), find_events(moving, 200, read_level)
    happened = [name for name, event in found.items() if event.status != "absent"]
    assert len(happened) > 9
    assert [name for name, event in plain.items() if event.status != "absent"] == happened
    assert [plain[name].value for name in happened] == [found[name].value for name in happened]
    assert found["key_bottom"].u > plain["key_bottom"].u
