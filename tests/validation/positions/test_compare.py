"""The shipped recording of a real piano: one command, held-out strokes, a page; and a recording it has not seen."""

from __future__ import annotations

import json
import re
import shutil
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import model
import validation
from rig.session import Session
from tests.command_line import run
from validation.errors import ValidationInputError
from validation.events.strikes import find_stroke_events
from validation.infer.positions import read_identified, write_identified
from validation.measurement.positions import measure_stroke
from validation.measurement.sample_fingerprints import sample_fingerprints
from validation.pipeline.compare_positions import compare_positions
from validation.pipeline.validate_positions import render
from validation.prediction.black_boxes import KINDS
from validation.prediction.positions import Mixture

SHIPPED = Path(__file__).parents[3] / "sessions" / "kawai_kg3c"


@pytest.fixture(scope="module")
def written(shared) -> tuple[Path, dict]:
    """The report of all strokes but the slow press, whose seven seconds cost as much as the others together."""

    def make(folder: Path) -> tuple[Path, dict]:
        session, out = folder / "kawai_kg3c", folder / "real"
        shutil.copytree(SHIPPED, session, ignore=shutil.ignore_patterns("trial_0002.h5", "report.html", "results.json"))
        with (folder / "said.txt").open("w") as said, redirect_stdout(said):
            assert run("validate", session, "--by-motion", "--out", out) == 0
        return out, json.loads((out / "results.json").read_text())

    return shared(make)


def rows(results, **wanted):
    return [row for row in results["scores"] if all(row[key] == value for key, value in wanted.items())]


def test_held_out_strokes_are_predicted_better_than_by_the_null_model(written) -> None:
    results = written[1]
    held = rows(results, model="identified", fitted=False)
    assert {row["trial"] for row in held} == {4, 6}
    for row in held:
        (null,) = rows(results, model="null", trial=row["trial"])
        (plain,) = rows(results, model="regulated", trial=row["trial"])
        assert row["rmse_share"] < 0.06 < null["rmse_share"]
        assert row["rmse_share"] < 0.5 * plain["rmse_share"]
        assert row["inside_band"] >= 0.9


def test_each_stroke_says_how_far_it_lies_and_who_is_nearer(written) -> None:
    results = written[1]
    for row in results["rivals"]:
        errors = {name: value for name, value in row.items() if name.endswith("_rmse_share")}
        assert set(errors) == {f"{n}_rmse_share" for n in ("regulated", "null", "identified", *KINDS)}
        assert row["nearest"] == "identified" and row["outside"] is False and row["distance"] < 1.0
    assert results["training_distances"]["2"] > 1.0  # the only slow press
    assert "than that of the FIR filter of six lags" in (written[0].parent / "said.txt").read_text()


def same_scores(shipped, found) -> None:
    for old, new in zip(shipped, found, strict=True):
        assert (old["trial"], old["model"], old["fitted"]) == (new["trial"], new["model"], new["fitted"])
        for name in ("rmse_share", "half_width_share"):
            assert old[name] == pytest.approx(new[name], rel=0.1)


def test_the_shipped_report_says_what_the_command_says_today(written) -> None:
    shipped = json.loads((SHIPPED / "results.json").read_text())
    same_scores([row for row in shipped["scores"] if row["trial"] != 2], written[1]["scores"])
    old, new = shipped["sentence"], written[1]["sentence"]  # of the strokes that were not fitted
    number = r"\d+\.\d"
    assert re.sub(number, "", old) == re.sub(number, "", new)
    assert [float(x) for x in re.findall(number, old)] == pytest.approx(
        [float(x) for x in re.findall(number, new)], rel=0.1
    )
    assert shipped["bands"] == written[1]["bands"]


def test_what_was_fitted_and_what_was_rejected_is_said(written) -> None:
    results = written[1]
    assert {row["trial"] for row in rows(results, model="identified", fitted=True)} == {3, 5, 7, 8}
    assert "by hand" in results["refused"]["1"]


def test_the_band_was_chosen_by_training_strokes_for_each_model(written) -> None:
    bands = written[1]["bands"]
    assert set(bands) == {"regulated", "null", "identified"}
    for band in bands.values():
        assert set(band["left_out"]) == {"2", "3", "5", "7", "8"} and min(band["q"].values()) > 0
    page = (written[0] / "report.html").read_text()
    assert "How the bands were chosen" in page


def test_events_only_where_the_data_show_them(written) -> None:
    events = {(row["trial"], row["source"]): row for row in written[1]["events"]}
    slow = measure_stroke(Session.open(SHIPPED).trial(2).read())
    (press,) = find_stroke_events(slow, slow.hammer.value_m)
    assert press["let_off_m"] > 3.2e-3 and press["drop_m"] > 2e-4 and events[5, "measured"]["let_off_m"] is None
    real, made = events[5, "measured"], events[5, "identified"]
    assert abs(real["impact_s"] - made["impact_s"]) < 0.005
    assert abs(real["check_m"] - made["check_m"]) < 0.05 * 3.77e-3
    assert [row["condition"] for row in written[1]["repeatability"]][0] == "fast"


def test_page_stands_alone_and_says_what_the_sensors_forbid(written) -> None:
    page = (written[0] / "report.html").read_text()
    assert not re.search(r'(src|href)="https?:', page) and "<script" not in page
    for words in ("back of the key", "front of the key", "No force was measured", "2000 samples a second", "ruler"):
        assert words in page
    assert page.count("<figure>") == 6 and len(page) < 3_000_000


def test_curves_are_written(written) -> None:
    table = np.genfromtxt(written[0] / "curves" / "trial_0004.csv", delimiter=",", names=True)
    inside = np.abs(table["identified_hammer_m"] - table["hammer_m"]) <= table["identified_half_width_m"]
    (row,) = rows(written[1], model="identified", trial=4)
    assert inside.mean() == pytest.approx(row["inside_band"], abs=1e-3)


def test_a_recording_it_has_not_seen_needs_no_hand_work(tmp_path, capsys) -> None:
    mapping = SHIPPED / "mapping.toml"
    assert run("import", SHIPPED / "excerpt.csv", "--mapping", mapping, "--out", tmp_path / "more") == 0
    assert run("validate", tmp_path / "more", "--identified", SHIPPED, "--out", tmp_path / "out", "--json") == 0
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    (row,) = rows(results, model="identified")
    assert row["rmse_share"] < 0.06 and row["inside_band"] >= 0.9
    assert run("validate", tmp_path / "more", "--action", "hirschkorn2004", "--action", "hirschkorn2004-regulated") == 2
    assert "2 models, allowed 1" in capsys.readouterr().err


def test_a_second_import_of_fitted_samples_counts_as_fitted(tmp_path) -> None:
    record = read_identified(SHIPPED)
    session = Session.open(SHIPPED)
    for number, fitted in ((5, True), (6, False)):
        data = session.trial(number).read()
        later = measure_stroke(replace(data, started_utc="2027-01-01T00:00:00Z"))
        assert record.was_fitted_to("another file", later.samples) == fitted
    data = session.trial(5).read()
    keep = slice(40, 1500)  # another cut of the recording
    part = sample_fingerprints(
        replace(
            data,
            **{name: getattr(data, name)[keep] for name in ("time_s", "force_n", "force_raw", "encoder_count")},
            channel_values=data.channel_values[keep],
        )
    )
    assert record.was_fitted_to("another file", part)


def one_stroke(folder) -> Session:
    session = folder / "one"
    session.mkdir(exist_ok=True)
    for name in ("session.toml", "trial_0006.h5"):
        shutil.copy(SHIPPED / name, session / name)
    return Session.open(session)


def test_without_an_identified_set_there_are_no_bands(tmp_path) -> None:
    result = compare_positions(one_stroke(tmp_path))
    assert set(result.scores["model"]) == {"regulated", "null"} and result.scores["inside_band"].isna().all()
    assert "no identified set" in result.sentence
    (row,) = result.rivals.to_dict("records")  # alone it has nothing to fit a black box to
    assert "fir_rmse_share" not in row and row["outside"] is None


def test_a_set_that_does_not_know_its_strokes_says_so_and_a_stroke_unlike_them_is_outside(tmp_path) -> None:
    record = read_identified(SHIPPED)
    short = {n: {**one, "hold": 0.02, "phases": ["strike"]} for n, one in record.strokes.items()}
    for strokes, words in (({}, "Domain: not known"), (short, "lies outside of what was fitted (release: no fitted")):
        write_identified(tmp_path / "set.json", replace(record, strokes=strokes, black_boxes={}))
        result = compare_positions(one_stroke(tmp_path), identified=tmp_path / "set.json")
        assert any(words in line for line in result.verdict_lines)
    assert "outside of what was fitted" in render(result, "now", tmp_path).split("<figcaption>")[1]


def test_a_set_of_another_action_is_refused_where_it_is_named_and_else_not_used(tmp_path) -> None:
    session = one_stroke(tmp_path)
    with pytest.raises(ValidationInputError, match="identified on hirschkorn2004-regulated, not on hirschkorn2004;"):
        compare_positions(session, "hirschkorn2004", identified=SHIPPED)
    shutil.copy(SHIPPED / "identified.json", session.path)
    result = compare_positions(session, "hirschkorn2004")
    assert set(result.scores["model"]) == {"regulated", "null"} and result.scores["inside_band"].isna().all()
    assert result.identified is None and "no identified set" in result.sentence


def test_a_stroke_that_a_set_cannot_follow_is_missed_and_does_not_end_the_comparison(tmp_path, monkeypatch) -> None:
    record, predict, session = read_identified(SHIPPED), Mixture.predict, one_stroke(tmp_path)
    for n in (3, 4):
        shutil.copy(SHIPPED / f"trial_000{n}.h5", session.path)

    def failing(self, run, stroke):
        if self == record.left_out["identified"]["3"] or (self == record.mixture and stroke.number == 6):
            raise model.ModelError("cannot follow")
        return predict(self, run, stroke)

    monkeypatch.setattr(Mixture, "predict", failing)
    result = compare_positions(Session.open(session.path), identified=SHIPPED)
    rows = result.scores[result.scores["model"] == "identified"].set_index("trial")
    assert rows["fitted"].to_dict() == {3: True, 4: False, 6: False}
    assert np.isfinite(rows.loc[3, "rmse_share"]) and np.isnan(rows.loc[3, "left_out_rmse_share"])
    assert result.sentence.startswith("On 1 stroke that was not fitted")
    assert "; nearest: trial 4 " in result.sentence
    assert result.sentence.endswith("missed: trial 6 (the identified set cannot follow its key).")


def test_which_sessions_are_of_positions(tmp_path) -> None:
    assert validation.has_positions_only(SHIPPED)
    assert not validation.has_positions_only(SHIPPED.parent / "example_forte")
    assert not validation.has_positions_only(tmp_path)


def test_an_identified_set_is_for_positions_only(capsys) -> None:
    session = SHIPPED.parent / "example_forte"
    assert run("validate", session, "--identified", SHIPPED) == 2
    assert "not one session of positions" in capsys.readouterr().err


@pytest.mark.parametrize(
    "given", [("--set", "hammer.mass=0.01"), ("--scene", "string"), ("--tolerance", "1e-4"), ("--condition", "fast")]
)
def test_what_a_session_of_positions_cannot_take_is_refused(given, tmp_path, capsys) -> None:
    assert run("validate", SHIPPED, "--out", tmp_path, *given) == 2
    assert f"{given[0]}: not for a session of positions" in capsys.readouterr().err


def test_sessions_of_positions_are_compared_one_at_a_time(tmp_path, capsys) -> None:
    assert run("validate", SHIPPED, one_stroke(tmp_path).path, "--out", tmp_path / "out") == 2
    assert "2 sessions of positions without force, allowed 1 at a time" in capsys.readouterr().err


def test_driven_by_force_such_a_session_is_refused_in_one_line(tmp_path, capsys) -> None:
    assert run("validate", SHIPPED, "--no-by-motion", "--out", tmp_path) == 2
    assert "no force was recorded" in capsys.readouterr().err


def test_a_trial_without_force_drives_no_simulation(tmp_path, capsys) -> None:
    assert run("simulate", "--force", SHIPPED / "trial_0003.h5", "--out", tmp_path / "s.csv") == 2
    assert "no force was recorded, positions only" in capsys.readouterr().err


def test_a_session_without_usable_strokes_is_named(tmp_path) -> None:
    session = tmp_path / "none"
    session.mkdir()
    for name in ("session.toml", "trial_0001.h5", "annotations.jsonl"):
        shutil.copy(SHIPPED / name, session / name)
    with pytest.raises(ValidationInputError, match="no usable stroke; trial 1: rejected: hammer moved by hand"):
        compare_positions(Session.open(session))


def test_the_shipped_set_belongs_to_the_shipped_trials() -> None:
    session, record = Session.open(SHIPPED), read_identified(SHIPPED)
    assert {int(n): seal for n, seal in record.seals.items()} == {n: session.trial(n).sha256 for n in (2, 3, 5, 7, 8)}
