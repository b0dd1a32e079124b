"""The shipped recording of a real piano goes the way of every session: options, several models, held-out strokes."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import model
import validation
from rig.session import Session
from tests.command_line import run
from tests.validation.positions.planted import SHIPPED
from validation.measurement.sample_fingerprints import sample_fingerprints
from validation.prediction.posterior import posterior_of
from validation.tables import trials, uncertainty
from validation.tables.table import page_table

SET = SHIPPED / "identified.toml"
QUICK = {"budget": False, "explain": False, "keep_predictions": False}


def some_strokes(folder: Path, *numbers: int) -> Path:
    """A session of some of the shipped strokes."""
    session = folder / "some"
    session.mkdir(exist_ok=True)
    for name in ("session.toml", *(f"trial_{n:04d}.h5" for n in numbers)):
        shutil.copy(SHIPPED / name, session / name)
    return session


@pytest.fixture(scope="module")
def fast() -> validation.ValidationResult:
    """The three fast strokes, of which trial 6 was not fitted."""
    return validation.compare(SHIPPED, SET, condition="fast", **QUICK)


def test_a_held_out_stroke_is_predicted_nearer_than_by_any_rival(fast) -> None:
    errors = fast.rivals.set_index("trial").loc[6]
    rivals = ("null", "unfitted", "polynomial", "fir", "fir_lags")
    assert errors["nearest"] == "model"
    assert all(errors["rmse_rad"] < 0.8 * errors[f"{name}_rmse_rad"] for name in rivals)
    assert fast.scores.set_index("trial")["rmse_over_range"].loc[6] < 0.04
    assert dict(zip(fast.trials["trial"], fast.trials["fitted"], strict=True))[6] is False
    assert any("trial 6 was kept aside" in line for line in fast.verdict_lines)


def test_only_the_hammer_is_compared_and_nothing_is_said_of_a_force(fast) -> None:
    assert set(fast.scores["channel"]) == {"hammer"} and fast.provenance["driven_by"] == "key"
    assert not len(fast.motion_driven) and not len(fast.findings)
    assert "driven by its own measured motion of the key" in fast.verdict
    assert fast.trials[["peak_force_n", "offset_n", "group_delay_s", "hum_accepted"]].isna().all(axis=None)
    assert set(fast.uncertainty["source"]) == {"position sensor"}
    shown = page_table(trials.TABLE, trials.TABLE.pages[0], [fast])
    assert shown.head == ["trial", "state", "quiet (ms)"]
    uncertain = page_table(uncertainty.TABLE, uncertainty.TABLE.pages[0], [fast])
    assert {row[1] for row in uncertain.rows} == {"key", "hammer"}


def test_events_of_the_hammer_are_read_by_the_rules_of_every_session(fast) -> None:
    events = fast.events[fast.events["event"] == "string_impact"].set_index(["trial", "source"])["value"]
    for number in (5, 6, 7):
        assert abs(events[number, "trial"] - events[number, "model"]) < 0.003


def test_each_condition_of_an_imported_session_is_compared_on_its_own(tmp_path) -> None:
    side = validation.compare_many([some_strokes(tmp_path, 4, 6)], [SET, "hirschkorn2004-regulated"], **QUICK)
    assert [(r.session_name, len(r.traces)) for r in side.results] == [
        ("kawai_kg3c, slide-off", 1), ("kawai_kg3c, slide-off", 1), ("kawai_kg3c, fast", 1), ("kawai_kg3c, fast", 1),
    ]  # fmt: skip
    found, plain = (r.scores["rmse_rad"].iloc[0] for r in side.results[:2])
    assert found < 0.5 * plain


def test_one_command_takes_values_scene_tolerance_and_several_models(tmp_path, capsys, fewer_draws) -> None:
    session = some_strokes(tmp_path, 7)
    actions = ("--action", SET, "--action", f"{SET}: --set hammer.mass=0.02")
    assert run("validate", session, *actions, "--tolerance", "1e-4", "--out", tmp_path / "out", "--json") == 0
    said = json.loads(capsys.readouterr().out)
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert len(results["results"]) == 2 and "measured motion of the key" in said["verdict"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Causes of a difference are not looked for" in page and "<script" in page
    assert "force-one" not in page and "hammer-model" in page
    assert "hammer-all" not in page  # one trial says nothing of repeatability


def test_an_action_whose_sensors_are_elsewhere_is_refused_in_one_line(tmp_path) -> None:
    text = SET.read_text().replace("back of the key, where the damper rail lies", "front of the key")
    (tmp_path / "other.toml").write_text(text)
    with pytest.raises(validation.ValidationInputError, match="key sensor is 'back of the key.*holds for 'front of"):
        validation.compare(SHIPPED, tmp_path / "other.toml", condition="fast", **QUICK)


def test_a_damaged_table_of_sensors_is_refused_in_one_line(tmp_path) -> None:
    (tmp_path / "bad.toml").write_text(SET.read_text().replace('"key_zero"', '"key_sero"'))
    with pytest.raises(validation.ValidationInputError, match=r"\[identification.position_sensors\] found damaged"):
        validation.compare(SHIPPED, tmp_path / "bad.toml", condition="fast", **QUICK)


def test_a_second_import_of_fitted_samples_counts_as_fitted(tmp_path) -> None:
    posterior = posterior_of(model.load_action(SET))
    assert posterior is not None
    for number, fitted in ((5, True), (6, False)):
        data = Session.open(SHIPPED).trial(number).read()
        later = sample_fingerprints(replace(data, started_utc="2027-01-01T00:00:00Z"))
        assert posterior.was_fitted_to("another file", later) == fitted


def test_the_shipped_set_belongs_to_the_shipped_trials() -> None:
    posterior, session = posterior_of(model.load_action(SET)), Session.open(SHIPPED)
    assert posterior is not None
    assert set(posterior.trials.values()) == {session.trial(n).sha256 for n in (2, 3, 5, 7, 8)}


def test_the_option_that_is_gone_says_the_new_way(capsys) -> None:
    assert run("validate", SHIPPED, "--identified", SHIPPED) == 2
    assert "--identified is gone: an identified set is an action; give --action" in capsys.readouterr().err


def test_a_session_without_usable_strokes_is_named(tmp_path) -> None:
    session = tmp_path / "none"
    session.mkdir()
    for name in ("session.toml", "trial_0001.h5", "annotations.jsonl"):
        shutil.copy(SHIPPED / name, session / name)
    with pytest.raises(validation.ValidationInputError, match="no usable trial .*rejected: hammer moved by hand"):
        validation.compare(session, SET, **QUICK)
