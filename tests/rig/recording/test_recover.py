"""Sessions whose recording was cut off become sessions with trials that say so."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

from pianorig.cli import main
from rig import InputError, Session
from rig import recover as recover_session
from rig import resume as resume_session
from rig.recording.trial_plan import parse_plan
from tests.command_line import run
from tests.rig.fake_backend import FakeBackend


@pytest.fixture
def cut_off(tmp_path, rig, record_steps, undeleted_journal):
    """A session of two trials whose journals are still there: (folder, session as sealed)."""
    return tmp_path / "s", record_steps(rig, trials=2, open_journal=undeleted_journal)


def test_a_trial_killed_while_it_was_sealed_is_sealed_the_same(cut_off) -> None:
    folder, session = cut_off
    sha256 = session.trial(2).sha256
    session.trial_path(2).unlink()
    (folder / ".trial_0002.h5.4711.part").write_bytes(b"half")
    (_, second) = recover_session(folder)
    assert (second.trial, second.status) == (2, "complete")
    assert session.trial(2).sha256 == sha256
    assert sorted(p.name for p in folder.iterdir()) == [
        "profile.toml", "rig.toml", "session.toml", "trial_0001.h5", "trial_0002.h5",
    ]  # fmt: skip


def cut(folder, number: int, keep: float) -> None:
    path = folder / f"trial_{number:04d}.journal"
    path.write_bytes(path.read_bytes()[: int(keep * path.stat().st_size)])


def test_the_command_recovers_a_torn_journal_up_to_its_last_good_record(cut_off, capsys) -> None:
    folder, session = cut_off
    whole = session.trial(1).read()
    for number in (1, 2):
        session.trial_path(number).unlink()
    cut(folder, 1, 0.1)
    with pytest.raises(InputError, match="was cut off; run  pianorig recover"):
        Session.open(folder)
    with pytest.raises(SystemExit) as done:
        main(["recover", str(folder)])
    assert done.value.code == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("trial 1: incomplete, ") and second.startswith("trial 2: complete, ")
    data = Session.open(folder).trial(1).read()
    assert data.status == "incomplete" and f"up to sample {data.n_valid}" in data.reason
    assert 0 < data.n_valid < whole.n_valid and data.n_valid % 100 == 0
    np.testing.assert_array_equal(data.raw_force_n, whole.raw_force_n[: data.n_valid])
    np.testing.assert_array_equal(data.encoder_count, whole.encoder_count[: data.n_valid])
    assert data.camera.n_frames < whole.camera.n_frames
    with pytest.raises(SystemExit):
        main(["recover", str(folder)])
    assert "nothing to recover" in capsys.readouterr().out


def test_damage_in_the_middle_keeps_the_journal_and_says_so(cut_off) -> None:
    folder, session = cut_off
    session.trial_path(1).unlink()
    path = session.journal_path(1)
    data = bytearray(path.read_bytes())
    data[60_000] ^= 1
    path.write_bytes(data)
    first, _ = recover_session(folder)
    assert first.status == "incomplete" and "damage" in first.note and first.samples > 0
    assert path.with_name(path.name + ".damaged").read_bytes() == data
    assert recover_session(folder) == []


def test_a_journal_cut_off_before_its_first_block_was_whole_goes(cut_off) -> None:
    folder, session = cut_off
    for number in (1, 2):
        session.trial_path(number).unlink()
    session.journal_path(2).unlink()
    path = session.journal_path(1)
    whole = path.read_bytes()
    first_block = whole.index(b"PAJ1\3")
    for length in (1, 3, 4, 7, 20, 31, 100, first_block - 1, first_block + 4, first_block + 40):
        path.write_bytes(whole[:length] + bytes(300))  # space set aside for what was to come is zero
        assert [entry.status for entry in recover_session(folder)] == ["empty"], length
        assert not path.exists()
    path.write_bytes(b"PAK1" + whole[4:900])  # not what the recorder writes
    assert [entry.status for entry in recover_session(folder)] == ["unreadable"]
    assert path.exists()


def test_a_session_that_is_being_recorded_is_left_alone(tmp_path, rig, record_steps) -> None:
    refused = []

    def meddle(progress) -> None:
        if progress.time_s == pytest.approx(0.2):
            with pytest.raises(InputError, match="another program is recording") as refusal:
                recover_session(tmp_path / "s")
            refused.append(refusal)

    session = record_steps(rig, progress=meddle)
    assert len(refused) == 1 and session.trials[0].status == "complete" and not session.journals


def test_a_folder_that_is_no_session_and_a_journal_of_another_trial_are_refused(cut_off, tmp_path) -> None:
    with pytest.raises(InputError, match="no such session"):
        recover_session(tmp_path / "none")
    folder, session = cut_off
    session.trial_path(2).unlink()
    session.trial_path(1).unlink()
    session.journal_path(2).rename(session.journal_path(7))
    session.journal_path(1).rename(session.journal_path(8))
    with pytest.raises(InputError, match="holds trial 2, not 7.*holds trial 1, not 8"):
        recover_session(folder)
    session.journal_path(8).rename(session.journal_path(1))
    with pytest.raises(InputError, match="holds trial 2, not 7"):
        recover_session(folder)
    assert [trial.status for trial in session.trials] == ["complete"]  # the other one is recovered all the same


def test_a_sealed_file_that_was_damaged_is_made_again_from_its_journal(cut_off, recover) -> None:
    folder, session = cut_off
    seals = [trial.sha256 for trial in session.trials]
    damaged = bytearray(session.trial_path(1).read_bytes())
    damaged[len(damaged) // 2] ^= 1
    for number in (1, 2):
        session.trial_path(number).chmod(0o644)
    session.trial_path(1).write_bytes(damaged)
    session.trial_path(2).write_bytes(session.trial_path(2).read_bytes()[:3000])
    first, second = recover(folder)
    assert (first["status"], second["status"]) == ("complete", "complete")
    assert "the sealed file was damaged and is kept as trial_0001.h5.damaged" in first["note"]
    assert [trial.sha256 for trial in session.trials] == seals
    assert (folder / "trial_0001.h5.damaged").read_bytes() == damaged


def test_a_session_in_which_everything_went_wrong_is_recovered_at_once(
    tmp_path, rig, step_profile, record_steps, undeleted_journal, recover
) -> None:
    plan = parse_plan(
        'schema = "piano-action-rig plan 1"\nname = "p"\nwarm_up = 2\n[[conditions]]\nname = "a"\n'
        'profile = "forte"\nrepeats = 3\n'
    )
    plan = replace(plan, entries=tuple(replace(entry, profile=step_profile) for entry in plan.entries))
    folder, session = tmp_path / "s", record_steps(rig, plan=plan, open_journal=undeleted_journal)
    said = folder / "annotations.jsonl"
    said.write_text(said.read_text().splitlines(keepends=True)[0])  # killed within the second warm-up blow
    whole = [trial.read() for trial in session.trials]
    session.trial_path(2).unlink()
    cut(folder, 2, 0.15)  # torn in a warm-up blow
    for number in (3, 4):
        session.trial_path(number).chmod(0o644)
    session.trial_path(3).write_bytes(b"")
    session.trial_path(4).write_bytes(session.trial_path(4).read_bytes()[:-200])
    cut(folder, 4, 0.1)
    session.trial_path(5).unlink()
    session.journal_path(5).write_bytes(bytes(9000))
    found = recover(folder)
    statuses = ["complete", "incomplete", "complete", "incomplete", "empty"]
    assert [entry["status"] for entry in found] == statuses
    trials = session.trials
    assert [(trial.number, trial.status) for trial in trials] == list(zip((1, 2, 3, 4), statuses, strict=False))
    assert [trial.rejected for trial in trials] == ["warm-up blow of the plan"] * 2 + [None] * 2
    for trial, wanted in zip(trials, whole, strict=False):
        data = trial.read()
        assert data.n_valid > 0
        np.testing.assert_array_equal(data.encoder_count, wanted.encoder_count[: data.n_valid])


def test_the_command_recovers_into_another_folder_and_leaves_the_first_as_it_is(cut_off, tmp_path, capsys) -> None:
    folder, session = cut_off
    whole = session.trial(2).read()
    session.trial_path(2).unlink()
    session.annotate(1, "reject", "slipped", author="ana")
    cut(folder, 2, 0.1)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    folder.chmod(0o500)
    try:
        assert run("recover", folder, "--out", tmp_path / "rescued") == 0
    finally:
        folder.chmod(0o700)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
    rescued = Session.open(tmp_path / "rescued")
    assert [(t.number, t.status, t.rejected) for t in rescued.trials] == [
        (1, "complete", "slipped"),
        (2, "incomplete", None),
    ]
    assert rescued.trial(1).sha256 == session.trial(1).sha256 and not rescued.journals
    again = rescued.trial(2).read()
    np.testing.assert_array_equal(again.raw_force_n, whole.raw_force_n[: again.n_valid])
    assert again.provenance == whole.provenance and "the journal stays" in capsys.readouterr().out
    assert run("recover", folder, "--out", tmp_path / "rescued") == 2
    assert "not an empty folder" in capsys.readouterr().err


def test_a_damaged_trial_is_recorded_again_and_one_open_elsewhere_holds_up_the_rest(rig, record_steps) -> None:
    session = record_steps(rig, trials=2)
    first = session.trial_path(1)
    first.chmod(0o644)
    with h5py.File(first, "r+", locking=True), pytest.raises(InputError, match="has it open for writing; close it"):
        resume_session(session.path, FakeBackend())
    assert [trial.number for trial in session.trials] == [1, 2]
    with pytest.raises(InputError, match="nothing to resume"):
        resume_session(session.path, FakeBackend())
    damaged = bytearray(first.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    first.write_bytes(damaged)
    resumed = resume_session(session.path, FakeBackend())
    assert [(trial.number, trial.status) for trial in resumed.trials] == [
        (1, "unreadable"), (2, "complete"), (3, "complete"),
    ]  # fmt: skip
    assert first.read_bytes() == damaged
