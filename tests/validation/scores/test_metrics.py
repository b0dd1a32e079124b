"""Scores against closed forms and published vectors."""

from __future__ import annotations

import numpy as np
import pytest

from validation.scores.curve_scores import compute_pair_rmse, score_curve, sprague_geers


def test_score_of_a_known_difference():
    time = np.arange(4.0)
    trial = np.array([0.0, 2.0, 4.0, 0.0])
    model = trial + np.array([1.0, -3.0, 1.0, 1.0])
    s = score_curve(time, trial, model)
    assert s["rmse_rad"] == pytest.approx(np.sqrt(3.0))
    assert s["bias_rad"] == 0.0
    assert s["scatter_rad"] == pytest.approx(np.sqrt(3.0))
    assert (s["largest_rad"], s["largest_at_s"]) == (3.0, 1.0)
    assert s["rmse_over_range"] == pytest.approx(np.sqrt(3.0) / 4)
    assert (s["n"], s["n_lost"]) == (4, 0)


def test_lost_samples_are_left_out_and_counted():
    trial = np.array([0.0, np.nan, 1.0, 2.0])
    model = np.array([1.0, 5.0, np.nan, 3.0])
    s = score_curve(np.arange(4.0), trial, model)
    assert (s["rmse_rad"], s["n"], s["n_lost"]) == (1.0, 2, 2)
    nothing = score_curve(np.arange(2.0), np.array([np.nan, 1.0]), np.array([1.0, np.nan]))
    assert np.isnan(nothing["rmse_rad"])
    assert nothing["n"] == 0


def test_a_flat_trial_has_no_relative_score():
    s = score_curve(np.arange(3.0), np.zeros(3), np.ones(3))
    assert s["rmse_rad"] == 1.0
    assert np.isnan(s["rmse_over_range"])


def test_trial_to_trial_rmse_is_root_two_times_the_scatter():
    rng = np.random.default_rng(1)
    value, pairs = compute_pair_rmse(rng.normal(0, 3.0, (20_000, 5)))
    assert pairs == 10
    assert value == pytest.approx(3.0 * np.sqrt(2), rel=0.01)
    assert compute_pair_rmse(rng.normal(size=(10, 40)))[1] == 200
    assert np.isnan(compute_pair_rmse(np.ones((10, 1)))[0])
    assert compute_pair_rmse(np.array([[0.0, 5.0, 1.0, 7.0]]), kinds=[0, 1, 0, 1]) == (pytest.approx(np.sqrt(2.5)), 2)


def reference_pair(scale=1.0, delay_s=0.0):
    """Decaying sine of the Sprague–Geers test cases, onset at 0.2 s, 12 s long."""
    t = np.arange(0, 12 + 1e-12, 0.0005)

    def wave(onset):
        return np.where(t >= onset, np.exp(-(t - onset)) * np.sin(2 * np.pi * (t - onset)), 0.0)

    return wave(0.2), scale * wave(0.2 + delay_s)


@pytest.mark.parametrize(
    ("scale", "delay_s", "m", "p", "c"),
    [
        (1.2, 0.0, 0.2, 0.0, 0.2),
        (1.0, 0.1, 0.0, 0.19581, 0.19581),
        (1.0, -0.1, 0.0, 0.19581, 0.19581),
        (1.2, 0.1, 0.2, 0.19581, 0.27990),
        (-1.0, 0.0, 0.0, 1.0, 1.0),
    ],
)
def test_magnitude_and_phase_errors_of_the_published_cases(scale, delay_s, m, p, c):
    measured, computed = reference_pair(scale, delay_s)
    found = sprague_geers(measured, computed)
    assert found == pytest.approx((m, p, c), abs=1e-4)


def test_a_curve_of_zeros_has_no_magnitude_error():
    assert np.isnan(sprague_geers(np.zeros(5), np.ones(5))).all()
    assert np.isnan(sprague_geers(np.ones(5), np.zeros(5))).all()
