"""Predictions: driven by the trial's own force, stored, reused only when nothing changed."""

from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from validation import PredictionError
from validation import compare as compare_session
from validation.cache.result_store import MOST_VERSIONS, ResultStore
from validation.prediction.model_under_test import action_sha256
from validation.prediction.predict_session import PredictedAngles

SIMPLE = {"rivals": (), "budget": False, "explain": False}


class Counting:
    """Stands for ``model.simulate`` and remembers its calls; module and name as those of a user's own model."""

    def __init__(self, shape=5):
        self.calls = []
        self.shape = shape

    def __call__(self, action, time_s, force_n, *, tolerance, output_time_s, initial):
        self.calls.append(SimpleNamespace(time_s=time_s, force_n=force_n, output_time_s=output_time_s, initial=initial))
        push = np.interp(output_time_s, time_s, force_n)[:, None] * np.array([-1e-3, 2e-3, -3e-3, -4e-3, -5e-3])
        angle = initial.angle_rad + push - push[0]
        return SimpleNamespace(
            angle_rad=angle[:, : self.shape], speed_rad_per_s=np.zeros_like(angle), counters={"n_steps": 7}
        )


@pytest.fixture(autouse=True)
def one_force(monkeypatch):
    """The stand-in does not move as the trials do: each would be run under other forces, and without its spikes."""
    monkeypatch.setattr("validation.findings.force.FACTORS", {})
    monkeypatch.setattr("validation.findings.find_faults.find_unanswered_spikes", lambda *_: [])


@pytest.fixture
def small(make, tmp_path):
    return make.session(tmp_path / "small", n_trials=2, filmed=(2,))


def test_each_trial_is_driven_by_its_own_corrected_force_from_rest(small, make):
    session, truth = small
    predict = Counting()
    result = compare_session(session, truth.action, predict=predict, **SIMPLE)
    assert len(predict.calls) == 2
    for call, number in zip(predict.calls, (1, 2), strict=True):
        true = np.interp(call.time_s, truth.time_s, truth.force_n[number])
        assert np.abs(call.force_n - true).max() < 0.15
        assert np.mean(call.force_n[:1500]) == pytest.approx(make.preload_n, abs=2e-3)
        np.testing.assert_allclose(call.time_s, truth.time_s - make.group_delay_s, atol=1e-12)
        assert call.output_time_s[-1] <= call.time_s[-1]
        np.testing.assert_allclose(call.initial.angle_rad, truth.rest_rad, atol=1e-4)
    frame = result.traces[1]
    # no force is known for the last group delay of the record
    lost = frame["key_predicted_rad"].isna().to_numpy()
    assert lost.sum() == int(round(make.group_delay_s * make.rate_hz))
    assert lost[-1]


def test_what_a_prediction_depends_on_makes_it_anew(small):
    session, truth = small
    predict = Counting()
    compare_session(session, truth.action, predict=predict, **SIMPLE)
    compare_session(session, truth.action, predict=predict, tolerance=1e-6, **SIMPLE)
    assert len(predict.calls) == 4
    changed = truth.action.with_values({"hammer.mass": 0.0118})
    compare_session(session, changed, predict=predict, tolerance=1e-6, **SIMPLE)
    assert len(predict.calls) == 6
    compare_session(session, truth.action, predict=predict, keep_predictions=False, **SIMPLE)
    assert len(predict.calls) == 8


def test_the_version_used_longest_ago_goes_first(make, tmp_path):
    session, _ = make.session(tmp_path / "s", n_trials=1, filmed=())
    store, table = ResultStore(session=session), pd.DataFrame({"x": [1.0]})
    seal = session.trial(1).sha256

    def write(name):
        assert not store.write_table(f"step_{name}", 1, seal, table, {"input_sha256": name})
        for folder in (session.path / "derived").glob("step_*"):  # an hour passes
            at = folder.stat().st_mtime - 3600.0
            os.utime(folder, (at, at))

    for i in range(MOST_VERSIONS):
        write(str(i))
    assert store.table("step_0", 1, "0") is not None
    write("new")
    left = [name for name in map(str, range(MOST_VERSIONS)) if store.table(f"step_{name}", 1, name) is not None]
    assert left == ["0", *map(str, range(2, MOST_VERSIONS))]


def test_a_damaged_prediction_is_made_again(small):
    session, truth = small
    predict = Counting()
    compare_session(session, truth.action, predict=predict, **SIMPLE)
    stored = next((session.path / "derived").glob("prediction_*"))
    (stored / "trial_0001.h5").write_bytes(b"not a file")
    result = compare_session(session, truth.action, predict=predict, **SIMPLE)
    assert len(predict.calls) == 3
    assert list(result.trials["reused"]) == [False, True]


def test_a_prediction_of_the_wrong_shape_is_refused(small):
    session, truth = small
    with pytest.raises(PredictionError, match=r"prediction has shape \(\d+, 3\), expected \(\d+, 5\)"):
        compare_session(session, truth.action, predict=Counting(shape=3), **SIMPLE)


def test_predicted_angles_between_samples_follow_angles_and_speeds():
    time = np.arange(0, 0.1, 2e-4)
    turn = 2 * np.pi * 80 * time
    angle, speed = np.zeros((time.size, 5)), np.zeros((time.size, 5))
    angle[:, 2], speed[:, 2] = 0.3 + 0.1 * np.sin(turn), 0.1 * 2 * np.pi * 80 * np.cos(turn)
    angle[-10:] = np.nan
    rest = np.array([0.0, 0.0, 0.3, 0.0, 0.0])
    p = PredictedAngles(time, angle - rest, speed, rest, "", False, {})
    at = np.array([0.00513, 0.0421, 0.0995, 0.2])
    out = p.change_at("jack", at)
    np.testing.assert_allclose(out[:2], 0.1 * np.sin(2 * np.pi * 80 * at[:2]), atol=1e-7)
    assert np.isnan(out[2:]).all()


def test_the_hash_of_an_action_knows_values_and_structure(recorded):
    action = recorded[1].action
    same = action_sha256(action)
    assert same == action_sha256(action.with_values({}))
    assert same != action_sha256(action.with_values({"hammer.mass": 0.011741}))


def test_rivals_are_driven_by_their_own_force_kept_and_scored_beside_the_model(small):
    session, truth = small
    predict = Counting()
    first = compare_session(session, truth.action, predict=predict, budget=False, explain=False)
    assert len(predict.calls) == 4
    model_call, raw_call = predict.calls[:2]
    np.testing.assert_array_equal(raw_call.time_s, session.trials[0].read().time_s)
    np.testing.assert_array_equal(raw_call.force_n, session.trials[0].read().raw_force_n)
    assert not np.array_equal(raw_call.force_n, model_call.force_n)
    again = compare_session(session, truth.action, predict=predict, budget=False, explain=False)
    assert len(predict.calls) == 4
    card = first.scorecard.set_index(["channel", "score"])
    assert again.scorecard.equals(first.scorecard)
    row = card.loc[("hammer", "rmse_rad")]
    frame = first.traces[1][first.window.mask(first.traces[1]["time_s"].to_numpy())]
    by_hand = first.scores.query("trial == 1 and channel == 'hammer'").iloc[0]
    difference = frame["hammer_null_rad"] - frame["hammer_measured_rad"]
    assert by_hand["null_rmse_rad"] == pytest.approx(np.sqrt(np.nanmean(difference**2)))
    assert row["null"] == pytest.approx(
        np.sqrt(np.mean(first.scores.query("channel == 'hammer'")["null_rmse_rad"] ** 2))
    )
    assert row["ceiling_draws"] == 0 and np.isnan(row["ceiling"])  # without budget there is no ceiling
    assert row["raw_force"] > 0


def test_a_rival_that_fails_is_named_and_takes_nothing_along(small, monkeypatch):
    from model import StaticsError, null_model

    session, truth = small

    def fails(*args, **kwargs):
        raise StaticsError("does not balance")

    monkeypatch.setattr(null_model, "simulate", fails)
    result = compare_session(session, truth.action, predict=Counting(), budget=False, explain=False)
    assert "trial 1: null not predicted: does not balance" in result.warnings
    assert result.scorecard["null"].isna().all()
    assert result.scorecard["value"].notna().any()


def test_a_trial_the_model_cannot_predict_is_named_and_the_rest_is_compared(small):
    from model import IntegrationError

    session, truth = small
    good = Counting()

    def predict(action, time_s, force_n, **options):
        if len(good.calls) == 0:
            good.calls.append(None)
            raise IntegrationError("simulation stopped at t = 0.4 s")
        return good(action, time_s, force_n, **options)

    result = compare_session(session, truth.action, predict=predict, keep_predictions=False, **SIMPLE)
    assert list(result.traces) == [2]
    assert "not predicted: simulation stopped at t = 0.4 s" in result.trials.set_index("trial").loc[1, "reason"]


def test_traces_hold_times_and_predicted_curves_once_and_less_where_that_is_enough(small):
    # compared here: a comparison that another process made was read from a file, which shares nothing
    made = compare_session(small[0], small[1].action, budget=False, explain=False, keep_predictions=False)
    frames = list(made.traces.values())
    first, second = (frame["time_s"].to_numpy() for frame in frames[:2])
    assert np.shares_memory(first, second) == np.array_equal(first, second)
    for frame in frames:
        kinds = {name: frame[name].dtype for name in frame.columns}
        single = {name for name, kind in kinds.items() if kind == np.float32}
        assert single == {name for name in kinds if name.endswith("_rad_per_s") or "_null_" in name or "_raw_" in name}
        held = {id(frame[name].to_numpy().base) for name in kinds if name.endswith("_predicted_rad")}
        assert len(held) == 1  # five columns of one array, that of the prediction
