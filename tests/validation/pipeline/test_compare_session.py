"""A session of known truth: what validation recovers lies within its stated uncertainty."""

from __future__ import annotations

import numpy as np
import pytest

from validation import EVENTS, InputError, find_events
from validation import compare as compare_session
from validation.measurement.geometry import geometry_of, motion_of


def test_recovered_angles_lie_within_their_stated_uncertainty(recorded, compared):
    _, truth = recorded
    inside = compared.window.mask(truth.time_s)
    relative = []
    for number, frame in compared.traces.items():
        for channel, body in (("key", 0), ("whippen", 1), ("hammer", 4)):
            true = truth.angle_rad[number][:, body] - truth.rest_rad[body]
            error = (frame[f"{channel}_measured_rad"].to_numpy() - true)[inside]
            u = compared.uncertainty.query("trial == @number and channel == @channel")["u_rad"].item()
            # the rounding of a sample minus the rounding of its zero is triangular: it ends at √6 u
            assert np.abs(error).max() <= np.sqrt(6) * u * (1 + 1e-6)
            relative.append(np.mean(error**2) / u**2)
    assert 0.5 < np.sqrt(np.mean(relative)) < 1.2


def test_recovered_force_lies_within_its_stated_uncertainty(recorded, compared, make):
    _, truth = recorded
    for number, frame in compared.traces.items():
        true = np.interp(frame["force_time_s"], truth.time_s, truth.force_n[number])
        error = frame["force_n"].to_numpy() - true
        inside = compared.window.mask(frame["force_time_s"].to_numpy())
        z = error[inside] / frame["u_force_n"].to_numpy()[inside]
        # preload, offset and hum are common to many samples; the noise dominates
        assert np.mean(np.abs(z) < 2) > 0.93
        assert np.abs(error[inside].mean()) < 0.01


def test_events_of_a_trial_lie_within_their_stated_uncertainty(recorded, compared):
    _, truth = recorded
    geometry = geometry_of(truth.specimen, truth.rest_rad)
    checked = 0
    for number in compared.traces:
        change = (truth.angle_rad[number] - truth.rest_rad)[:, [0, 1, 4]]
        true = find_events(motion_of(geometry, truth.time_s, change, np.full(3, 1e-9)), 1000)
        for row in compared.events.query("trial == @number and source == 'trial'").itertuples():
            assert row.status == true[row.event].status
            if row.status == "found":
                assert abs(row.value - true[row.event].value) <= 3 * row.u, row
                checked += 1
    assert checked == 5 * (len(EVENTS) - 1)


def test_a_session_without_a_usable_trial_is_refused(make, tmp_path):
    session, truth = make.session(tmp_path / "s", n_trials=1, filmed=())
    session.annotate(1, "reject", "string broke")
    with pytest.raises(InputError, match="no usable trial.*string broke"):
        compare_session(session, truth.action)
