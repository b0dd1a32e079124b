"""One bad trial is left out by name, everything else goes on; what ``info`` refuses ``recover`` never calls well."""

from __future__ import annotations

import json
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import pytest

import rig
from pianorig.page.catalogue import read_row, session_detail
from tests.command_line import run
from tests.rig.fake_backend import FakeBackend

SHIPPED = Path(__file__).parents[3] / "sessions" / "example_forte"


def flip_bit(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[5000] ^= 1
    path.write_bytes(data)


def put_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def put_derived_table(path: Path) -> None:
    import pandas as pd

    from rig.session.derived_table import write_table

    write_table(path, pd.DataFrame({"a": [1.0]}), {}, {})


DAMAGES: dict[str, tuple[Callable[[Path], Any], str]] = {
    "bit": (flip_bit, "altered since it was sealed"),
    "cut": (lambda path: path.write_bytes(path.read_bytes()[:9000]), "not what was sealed"),
    "text": (lambda path: path.write_text("no HDF5"), "not what was sealed"),
    "other kind": (put_derived_table, "schema"),
    "folder": (put_folder, "cannot be read"),
}


def run_with_warnings(*arguments: str | Path) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        return run(*arguments)


def open_and_close(path: Path) -> None:
    path.chmod(0o644)
    with h5py.File(path, "a"):
        pass


@pytest.fixture
def session(tmp_path: Path) -> Path:
    folder = tmp_path / "s"
    shutil.copytree(SHIPPED, folder, ignore=shutil.ignore_patterns("derived", "report*", "results*"))
    for path in folder.iterdir():
        path.chmod(0o644)
    return folder


@pytest.mark.parametrize("what", DAMAGES)
def test_info_recover_and_the_page_go_by_one_list(session: Path, capsys: pytest.CaptureFixture[str], what: str) -> None:
    damage, words = DAMAGES[what]
    open_and_close(session / "trial_0001.h5")
    damage(session / "trial_0002.h5")
    assert run_with_warnings("info", session, "--json") == 0
    out, err = capsys.readouterr()
    assert err.count("\n") == 1 and "took its seal off" in err
    rows = json.loads(out)["trials"]
    assert [row["status"] for row in rows] == ["complete", "unreadable", "complete"]
    assert words in rows[1]["problem"] and "trial_0002.h5" in rows[1]["problem"]
    assert rows[0]["samples"] == 6300
    detail = session_detail(session)["trials"]
    assert [row["status"] for row in detail] == ["complete", "unreadable", "complete"]
    assert read_row(session).status == "2 complete, 1 unreadable"
    assert run("recover", session, "--json") == 0
    first, second = json.loads(capsys.readouterr().out)["trials"]
    assert (first["trial"], first["status"], first["samples"]) == (1, "complete", 6300)
    assert "it was sealed again" in first["note"]
    assert (second["trial"], second["status"]) == (2, "unreadable") and second["note"] == rows[1]["problem"]
    assert (session / "trial_0001.h5").read_bytes() == (SHIPPED / "trial_0001.h5").read_bytes()
    assert run("recover", session) == 0
    out, err = capsys.readouterr()
    assert "every trial is sealed" not in out and "trial 2: unreadable" in out and not err


def test_recover_copies_what_lost_its_seal_and_names_what_is_damaged(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    open_and_close(session / "trial_0001.h5")
    flip_bit(session / "trial_0002.h5")
    before = {path.name: path.read_bytes() for path in session.iterdir()}
    assert run("recover", session, "--out", tmp_path / "copy") == 0
    out, err = capsys.readouterr()
    assert not err and "trial 2: unreadable" in out and "copied as trial_0002.h5.damaged" in out
    assert {path.name: path.read_bytes() for path in session.iterdir()} == before
    for number in (1, 3):
        name = f"trial_000{number}.h5"
        assert (tmp_path / "copy" / name).read_bytes() == (SHIPPED / name).read_bytes()
    assert (tmp_path / "copy" / "trial_0002.h5.damaged").read_bytes() == before["trial_0002.h5"]


def test_other_commands_leave_a_bad_trial_out_by_name(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., None]
) -> None:
    flip_bit(session / "trial_0001.h5")
    assert run_with_warnings("export", session, "--to", "csv", "--out", tmp_path / "csv") == 0
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "trial 1 is left out" in err and "altered since" in err
    assert sorted(path.name for path in (tmp_path / "csv").glob("*.csv")) == ["trial_0002.csv", "trial_0003.csv"]
    refused("altered since it was sealed", "export", session, "--to", "csv", "--trial", "1", "--out", tmp_path / "csv")
    assert run("watch", session, "--json") == 0
    assert json.loads(capsys.readouterr().out)["trial"] == 3
    assert run("annotate", session, "--trial", "1", "--reject", "damaged on the disk") == 0
    capsys.readouterr()
    table = rig.Session.open(session).to_frame()
    assert list(table["status"]) == ["unreadable", "complete", "complete"]
    assert table["peak_force_n"].isna().tolist() == [True, False, False]


@pytest.mark.parametrize("holds", [False, True], ids=["opens and closes", "keeps open"])
def test_a_recording_loses_nothing_while_another_program_opens_its_trials(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], holds: bool
) -> None:
    """A program that opens each trial for writing as soon as it is sealed."""
    opened: list[h5py.File] = []

    def before_trial(number: int) -> None:
        if number > 1:
            path = tmp_path / "s" / f"trial_{number - 1:04d}.h5"
            path.chmod(0o644)
            opened.append(h5py.File(path, "r+", locking=True))
            if not holds:
                opened.pop().close()

    session = rig.record(
        tmp_path / "s", profile="piano", trials=3, before_trial=before_trial, backend=FakeBackend(noise_n=0.02)
    )
    for file in opened:
        file.close()
    with pytest.warns(UserWarning, match="took its seal off"):
        assert [trial.status for trial in session.trials] == ["complete"] * 3
    assert [one.trial for one in rig.recover(tmp_path / "s")] == [1, 2] and rig.recover(tmp_path / "s") == []
