"""An unchanged report is not made again; anything it depends on makes it anew."""

from __future__ import annotations

import json

import pytest

from validation.cache.content_hash import code_sha256
from validation.cache.report_cache import NAME, StoredReport, inputs_sha256, store_report, stored_report


@pytest.fixture
def session(tmp_path):
    folder = tmp_path / "session"
    (folder / "derived" / "angles").mkdir(parents=True)
    (folder / "derived" / "prediction").mkdir()
    for name, text in (
        ("session.toml", "a = 1"),
        ("trial_0001.h5", "trial"),
        ("trial_0001.avi", "film"),
        ("derived/angles/trial_0001.h5", "angles"),
        ("derived/prediction/trial_0001.h5", "prediction"),
    ):
        (folder / name).write_text(text)
    return folder


def stored(folder, inputs):
    for name in ("report.html", "tables/trials.csv"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(f"made from {inputs}")
    files = {name: folder / name for name in ("report.html", "tables/trials.csv")}
    store_report(folder, inputs, StoredReport(["first", "second"], ["printed"], files, "2026-11-21T12:00:00Z"))


def test_the_same_inputs_give_the_stored_report(session):
    inputs = inputs_sha256([session], ["hirschkorn2004"], {"tolerance": 1e-5})
    stored(session, inputs)
    again = inputs_sha256([session], ["hirschkorn2004"], {"tolerance": 1e-5})
    found = stored_report(session, again)
    assert found is not None
    assert found.verdict_lines == ["first", "second"]
    assert found.files["tables/trials.csv"].read_text() == f"made from {inputs}"


@pytest.mark.parametrize("name", ["session.toml", "trial_0001.h5", "derived/angles/trial_0001.h5", "annotations.jsonl"])
def test_a_changed_input_changes_the_hash(session, name):
    before = inputs_sha256([session], ["hirschkorn2004"], {})
    (session / name).write_text("changed")
    assert inputs_sha256([session], ["hirschkorn2004"], {}) != before


@pytest.mark.parametrize("name", ["trial_0001.avi", "derived/prediction/trial_0001.h5", "report.html"])
def test_what_is_no_input_changes_nothing(session, name):
    before = inputs_sha256([session], ["hirschkorn2004"], {})
    (session / name).write_text("changed")
    assert inputs_sha256([session], ["hirschkorn2004"], {}) == before


def test_options_and_the_action_s_own_file_count(session, tmp_path):
    action = tmp_path / "own.toml"
    action.write_text("x = 1")
    first = inputs_sha256([session], [str(action)], {"tolerance": 1e-5})
    assert inputs_sha256([session], [str(action)], {"tolerance": 1e-6}) != first
    action.write_text("x = 2")
    assert inputs_sha256([session], [str(action)], {"tolerance": 1e-5}) != first


def test_a_touched_or_damaged_report_is_made_again(session):
    stored(session, "abc")
    assert stored_report(session, "abc") is not None
    assert stored_report(session, "other") is None
    (session / "tables/trials.csv").write_text("by hand")
    assert stored_report(session, "abc") is None
    stored(session, "abc")
    (session / "report.html").unlink()
    assert stored_report(session, "abc") is None
    for text in ("", "[]", "{}", json.dumps({"schema": 1, "inputs_sha256": "abc", "files_sha256": 3})):
        (session / NAME).write_text(text)
        assert stored_report(session, "abc") is None


def test_every_source_file_counts_but_those_left_out(tmp_path, monkeypatch):
    home = tmp_path / "somewhere"
    (home / "report").mkdir(parents=True)
    for name in ("__init__.py", "scores.py", "values.toml", "report/page.j2", "report/a.schema.json", "notes.txt"):
        (home / name).write_text("1")
    monkeypatch.syspath_prepend(tmp_path)

    def found():
        code_sha256.cache_clear()
        return code_sha256("somewhere"), code_sha256("somewhere", "report")

    before = found()
    assert before[0] != before[1]
    for name, changes in (
        ("scores.py", (True, True)),
        ("values.toml", (True, True)),
        ("report/page.j2", (True, False)),
        ("report/a.schema.json", (True, False)),
        ("notes.txt", (False, False)),
    ):
        (home / name).write_text("2")
        now = found()
        assert (now[0] != before[0], now[1] != before[1]) == changes
        before = now
    monkeypatch.setattr("validation.cache.content_hash.LIBRARIES", ("numpy", "no such library"))
    assert all(a != b for a, b in zip(found(), before, strict=True))
    code_sha256.cache_clear()
