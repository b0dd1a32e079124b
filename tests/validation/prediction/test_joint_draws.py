"""Draws of all inputs at once: what is common to the trials, what is each one's own, what a perfect model keeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from validation.measurement.session import measure_session
from validation.measurement.trial import U_REST_LEVEL_M
from validation.prediction.joint_draws import (
    CHANNELS,
    chosen_trials,
    drawn_action,
    drawn_readings,
    joint_draws,
    session_seed,
)
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.trial_prediction import predict_trial


@pytest.fixture(scope="module")
def tested(recorded):
    return ModelUnderTest(recorded[1].action)


@pytest.fixture(scope="module")
def trials(recorded, tested):
    return measure_session(recorded[0], tested.geometry_at, U_REST_LEVEL_M).trials


def test_draws_are_fixed_for_a_session_and_differ_between_sessions(trials, tested):
    seed = session_seed(trials)
    assert seed == session_seed(trials[:2]) != session_seed(trials[1:])
    a, b = (joint_draws(tested.action, seed, 5, parameters=True) for _ in range(2))
    assert a == b and [dict(d.changed) for d in a] == [dict(d.changed) for d in b]
    perfect = joint_draws(tested.action, seed, 5, parameters=False)
    assert all(not d.changed for d in perfect) and all(len(d.changed) > 100 for d in a)


def test_many_draws_have_the_declared_uncertainties(tested):
    draws = joint_draws(tested.action, 1, 400, parameters=True)
    assert np.std([d.z_gain for d in draws]) == pytest.approx(1.0, abs=0.15)
    q = tested.action.quantities["hammer.mass"]
    assert np.std([d.changed["hammer.mass"] for d in draws]) == pytest.approx(q.u, rel=0.15)


def test_a_draw_without_errors_reads_what_is_predicted(trials, tested):
    m = trials[0]
    channel = replace(m.force.channel, gain_relative_u=0.0, u_preload_n=0.0, u_group_delay_s=0.0)
    exact = replace(m, force=replace(m.force, channel=channel, noise_n=0.0, hum=replace(m.force.hum, u_offset_n=0.0)))
    draw = joint_draws(tested.action, 1, 1, parameters=False)[0]
    read = drawn_readings(tested, exact, drawn_action(tested, exact, draw), m.time_s)
    p = predict_trial(m, tested)
    for i, name in enumerate(CHANNELS[:3]):
        apart = read[:, i] - p.change_rad(name)
        known = np.isfinite(apart)
        assert known.mean() > 0.9
        assert np.abs(apart[known]).max() < 8 * m.u_rad[i] + 2 * tested.tolerance
    assert np.isnan(read[:, 3:]).all()  # not filmed


def test_gain_is_common_to_the_trials_and_noise_is_not(trials, tested):
    draw = joint_draws(tested.action, 1, 1, parameters=False)[0]
    assert draw.rng(1).standard_normal() != draw.rng(2).standard_normal()
    assert draw.rng(1).standard_normal() == draw.rng(1).standard_normal()
    strong = replace(draw, z_gain=50.0)
    at = trials[0].time_s[::10]
    for m in trials[:2]:
        usual, moved = (drawn_readings(tested, m, drawn_action(tested, m, d), at) for d in (draw, strong))
        peak = np.nanargmax(np.abs(usual[:, 2]))
        assert np.nanargmax(np.abs(moved[:, 2])) < peak  # ten percent more force strikes earlier


def test_at_most_five_trials_spread_over_the_peak_force_with_a_filmed_one(trials):
    many = [replace(trials[i % 5], number=i + 1, film=None) for i in range(12)]
    many[7] = replace(many[7], film=trials[1].film)
    chosen = chosen_trials(many)
    assert len(chosen) == 5 and sum(m.film is not None for m in chosen) == 1
    peaks = [m.force.force_n.max() for m in chosen]
    assert min(peaks) == min(m.force.force_n.max() for m in many)
    assert chosen_trials(trials) == list(trials)
