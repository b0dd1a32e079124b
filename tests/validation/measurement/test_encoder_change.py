"""Encoder angles since rest and their uncertainties: rules that must hold exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.session.force_correction import Quiet
from validation.measurement.trial import encoder_change

RATE_HZ = 5000.0
TIME_S = np.arange(int(RATE_HZ)) / RATE_HZ
QUIET = Quiet(1950, 0.0, float(TIME_S[1949]), 0.4)


@settings(max_examples=40)
@given(phase=st.floats(0, 0.999), resolution=st.sampled_from([1.92e-5, 3.83e-5]), travel=st.floats(-0.5, 0.5))
def test_an_encoder_angle_is_never_further_off_than_its_rounding(phase, resolution, travel):
    true = travel * np.clip((TIME_S - 0.4) / 0.1, 0, 1)
    angle = np.floor(true / resolution + phase) * resolution
    change, u, u_zero = encoder_change(angle[:, None], QUIET, np.array([resolution]))
    assert u[0] == u_zero[0] == pytest.approx(resolution / np.sqrt(12))
    # the difference of two roundings is triangular
    assert np.abs(change[:, 0] - true).max() <= np.sqrt(6) * np.hypot(u[0], u_zero[0]) * (1 + 1e-9)


def test_jitter_seen_at_rest_enters_the_uncertainty():
    angle = np.random.default_rng(1).choice([0.0, 1e-4], size=(TIME_S.size, 1))
    _, u, _ = encoder_change(angle, QUIET, np.array([1e-5]))
    assert u[0] == pytest.approx(0.5e-4, rel=0.05)


def test_budgets_of_scale_and_film_enter_the_uncertainties_of_the_trial(make):
    """The rig file's interpolation, pivot shift and eccentricity; the tracker's total where it states one."""
    import model
    from rig.session import CameraInfo
    from validation.measurement.geometry import geometry_of
    from validation.measurement.trial import measure

    action = model.load_action("hirschkorn2004")
    rest = model.rest_state(action, force_n=make.preload_n)
    time = np.arange(5000) / make.rate_hz
    force = make.preload_n + make.force(time)
    run = model.simulate(action, time, force, initial=rest)
    data = make.trial(1, time, force, (run.angle_rad - rest.angle_rad)[:, [0, 1, 4]])
    budget = {
        "u_interpolation_rad": 2e-5,
        "u_pivot_shift_rad": 3e-5,
        "u_eccentricity_rad": 4e-4,
        "u_scale_relative": 3e-4,
    }
    worse = replace(data, encoders=(replace(data.encoders[0], **budget), *data.encoders[1:]))
    camera = CameraInfo(2000.0, 0.3001, 1e-4, 1000, 2e-6)
    film = make.film(camera, run, rest)
    geometry = geometry_of(action, rest.angle_rad)
    plain, stated = measure(data, film, geometry), measure(worse, film, geometry)
    assert stated.u_rad[0] ** 2 - plain.u_rad[0] ** 2 == pytest.approx(2 * 2e-5**2 + 3e-5**2)
    assert stated.u_rad[2] == plain.u_rad[2]
    assert stated.scale_relative_u[0] == pytest.approx(5e-4)
    assert stated.motion.u_dip_m > plain.motion.u_dip_m
    touch = stated.motion.key_touch_dip_m
    assert stated.motion.u_dip_zero_m**2 - plain.motion.u_dip_zero_m**2 == pytest.approx((5e-4 * touch) ** 2)
    np.testing.assert_array_equal(plain.film.u_rad["jack"], film["jack_relative_u_rad"])
    total = measure(data, film.assign(jack_relative_u_total_rad=9e-4), geometry)
    np.testing.assert_array_equal(total.film.u_rad["jack"], 9e-4)
    np.testing.assert_array_equal(total.film.u_rad["repetition"], film["repetition_relative_u_rad"])
