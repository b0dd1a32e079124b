"""Bad input: each fault is named in one line, and what is left is still compared."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import model
from rig import Session
from rig.session.sealed_trial import Content
from tests.validation.prediction.test_trial_prediction import SIMPLE
from validation import InputError
from validation import compare as compare_session

QUICK = {"keep_predictions": False, **SIMPLE}


@pytest.fixture(scope="module")
def strokes(make):
    """Time, force and encoder angles of one blow, computed once."""
    return make.play(model.load_action())


def reasons(session):
    result = compare_session(session, **QUICK)
    for line in result.warnings:
        assert "\n" not in line
    return result, result.trials.set_index("trial")["reason"]


@pytest.mark.parametrize("rows", [0, 1])
def test_a_film_of_one_frame_leaves_the_other_trials(make, strokes, tmp_path, rows):
    session = Session.create(tmp_path / "s", make.info())
    for number in (1, 2):
        session.add_trial(make.trial(number, *strokes))
    columns = ("time_s", *(f"{body}_relative{tail}" for body in ("jack", "repetition") for tail in ("_rad", "_u_rad")))
    session.write_derived("angles", 1, pd.DataFrame(dict.fromkeys(columns, [0.5] * rows)))
    result, reason = reasons(session)
    assert list(result.traces) == [2] and "time_s must increase over two rows or more" in reason[1]


@pytest.mark.parametrize(
    ("units", "words"), [("kN", "units 'kN', expected 'N'"), (None, "units missing, expected 'N'")]
)
def test_wrong_or_missing_units_are_named(make, strokes, tmp_path, monkeypatch, units, words):
    session = Session.create(tmp_path / "s", make.info())
    session.add_trial(make.trial(1, *strokes))
    close = Content.close

    def other(content, dataset, sha256):
        close(content, dataset, sha256)
        if dataset.name == "/daq/force":
            if units is None:
                del dataset.attrs["units"]
            else:
                dataset.attrs["units"] = units

    monkeypatch.setattr(Content, "close", other)
    session.add_trial(make.trial(2, *strokes))
    with pytest.warns(UserWarning, match="trial 2 is left out"):
        result, reason = reasons(Session.open(tmp_path / "s"))
    assert list(result.traces) == [1]
    assert f"trial_0002.h5: daq/force: {words}" in reason[2]


def test_a_missing_channel_a_truncated_file_and_a_single_trial_are_named(make, strokes, tmp_path):
    session = Session.create(tmp_path / "s", make.info())
    for number in (1, 2):
        session.add_trial(make.trial(number, *strokes))
    session.add_trial(make.trial(3, *strokes, names=("key", "whippen", "motor")))
    with session.trials[1].path.open("r+b") as file:
        file.truncate(100_000)
    with pytest.warns(UserWarning, match="trial 2 is left out"):
        result, reason = reasons(Session.open(tmp_path / "s"))
    assert list(result.traces) == [1]
    assert "truncated" in reason[2]
    assert "encoder 'hammer' is missing" in reason[3]
    assert any(line.startswith("One trial: repeatability is not known") for line in result.warnings)
    assert np.isfinite(result.channels["rmse_rad"].iloc[0])
    assert result.channels["state"].iloc[0] == "one trial"


def test_trials_of_several_conditions_are_not_pooled(make, strokes, tmp_path):
    from dataclasses import replace

    session = Session.create(tmp_path / "s", make.info())
    for number, condition in ((1, "loud"), (2, "soft"), (3, "loud")):
        session.add_trial(replace(make.trial(number, *strokes), condition=condition))
    with pytest.raises(InputError, match=r"several conditions found: 'loud' \(2 trials\), 'soft' \(1 trials\)"):
        compare_session(session, **QUICK)
    result = compare_session(session, condition="loud", **QUICK)
    trials = result.trials.set_index("trial")
    assert list(trials.index[trials["used"]]) == [1, 3]
    assert "condition 'soft'" in trials.loc[2, "reason"]
    with pytest.raises(InputError, match="no usable trial of the condition 'silent'"):
        compare_session(session, condition="silent", **QUICK)
    with (session.path / "trial_0002.h5").open("r+b") as file:
        file.truncate(100_000)
    session.add_trial(replace(make.trial(4, *strokes, names=("key", "whippen", "motor")), condition="soft"))
    with pytest.warns(UserWarning, match="trial 2 is left out"):
        result, reason = reasons(Session.open(session.path))  # those of the other condition are not usable
    assert list(result.traces) == [1, 3] and "encoder 'hammer' is missing" in reason[4]


def test_trials_that_lack_the_same_encoder_are_named_together(make, strokes, tmp_path):
    session = Session.create(tmp_path / "s", make.info())
    for number in range(1, 7):
        session.add_trial(make.trial(number, *strokes, names=("key", "whippen", "motor")))
    with pytest.raises(InputError, match=r"trials 1, 2, 3, 4 and 2 more: encoder 'hammer' is missing") as caught:
        compare_session(session, **QUICK)
    assert "\n" not in str(caught.value)
