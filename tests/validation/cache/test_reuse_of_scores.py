"""Each step is done again only where what enters it has changed, and then gives what a run without memory gives."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace

import pandas as pd
import pytest

import model
from rig import Session
from tests.validation.prediction.test_trial_prediction import SIMPLE, Counting
from validation import compare as compare_session
from validation.cache import result_store


class Heavy(Counting):
    """Moves the further the heavier the hammer."""

    def __call__(self, action, *args, initial, estimate_error=False, **options):
        found = super().__call__(action, *args, initial=initial, **options)
        found.angle_rad = initial.angle_rad + action["hammer.mass"] / 0.0117 * (found.angle_rad - initial.angle_rad)
        return found


@pytest.fixture
def predict(monkeypatch):
    """Stands where `model.simulate` stands and counts; the comparison takes it for the model."""
    counting = Heavy()
    monkeypatch.setattr(model, "simulate", counting)
    # it does not move as the trials do: each would be run under other signs and units of the force
    monkeypatch.setattr("validation.findings.force.FACTORS", {})
    monkeypatch.setattr(model.touch, "find_check_load", lambda *_, **__: None)  # it has no hammer that strikes
    # how often is counted here, not what comes out
    monkeypatch.setattr("validation.scores.perfect_model.DRAWS", 5)
    return counting


@pytest.fixture(scope="module")
def compared_once(make, tmp_path_factory):
    """Three trials, the second one filmed, compared once."""
    session, truth = make.session(tmp_path_factory.mktemp("reuse") / "forte", n_trials=3, filmed=(2,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model, "simulate", Heavy())
        patch.setattr("validation.findings.force.FACTORS", {})
        patch.setattr(model.touch, "find_check_load", lambda *_, **__: None)
        compare_session(session, truth.action, **SIMPLE)
    return session.path, truth.action


@pytest.fixture
def bench(compared_once, tmp_path, predict):
    """A copy of them, and the action they were compared with."""
    folder = tmp_path / "forte"
    shutil.copytree(compared_once[0], folder)
    return folder, compared_once[1]


def again(folder, action, **options):
    """Compare again; counts of what was reused, after a check against a comparison that remembers nothing."""
    found = compare_session(folder, action, **SIMPLE | options)
    fresh = compare_session(folder, action, keep_predictions=False, **SIMPLE | options)
    assert set(fresh.provenance["reused"].values()) <= {f"0 of {n}" for n in range(1, 500)}, (
        "nothing may be known to it"
    )
    for name in ("scores", "scorecard", "channels", "events", "event_summary", "quantities", "findings", "marked"):
        pd.testing.assert_frame_equal(found.tables[name], fresh.tables[name], check_exact=True)
    assert found.verdict_lines == fresh.verdict_lines
    return found.provenance["reused"]


def all_of(n, filmed=1):
    return {
        "predictions": f"{n} of {n}",
        "events": f"{2 * n} of {2 * n}",
        "curve scores": f"{3 * n + 2 * filmed} of {3 * n + 2 * filmed}",
        "force sign and unit": f"{n} of {n}",  # the stand-in does not move as the trials do
    }


def test_unchanged_touched_or_renamed_nothing_is_done_again(bench, predict):
    folder, action = bench
    assert again(folder, action) == all_of(3)
    assert len(predict.calls) == 3  # of the comparison without memory; no spike of the force asks the model
    for file in folder.rglob("*"):
        os.utime(file, (1, 1))
    moved = folder.with_name("another name")
    folder.rename(moved)
    assert again(moved, action) == all_of(3)


def test_a_rejected_trial_leaves_the_others_known_and_comes_back_known(bench):
    folder, action = bench
    Session.open(folder).annotate(2, "reject", "string broke")
    assert again(folder, action) == all_of(2, filmed=0)
    Session.open(folder).annotate(2, "accept", "it did not")
    assert again(folder, action) == all_of(3)


def test_without_the_trial_that_rests_last_the_window_is_another_and_all_is_scored_again(bench):
    folder, action = bench
    Session.open(folder).annotate(3, "reject", "string broke")
    assert again(folder, action) == all_of(2) | {"curve scores": "0 of 8"}


def test_a_further_trial_is_the_only_one_scored(bench, make):
    folder, action = bench
    first = Session.open(folder).trials[0].read()
    count = first.encoder_count.copy()
    count[3000:3010] += 1
    Session.open(folder).add_trial(replace(first, number=4, raw_force_n=first.raw_force_n * 1.001, encoder_count=count))
    assert again(folder, action) == {
        "predictions": "3 of 4",
        "events": "6 of 8",
        "curve scores": "11 of 14",
        "force sign and unit": "3 of 4",
    }


def altered(folder, change):
    """The same session with one trial recorded otherwise, sealed again."""
    old = Session.open(folder)
    data = [trial.read() for trial in old.trials]
    new = Session.create(folder.with_name("altered"), old.info)
    for trial in data:
        new.add_trial(change(trial) if trial.number == 3 else trial)
    shutil.copytree(folder / "derived", new.path / "derived")
    return new.path


def one_count(trial):
    count = trial.encoder_count.copy()
    count[3000, 2] += 1
    return replace(trial, encoder_count=count)


def one_sample_of_the_force(trial):
    force = trial.raw_force_n.copy()
    force[3000] += 1e-3
    return replace(trial, raw_force_n=force)


def new_calibration(trial):
    return replace(trial, encoders=(replace(trial.encoders[0], u_scale_relative=1e-3), *trial.encoders[1:]))


@pytest.mark.parametrize(
    ("change", "again_made"),
    [
        (one_count, {"events": "5 of 6", "curve scores": "10 of 11", "force sign and unit": "2 of 3"}),
        (
            one_sample_of_the_force,
            {"predictions": "2 of 3", "events": "5 of 6", "curve scores": "8 of 11", "force sign and unit": "2 of 3"},
        ),
        (new_calibration, {"events": "5 of 6"}),
    ],
)
def test_what_is_altered_in_a_trial_makes_again_what_saw_it(bench, change, again_made):
    folder, action = bench
    assert again(altered(folder, change), action) == all_of(3) | again_made


def test_another_track_of_a_film_scores_the_film_again(bench):
    folder, action = bench
    session = Session.open(folder)
    table, _ = session.read_derived("angles", 2)
    table["jack_relative_rad"] *= 1.001
    session.write_derived("angles", 2, table)
    assert again(folder, action) == all_of(3) | {"curve scores": "10 of 11"}


def test_another_level_makes_the_events_again(bench):
    folder, action = bench
    assert again(folder, action, u_rest_level_m=1e-4) == all_of(3) | {"events": "3 of 6"}


def test_other_code_makes_scores_again_and_another_model_everything(bench, monkeypatch):
    folder, action = bench
    with monkeypatch.context() as patch:
        patch.setattr(result_store, "code_sha256", lambda *package: "changed")
        found = again(folder, action)
    assert found == {name: count.replace(count.split()[0], "0", 1) for name, count in all_of(3).items()} | {
        "predictions": "3 of 3"
    }
    monkeypatch.setattr("validation.prediction.model_under_test.model_version", lambda predict: "another model")
    assert again(folder, action)["predictions"] == "0 of 3"


def test_the_budget_is_made_once(bench, predict, fewer_draws):
    folder, action = bench
    options = {"budget": True, "progress": None}
    compare_session(folder, action, **SIMPLE | options)
    runs = len(predict.calls)
    assert runs > 50
    found = compare_session(folder, action, **SIMPLE | options)
    assert len(predict.calls) == runs
    assert found.provenance["reused"]["error draws"] == "1 of 1"
    assert found.provenance["reused"]["perfect model"] == "3 of 3"
    assert len(found.quantities) > 0
    wider = replace(action, quantities=dict(action.quantities))
    path = next(p for p, q in sorted(action.quantities.items()) if q.u > 0)
    wider.quantities[path] = replace(action.quantities[path], u=2 * action.quantities[path].u)
    found = compare_session(folder, wider, **SIMPLE | options)
    assert found.provenance["reused"]["error draws"] == "0 of 1"
    assert found.provenance["reused"]["predictions"] == "3 of 3"


def test_a_further_trial_is_the_only_one_that_is_drawn_if_any_is(bench, predict, fewer_draws):
    folder, action = bench
    first = Session.open(folder).trials[0].read()
    options = SIMPLE | {"budget": True}

    def add(number):
        Session.open(folder).add_trial(
            replace(first, number=number, raw_force_n=first.raw_force_n * (1 + 1e-3 * number))
        )

    add(4), add(5)
    compare_session(folder, action, **options)
    add(6)
    result = compare_session(folder, action, **options)
    assert len(result.judgement["drawn_trials"]) == 1
    assert result.provenance["reused"]["perfect model"] in ("4 of 5", "5 of 5")


def test_what_cannot_be_stored_is_said_once_and_changes_no_number(bench):
    folder, action = bench
    shutil.rmtree(folder / "derived" / "scores")
    (folder / "derived" / "scores").write_text("a file where a folder is needed")
    result = compare_session(folder, action, **SIMPLE)
    assert sum("scores not kept" in text for text in result.warnings) == 1
    assert result.provenance["reused"]["predictions"] == "3 of 3"
    assert result.provenance["reused"]["curve scores"] == "0 of 11"
