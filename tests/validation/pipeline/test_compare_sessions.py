"""Several sessions and models side by side: names, refusals, one report whose numbers are those of its results."""

from __future__ import annotations

import html
import json
import math
import re
from dataclasses import replace

import pandas as pd
import pytest

from rig import Session
from tests.validation.prediction.test_trial_prediction import SIMPLE
from validation import InputError, validate_sessions
from validation import compare_many as compare_sessions
from validation.numbers import degrees
from validation.pipeline.compare_sessions import distinct_models, make_distinct, same_recordings

QUICK = {"keep_predictions": False, **SIMPLE}


@pytest.fixture(scope="module")
def page(side_written):
    return side_written.files["report.html"].read_text(encoding="utf-8")


def test_the_page_repeats_the_figures_of_chapter_4(page):
    said = re.findall(r"As thesis ([^<]*)\.</figcaption>|As thesis ([^<]*)\. <span", page)
    named = {number for texts in said for text in texts for number in re.findall(r"4\.\d+", text)}
    assert named == {f"4.{k}" for k in (*range(1, 9), *range(12, 16))}
    assert not re.search(r"(https?:)?//[a-z]", page, re.I)


def test_verdict_matrix_and_files_name_session_and_model(side, side_written, page):
    lines = side.verdict_lines
    assert len(lines) == 4 + 2 + 2 + 1
    assert f"blow piano, RMSE of {side.models[1]} against calibrated" in lines[4]
    assert "5 trials cannot show it at 5 % (smallest p 0.0625)" in lines[4]
    assert lines[-1] == "Not compared: nowhere: no such session folder"
    content = json.loads(side_written.files["results.json"].read_text(encoding="utf-8"))
    (away,) = [r for r in content["tables"]["evidence"] if r["session"] == "blow piano" and r["model"] != r["against"]]
    assert f"blow piano, evidence for {side.models[1]} against calibrated: {away['reading']}" in lines[6]
    assert away["log_bayes_factor"] == 0.0 and 'id="table-models-evidence"' in page  # copies, but for their scores
    assert [(r["session"], r["model"]) for r in content["results"]] == [
        (r.session_name, r.action_name) for r in side.results
    ]
    scores = pd.read_csv(side_written.files["tables/scores.csv"])
    assert scores.groupby(["session", "model"]).size().nunique() == 1
    assert len(scores) == sum(len(r.scores) for r in side.results)
    shown = re.search(r'<table id="table-s1-scores-channels".*?</table>', page, re.S)[0]
    rows = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row) for row in re.findall(r"<tr>(.*?)</tr>", shown)][1:]
    name = html.escape(side.models[1], quote=False).replace('"', "&#34;")
    assert {row[0] for row in rows} == {"calibrated", name}
    key = next(r for r in content["tables"]["channels"] if r["channel"] == "key")
    assert rows[0][:3] == ["calibrated", "key", degrees(key["rmse_rad"])]


def test_numbers_of_captions_and_verdicts_are_those_of_the_file(side_written, page):
    content = json.loads(side_written.files["results.json"].read_text(encoding="utf-8"))
    scores = pd.DataFrame(content["tables"]["scores"])
    figure = r'data-channel="(key|whippen|hammer)" data-shows="one">.*?class="of-trial">Trial (\d+): '
    said = re.findall(figure + r"calibrated: RMSE ([\d.]+)°", page, re.S)
    assert len(said) == 6
    for channel, trial, value in said:
        row = scores.query(f"model == 'calibrated' and channel == '{channel}' and trial == {trial}").iloc[0]
        assert value == f"{math.degrees(row['rmse_rad']):.4f}"
    channels = pd.DataFrame(content["tables"]["channels"]).query("model == 'calibrated'").set_index("channel")
    line = next(text for text in content["results"][0]["verdict_lines"] if text.startswith("ISO 18571-style"))
    for channel in ("key", "whippen", "hammer"):
        row = channels.loc[channel].iloc[0]
        assert f"{channel} {row['iso_overall']:.2f} ({row['iso_ceiling']:.2f})" in line


def test_hostile_names_are_text_everywhere(side, page):
    assert page.count("<script") == page.count("</script") == 1
    assert "<img" not in page
    assert "<b>" not in page
    assert "&lt;img src=x" in page
    # a name that matplotlib could take for a formula is drawn letter by letter, cut in the middle
    assert len(side.models[1]) > 100
    assert "recalibrated $" in page
    svg = page[page.index('<figure id="figure-s1-key-model"') :].split("</svg>")[0]
    assert "…" in svg
    assert "&lt;b&gt;" not in re.search(r"<desc[^>]*>(.*?)</desc>", svg, re.S)[1]


def test_the_pairs_on_the_page_are_those_of_the_file(side_written, page):
    content = json.loads(side_written.files["results.json"].read_text(encoding="utf-8"))
    table = re.search(r'<table id="table-models-model_pairs".*?</table>', page, re.S)[0]
    rmse = [row for row in content["tables"]["model_pairs"] if row["score"] == "rmse_rad"]
    for row in rmse:
        assert row["claim"].split(" ")[0] in table
    # half as much again: the difference is half the first
    for row in rmse:
        assert row["difference"] == pytest.approx(0.5 * row["first_mean"])


@pytest.fixture(scope="module")
def strokes(make, tmp_path_factory):
    """Two trials under a plan of two conditions, and one session of the same name elsewhere."""
    folder = tmp_path_factory.mktemp("several")
    session, truth = make.session(folder / "a", n_trials=2, filmed=(), name="same")
    trials = [t.read() for t in session.trials]
    from rig.session.info import FileInfo, PlanCondition, PlanInfo

    conditions = tuple(PlanCondition(name=n, profile=FileInfo(name=n)) for n in ("forte", "piano"))
    plan = PlanInfo(trials=2, conditions=conditions, order=("forte", "piano"))
    planned = Session.create(folder / "planned", make.info(name="plan", plan=plan))
    for trial, condition in zip(trials, ("forte", "piano"), strict=True):
        planned.add_trial(replace(trial, condition=condition))
    twin = Session.create(folder / "b", make.info(name="same"))
    twin.add_trial(trials[0])
    return folder, truth


def test_conditions_stand_for_themselves_and_names_are_told_apart(strokes):
    folder, truth = strokes
    found = compare_sessions([folder / "planned", folder / "a", folder / "b"], [truth.action], **QUICK)
    assert list(found.sessions) == ["plan, forte", "plan, piano", "same (a)", "same (b)"]
    assert [len(r.traces) for r in found.results] == [1, 1, 2, 1]
    assert any("same (a) and same (b) share 1 recorded trial " in text for text in found.verdict_lines)
    one = compare_sessions([folder / "planned"], [truth.action], condition="piano", **QUICK)
    assert list(one.sessions) == ["plan, piano"]
    assert list(one.results[0].traces) == [2]


def test_models_of_one_name_are_told_apart_and_one_given_twice_is_refused(strokes, tmp_path):
    folder, truth = strokes
    text = tmp_path / "mine.toml"
    import model
    from model.parameters.action import find_action

    source = find_action("hirschkorn2004").read_text(encoding="utf-8")
    text.write_text(source.replace("mass = { value = 0.12008", "mass = { value = 0.125"), encoding="utf-8")
    found = compare_sessions([folder / "b"], ["hirschkorn2004", str(text)], **QUICK)
    assert found.models == ["hirschkorn2004 (hirschkorn2004.toml)", "hirschkorn2004 (mine.toml)"]
    assert found.results[0].scores["rmse_rad"].iloc[0] != found.results[1].scores["rmse_rad"].iloc[0]
    loose = truth.action.with_values({"contact04.friction": 0})
    names = [
        a.name for a in distinct_models([truth.action, loose, replace(loose, structure={**loose.structure, "x": ""})])
    ]
    assert names[0] == "hirschkorn2004 (unchanged)"
    assert names[1:] == ["hirschkorn2004 (model 2)", "hirschkorn2004 (model 3)"]
    with pytest.raises(InputError, match="has the same values as .*hirschkorn2004.toml; name each model once"):
        compare_sessions([folder / "b"], [truth.action, model.load_action("hirschkorn2004")], **QUICK)


def test_what_cannot_be_read_is_named_in_one_line_and_the_rest_is_reported(strokes, tmp_path):
    folder, truth = strokes
    empty = tmp_path / "empty"
    empty.mkdir()
    found = compare_sessions([empty, folder / "b", folder / "nowhere"], [truth.action], **QUICK)
    assert list(found.sessions) == ["same"]
    assert [text.count("\n") for text in found.refused] == [0, 0]
    assert "empty: not a session" in found.refused[0]
    assert "nowhere: no such session folder" in found.refused[1]
    with pytest.raises(InputError, match="no session can be compared: .*empty.*nowhere"):
        compare_sessions([empty, folder / "nowhere"], [truth.action], **QUICK)
    with pytest.raises(InputError, match="session given 2 times"):
        compare_sessions([folder / "b", folder / "a" / ".." / "b"], [truth.action], **QUICK)
    with pytest.raises(InputError, match="2 sessions: name a folder for their report with `out`"):
        validate_sessions([folder / "a", folder / "b"], [truth.action])


def test_names_of_sessions_are_made_distinct():
    assert make_distinct(["a", "b", "a"], ["x", "y", "x"], ["p/x", "y", "q/x"]) == ["a (p/x)", "b", "a (q/x)"]
    assert make_distinct(["a", "a"], ["x", "x"]) == ["a", "a"]
    assert same_recordings([]) == []
