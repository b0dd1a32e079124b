"""Guards of the ISO-style score: raised by each trap with its own numbers, silent on a plain pair, score untouched."""

from __future__ import annotations

import numpy as np
import pytest

from validation.scores.curve_scores import choose_trial_pairs, compute_scores
from validation.scores.iso18571 import iso_score
from validation.scores.iso18571_guards import list_guard_notes

STEP = 1e-4


def stroke(time, late=0.0):
    """An angle that leaves rest, holds and comes back."""
    t = time - late
    return -0.05 * (np.tanh((t - 0.03) / 0.008) - np.tanh((t - 0.07) / 0.008)) / 2


def raised(trial, model):
    time = np.arange(trial.size) * STEP
    scores = compute_scores(time, trial, model)
    return scores, list_guard_notes(time, trial, model, scores)


def test_a_plain_pair_raises_none():
    time = np.arange(1000) * STEP
    scores, notes = raised(stroke(time), 1.04 * stroke(time, 0.0012))
    assert notes == []
    assert scores["iso_shift_s"] == pytest.approx(0.0012, abs=2e-4)


def test_an_offset_common_to_both_is_flagged_with_the_score_without_it():
    time = np.arange(1000) * STEP
    trial, model = stroke(time), 1.15 * stroke(time, 0.002)
    plain, none = raised(trial, model)
    lifted, notes = raised(trial - 1.5, model - 1.5)
    assert lifted["iso_overall"] > plain["iso_overall"] + 0.02
    assert none == []
    assert len(notes) == 1
    assert notes[0].startswith("offset: both curves stand on -1.5 rad")
    assert f"{plain['iso_overall']:.3f}" in notes[0]


def test_a_window_padded_with_rest_is_flagged_with_the_score_without_it():
    time = np.arange(5000) * STEP
    padded, notes = raised(stroke(time), 1.3 * stroke(time, 0.004))
    assert [n.split(":")[0] for n in notes] == ["window"]
    short = np.arange(1000) * STEP
    plain, _ = raised(stroke(short), 1.3 * stroke(short, 0.004))
    without = float(notes[0].split()[-1])
    assert without < plain["iso_overall"] < padded["iso_overall"]  # the short one still has some rest
    assert without < padded["iso_overall"] - 0.1


def test_a_wrong_period_is_flagged_and_the_score_is_that_of_the_standard():
    # five periods of a sine, 1.5 % of the record late: the wrong period wins
    tau = np.arange(512) / 512
    trial, model = np.sin(10 * np.pi * tau), np.sin(10 * np.pi * (tau - 0.015))
    scores, notes = raised(trial, model)
    assert scores["iso_shift_s"] == pytest.approx(-95 * STEP)
    assert scores["iso_phase"] == iso_score(trial, model, STEP).phase == pytest.approx((102.4 - 95) / 102.4)
    assert len(notes) == 1
    assert notes[0].startswith("periodicity: the curves fit best -9.50 ms apart, but also 0.80 ms apart;")


def test_a_curve_that_does_not_move_has_no_meaning():
    _, notes = raised(np.zeros(100), np.zeros(100))
    assert notes == ["constant: the trial does not move, so phase and slope have no meaning"]


def test_marked_samples_are_cut_out_of_both_curves():
    time = np.arange(1000) * STEP
    trial, model = stroke(time), stroke(time)
    trial[400:440] += 0.02  # a false spike, left out
    spoiled, _ = raised(trial, model)
    trial[400:440] = np.nan
    cut, _ = raised(trial, model)
    assert spoiled["iso_overall"] < 0.98
    assert cut["iso_overall"] == 1.0
    assert cut["rmse_rad"] == 0.0
    trial[::3] = np.nan
    assert np.isnan(compute_scores(time, trial, model)["iso_overall"])


def test_at_most_two_hundred_seeded_pairs():
    assert choose_trial_pairs(5) == [(i, j) for i in range(5) for j in range(i + 1, 5)]
    many = choose_trial_pairs(60)
    assert len(set(many)) == 200
    assert many == choose_trial_pairs(60)
    assert many != choose_trial_pairs(60, seed=1)
    assert choose_trial_pairs(1) == []
