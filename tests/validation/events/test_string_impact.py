"""String impacts of known time and speed: closed forms, near misses (coverage: `test_event_coverage`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from validation.events.contact import find_strikes
from validation.events.detect import let_off
from validation.events.flight import fit_flight
from validation.measurement.geometry import Motion

RATE_HZ = 5000.0
IMPACT_S = 0.1003
SPEED = 2.35
REBOUND = 1.85
CONTACT_S = 1.05e-3
REST_M = 0.0481
DECELERATION = 10.7


def flight_m(time_s, *, impact_s=IMPACT_S, speed=SPEED, rebound=REBOUND, string_m=0.0):
    """Hammer height: pushed up, 5 ms of free flight, a string contact, free flight back (distinct speeds)."""
    t = np.asarray(time_s) - impact_s
    flight = string_m - speed * t + 0.5 * DECELERATION * t**2
    # before free flight the hammer is pushed: constant acceleration from rest, smooth at -5 ms
    v0 = speed + DECELERATION * 0.005
    h0 = string_m + speed * 0.005 + 0.5 * DECELERATION * 0.005**2
    push = v0**2 / (2 * (REST_M - h0))
    pushed = np.where(t > -0.005 - v0 / push, REST_M - 0.5 * push * (t + 0.005 + v0 / push) ** 2, REST_M)
    s = np.clip(t / CONTACT_S, 0, 1)
    contact = string_m - speed * CONTACT_S * s * (1 - s)  # enters with the speed of the flight
    away = t - CONTACT_S
    back = string_m + rebound * away + 0.5 * DECELERATION * away**2
    back = np.minimum(back, 0.016)
    return np.where(t < -0.005, pushed, np.where(t < 0, flight, np.where(t < CONTACT_S, contact, back)))


def motion(height_m, time_s, u_m=0.0, u_zero_m=0.0):
    return Motion(
        time_s, np.zeros_like(time_s), height_m, height_m, 0.0, u_m, 0.0, 0.0, 0.0, u_zero_m, 0.0, REST_M, 0.0093
    )


def times():
    return np.arange(0, 0.25, 1 / RATE_HZ)


def test_time_and_both_speeds_of_a_clean_strike():
    (strike,) = find_strikes(motion(flight_m(times()), times()))
    assert strike.status == "found"
    assert strike.time_s == pytest.approx(IMPACT_S, abs=2e-6)
    # the assumed deceleration of 10.5 instead of 10.7 m/s² shows, within the stated uncertainty
    assert abs(strike.arrival.speed - SPEED) < min(strike.arrival.u_speed, 3e-4 * SPEED)
    assert strike.rebound.speed == pytest.approx(REBOUND, rel=1e-3)
    assert strike.arrival.note in ("free flight over 4 ms", "free flight over 5 ms")  # it flies freely for 5


@pytest.mark.parametrize("lower_m", [0.2e-3, 0.4e-3, 0.9e-3])
def test_a_string_that_stands_lower_than_the_geometry_says_moves_neither_speed_nor_let_off(lower_m):
    plain, low = (motion(flight_m(times(), string_m=by), times(), 2e-6) for by in (0.0, lower_m))
    (usual,), (early,) = find_strikes(plain), find_strikes(low)
    assert early.arrival.note.startswith("free flight")
    assert early.arrival.speed == pytest.approx(SPEED, rel=5e-3)
    assert early.arrival.contact_s == pytest.approx(IMPACT_S + lower_m / SPEED, abs=1e-5)
    event = let_off(low, early)
    assert event.status == "found"
    assert event.value == pytest.approx(let_off(plain, usual).value, abs=1e-4)


def test_an_uncertain_rest_height_shows_in_the_time_of_impact():
    (strike,) = find_strikes(motion(flight_m(times()), times(), u_zero_m=5e-5))
    assert strike.u_time_s == pytest.approx(5e-5 / SPEED, rel=0.05)


def test_without_free_flight_a_parabola_is_fitted():
    t = times()
    contact = 0.1003
    height = np.where(t < contact, 2.0 * (contact - t) - 0.5 * 300.0 * (contact - t) ** 2, 0.0)
    found = fit_flight(t, height, contact, -1, 1e-6)
    assert found.speed == pytest.approx(2.0, rel=1e-3)
    assert "not in free flight" in found.note


def test_too_few_samples_give_no_speed():
    t = np.arange(0, 0.2, 1 / 1000.0)
    found = fit_flight(t, 2.0 * (0.1 - t), 0.1, -1, 1e-6)
    assert np.isnan(found.speed)
    assert "4 are needed" in found.note


def test_a_string_that_is_lower_than_the_geometry_says_is_ambiguous():
    (strike,) = find_strikes(motion(flight_m(times(), string_m=1.2e-3), times()))
    assert strike.status == "ambiguous"
    assert "turns back sharply" in strike.note
    assert strike.time_s == pytest.approx(IMPACT_S, abs=1e-3)


def test_a_hammer_that_falls_back_by_itself_does_not_strike():
    t = times()
    height = 1e-3 + 0.5 * 9.81 * (t - 0.1) ** 2  # thrown to 1 mm below the string
    assert find_strikes(motion(np.minimum(height, REST_M), t)) == []


def test_a_hammer_that_does_not_come_back_is_ambiguous():
    t = times()
    height = np.where(t < IMPACT_S, flight_m(t), -1e-3)
    (strike,) = find_strikes(motion(height, t))
    assert strike.status == "ambiguous"
    assert np.isnan(strike.rebound.speed)


def test_two_strikes_are_told_apart_and_a_rattle_at_the_string_is_one():
    t = np.arange(0, 0.5, 1 / RATE_HZ)
    twice = np.where(t < 0.3, flight_m(t), flight_m(t, impact_s=0.35, speed=1.2, rebound=0.9))
    strikes = find_strikes(motion(twice, t))
    assert [s.time_s for s in strikes] == pytest.approx([IMPACT_S, 0.35], abs=1e-5)
    assert strikes[1].arrival.speed == pytest.approx(1.2, rel=1e-3)
    rattle = flight_m(t) - 1.5e-3 * np.exp(-(((t - 0.1035) / 2e-4) ** 2))
    assert len(find_strikes(motion(rattle, t))) == 1


def test_lost_samples_before_contact_are_skipped():
    height = flight_m(times())
    height[498] = np.nan
    (strike,) = find_strikes(replace(motion(height, times())))
    assert strike.arrival.speed == pytest.approx(SPEED, rel=1e-3)
