"""Speeds split at contacts: closed forms, no window across a contact, uncertainty against the bench's own speed."""

from __future__ import annotations

import numpy as np
import pytest

from tests.validation.bench_strokes import FINE, play
from tests.validation.events.played import nominal
from validation.conventions import ENCODER_CHANNELS
from validation.events.detect import find_events
from validation.measurement.trial import measure
from validation.scores.traces import differentiate_between_contacts, find_contact_times, make_speed_table

RATE_HZ = 5000.0


def test_a_cubic_on_each_side_of_a_contact_is_differentiated_exactly_up_to_the_contact():
    time = np.arange(400) / RATE_HZ
    t = time - 0.04002
    before, after = 3.0 * t + 40 * t**2 - 700 * t**3, -2.0 * t + 15 * t**2
    angle = np.where(t < 0, before, after)
    true = np.where(t < 0, 3.0 + 80 * t - 2100 * t**2, -2.0 + 30 * t)
    speed, u = differentiate_between_contacts(time, angle, [0.04002], 1e-6)
    np.testing.assert_allclose(speed, true, atol=1e-9)
    assert np.all(u < 0.03)
    across, _ = differentiate_between_contacts(time, angle, [], 1e-6)
    assert np.abs(across - true).max() > 1.0  # what a symmetric window makes of it


def test_between_contacts_too_close_for_a_fit_nothing_is_stated():
    time = np.arange(100) / RATE_HZ
    speed, u = differentiate_between_contacts(time, 2 * time, [0.0099, 0.0105], 1e-6)
    lost = np.isnan(speed)
    np.testing.assert_array_equal(np.flatnonzero(lost), [50, 51, 52])
    np.testing.assert_array_equal(lost, np.isnan(u))
    np.testing.assert_allclose(speed[~lost], 2.0)


@pytest.mark.parametrize("kind", ["forte", "piano", "double"])
def test_speeds_of_the_bench_lie_within_their_stated_uncertainty(kind):
    stroke = play(kind, 43)
    m = measure(stroke.data, None, nominal()[1])
    events = find_events(m.motion, m.quiet.stop)
    table = make_speed_table(m, events)
    assert len(find_contact_times(m, events, "hammer")) >= 3
    for name, column in zip(ENCODER_CHANNELS, (0, 1, 4), strict=True):
        true = stroke.truth.speed_rad_per_s[::FINE, column]
        error, u = table[f"{name}_rad_per_s"] - true, table[f"{name}_u_rad_per_s"]
        moving = np.abs(true) > 0.02 * np.abs(true).max()
        assert np.mean(np.abs(error[moving]) < 2 * u[moving]) > 0.95, name
        assert np.isfinite(u).mean() > 0.99
        assert np.nanmedian(u[moving]) < 0.02 * np.abs(true).max(), name
    near = (m.time_s < events["string_impact"].value) & (m.time_s > events["string_impact"].value - 1e-3)
    assert np.all(np.abs(error[near]) < 0.005 * np.abs(true).max())  # the hammer's, up to the string
