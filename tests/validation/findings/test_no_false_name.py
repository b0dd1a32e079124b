"""No false name: a model that differs is no fault of the session; a fault in all trials ends in its report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.session import Session
from validation import compare as compare_session
from validation import write_report
from validation.findings.finding import KINDS
from validation.report.page import section_tables
from validation.report.view import SessionView


def test_inputs_are_drawn_on_a_sound_trial(make, tmp_path, fewer_draws):
    session, truth = make.session(tmp_path / "right", n_trials=3, filmed=())
    broken = Session.create(tmp_path / "broken", make.info())
    for trial in session.trials:
        data = trial.read()
        count = data.encoder_count.copy()
        if trial.number == 1:  # that of median peak force
            count[:, 2] = count[0, 2]
        broken.add_trial(replace(data, encoder_count=count))
    result = compare_session(broken, truth.action, keep_predictions=False, rivals=(), explain=False)
    hammer = result.quantities.set_index("quantity").loc["hammer_in_attack"]
    assert np.isfinite(hammer.low) and hammer.n_trials == 2
    assert "no motion" in set(result.findings["kind"])


def test_a_report_of_a_session_wired_wrong_in_all_trials_can_be_written(make, tmp_path):
    session, truth = make.session(tmp_path / "right", n_trials=2, filmed=())
    wrong = Session.create(tmp_path / "wrong", make.info())
    for trial in session.trials:
        data = trial.read()
        wrong.add_trial(replace(data, encoder_count=-data.encoder_count))
    result = compare_session(wrong, truth.action, keep_predictions=False, rivals=(), budget=False, explain=False)
    assert set(result.findings["kind"]) == {"sign flip", "hum"}  # the recorded session has hum
    assert not result.scores["pooled"].any()
    assert result.channels["rmse_rad"].isna().all()
    assert Path(write_report(result, tmp_path / "report").files["report.html"]).stat().st_size > 10_000


def test_what_explains_the_difference_is_named_with_its_size_and_is_no_finding(planted):
    changes = planted.compatible_changes
    own = changes[changes["cause"] == "key.joint_friction.A"]
    assert own["set"].tolist() == [1] and len(changes) == 1  # alone
    assert (abs(own["change"] - 2.5) < 3 * own["u"] * own["change"]).all() and (own["u"] < 0.05).all()
    assert (changes["left"] < changes["left_by_noise"]).all()  # exceeded by chance in one session of a hundred
    assert (changes["left_by_noise"] < 1.0).all()  # the difference itself is no noise
    assert not set(planted.findings["kind"]) - set(KINDS)
    assert not planted.findings["text"].str.contains("friction").any()
    (said,) = [text for text in planted.warnings if text.startswith("about the model")]
    assert "joint friction of the key (key.joint_friction.A) ×" in said and "compared were force gain" in said
    assert not any("friction" in line for line in planted.verdict_lines)


def test_one_quantity_has_one_number_in_every_table(planted):
    card = planted.scorecard.set_index(["score", "channel"])["value"]
    channels = planted.channels.set_index("channel")
    for score in ("rmse_rad", "iso_overall"):
        for channel, value in card[score].dropna().items():
            assert channels.loc[channel, score] == pytest.approx(value, rel=1e-12)
    pages = {page.key: page for page in section_tables(SessionView((planted,)), "scores")}
    shown, whole = pages["scores-channels"], pages["scores-scorecard"]
    at = shown.head.index("RMSE (°)")
    rmse = {row[0]: row[at] for row in shown.rows}
    titles = [row for row in whole.rows if row[1] == "RMSE (°)"]
    assert titles and all(rmse[row[0]] == row[2] for row in titles)
