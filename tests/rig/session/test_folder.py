"""Session folders: created whole or not at all, annotated by adding, results kept with their parents."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from rig import InputError, Session, SessionInfo
from rig.session.info import FileInfo
from tests.rig.session.test_sealed_trial import trial

INFO = SessionInfo(simulated=True, rig=FileInfo(name="virtual"), profile=FileInfo(name="forte"))


def test_an_annotation_goes_on_its_own_line_below_one_that_was_not_ended(session) -> None:
    session.annotate(1, "note", "fine")
    file = session.path / "annotations.jsonl"
    file.write_text(file.read_text().rstrip("\n"))
    session.annotate(2, "reject", "a knock")
    assert [(a.trial, a.reason) for a in session.annotations] == [(1, "fine"), (2, "a knock")]


@pytest.fixture
def session(tmp_path) -> Session:
    made = Session.create(tmp_path / "s", INFO, {"rig.toml": "a = 1\n"})
    for number in (1, 2):
        made.add_trial(trial(10 * number, number=number))
    return made


def test_a_session_opens_with_its_trials_in_order(session) -> None:
    opened = Session.open(session.path)
    assert [t.number for t in opened.trials] == [1, 2]
    assert [t.read().n_valid for t in opened.trials] == [10, 20]
    assert opened.info == INFO
    assert (session.path / "rig.toml").read_text() == "a = 1\n"
    with pytest.raises(InputError, match=r"no trial 7; there are \[1, 2\]"):
        opened.trial(7)


def test_folders_that_are_no_session_or_have_no_trials_are_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="no such session folder"):
        Session.open(tmp_path / "nothing")
    with pytest.raises(InputError, match="session.toml is missing"):
        Session.open(tmp_path)
    Session.create(tmp_path / "empty", INFO)
    with pytest.raises(InputError, match="has no trials"):
        Session.open(tmp_path / "empty")
    assert Session.open(tmp_path / "empty", require_trials=False).trials == ()


def test_a_rejected_trial_is_kept_with_its_reason_and_can_be_accepted_again(session) -> None:
    session.annotate(2, "reject", "the key stuck", author="ana")
    session.annotate(0, "note", "window open")
    assert [t.rejected for t in session.trials] == [None, "the key stuck"]
    assert session.trials[1].read().n_valid == 20
    session.annotate(2, "accept", "looked again")
    assert [t.rejected for t in session.trials] == [None, None]
    assert [(a.trial, a.kind, a.author) for a in session.annotations] == [
        (2, "reject", "ana"),
        (0, "note", "unknown"),
        (2, "accept", "unknown"),
    ]
    lines = (session.path / "annotations.jsonl").read_text().splitlines()
    assert len(lines) == 3 and json.loads(lines[0])["reason"] == "the key stuck"


@pytest.mark.parametrize(
    "line", ["{", "[]", '"x"', '{"trial": 1}', '{"trial":1,"kind":"?","reason":"","author":"","time_utc":""}']
)
def test_a_damaged_annotation_is_refused_with_its_line_number(session, line) -> None:
    session.annotate(1, "note", "fine")
    with (session.path / "annotations.jsonl").open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InputError, match=r"annotations.jsonl:2: "):
        session.trials  # noqa: B018


def test_tables_for_notebooks_say_what_the_files_hold(session) -> None:
    session.annotate(2, "reject", "the key stuck")
    summary = session.to_frame()
    assert list(summary.trial) == [1, 2] and list(summary.rejected) == ["", "the key stuck"]
    assert list(summary.duration_s) == [0.002, 0.004] and summary.peak_force_n.isna().all()  # no rest before a blow
    table = session.trial(2).read().to_frame()
    bodies = [f"{body}_{what}" for body in ("key", "whippen", "hammer") for what in ("count", "rad")]
    assert list(table.columns) == ["time_s", "force_n", "raw_force_n", "force_raw", "motor_command_v", *bodies]
    assert table.raw_force_n[3] == 1.5 and len(table) == 20


def test_derived_tables_come_back_with_attributes_and_parents(session) -> None:
    table = pd.DataFrame(
        {
            "time_s": [0.0, 0.5],
            "jack_rad": [0.1, float("nan")],
            "frame": [3, 4],
            "jack_flag": [True, False],
            "word": ["a", "é"],
        }
    )
    assert session.read_derived("tracking", 1) is None
    given = {"rms": np.float64(0.25), "bodies": ["jack"], "n": np.int64(3), "row": np.arange(2), "film": Path("a/b")}
    path = session.write_derived("tracking", 1, table, given)
    found, attrs = session.read_derived("tracking", 1)
    pd.testing.assert_frame_equal(found, table)
    plain = {"rms": 0.25, "bodies": ["jack"], "n": 3, "row": [0, 1], "film": "a/b"}
    assert attrs == {**plain, "parents_sha256": {"trial_0001.h5": session.trial(1).sha256}}
    with xr.open_dataset(path, engine="h5netcdf", group="table") as data:
        assert data.jack_rad.dims == ("row",)
    session.write_derived("tracking", 1, table.iloc[:1], {}, {"film": "0" * 64})
    found, attrs = session.read_derived("tracking", 1)
    assert len(found) == 1 and attrs["parents_sha256"] == {"film": "0" * 64}


def test_a_bad_step_name_or_column_is_refused_and_a_damaged_table_too(session) -> None:
    table = pd.DataFrame({"a": [1.0]})
    for step in ("../x", "", "a/b", "."):
        with pytest.raises(InputError, match="derived step"):
            session.write_derived(step, 1, table)
    with pytest.raises(InputError, match="attribute .* is a set"):
        session.write_derived("s", 1, table, {"a": {1}})
    with pytest.raises(InputError, match="column names"):
        session.write_derived("s", 1, pd.DataFrame([[1, 2]], columns=["a", "a"]))
    path = session.write_derived("s", 1, table)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(InputError, match="has no seal"):
        session.read_derived("s", 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "schema is missing|simulated is missing"),
        ("simulated = 3\n", "simulated"),
        ("simulated = 'yes'\n", "simulated"),
        ("= 1", "not a TOML file"),
    ],
)
def test_a_damaged_session_toml_is_refused(tmp_path, text, said) -> None:
    (tmp_path / "session.toml").write_text(text)
    with pytest.raises(InputError, match=said):
        Session.open(tmp_path)
