"""Force from the key's motion: scores in closed form, samples left out, and the true force within its uncertainty."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from validation import compare as compare_session
from validation.prediction.motion_driven import motion_row


def frame(error, left_out):
    n = len(error)
    measured = np.linspace(0, 20, n)
    return pd.DataFrame(
        {
            "time_s": np.arange(n) * 2e-4,
            "force_n": measured,
            "u_force_n": 0.03,
            "predicted_force_n": measured + error,
            "u_predicted_n": 0.02,
            "factor": 2.5,
            "left_out": left_out,
        }
    )


def test_scores_of_a_known_error_without_what_is_left_out():
    error = np.full(100, 0.1)
    error[:10] = 50.0
    row = motion_row(7, frame(error, np.arange(100) < 10), 0.0)
    assert row["trial"] == 7
    assert row["rmse_n"] == pytest.approx(0.1)
    assert row["bias_n"] == pytest.approx(0.1)
    assert row["rmse_over_peak"] == pytest.approx(0.1 / 20)
    assert row["left_out_share"] == pytest.approx(0.1)
    # 2 × 0.03 and 2.5 × 0.02 together are 0.078
    assert row["within_95_share"] == 0.0
    assert motion_row(7, frame(0.7 * error, np.arange(100) < 10), 0.0)["within_95_share"] == 1.0
    assert motion_row(7, frame(error, np.ones(100, dtype=bool)), 0.0)["n"] == 0


def test_gain_is_part_of_the_stated_uncertainty():
    without = motion_row(1, frame(np.full(100, 0.1), np.zeros(100, dtype=bool)), 0.0)
    with_gain = motion_row(1, frame(np.full(100, 0.1), np.zeros(100, dtype=bool)), 0.01)
    assert with_gain["u_rms_n"] > without["u_rms_n"]
    assert 0 < with_gain["within_95_share"] < 1


def test_the_force_of_a_known_specimen_is_found_again(make, tmp_path):
    session, truth = make.session(tmp_path / "forte", n_trials=1, filmed=())
    options = {"keep_predictions": False, "rivals": (), "budget": False, "explain": False, "by_motion": True}
    row = compare_session(session, truth.specimen, **options).motion_driven.iloc[0]
    assert row["rmse_over_peak"] < 0.02
    assert row["peak_predicted_n"] == pytest.approx(row["peak_measured_n"], rel=0.1)
    assert row["within_95_share"] > 0.85
    assert row["left_out_share"] < 0.15
