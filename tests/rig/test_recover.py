"""Sessions whose recording was cut off become sessions with trials that say so."""

from __future__ import annotations

import numpy as np
import pytest

from pianorig.cli import main
from rig.errors import InputError, RecordingFault
from rig.recorder import record_session
from rig.recover import recover_session
from rig.session import Session
from rig.session.journal import JournalWriter


class Kept(JournalWriter):
    """A journal that stays, as when the program is killed while it seals the trial."""

    def remove(self) -> None:
        pass


@pytest.fixture
def cut_off(tmp_path, make_backend, rig, step_profile):
    """A session of two trials whose journals are still there: (folder, session as sealed)."""
    backend = make_backend(rig.config, noise_n=0.02)
    session = record_session(
        tmp_path / "s", profile=step_profile, rig_config=rig, backend=backend, trials=2, open_journal=Kept
    )
    return tmp_path / "s", session


def test_trials_that_were_sealed_only_lose_their_journals(cut_off) -> None:
    folder, session = cut_off
    before = [trial.sha256 for trial in session.trials]
    assert [entry.status for entry in recover_session(folder)] == ["complete", "complete"]
    assert [trial.sha256 for trial in session.trials] == before and not session.journals


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
    np.testing.assert_array_equal(data.force_n, whole.force_n[: data.n_valid])
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


def test_a_journal_without_samples_goes_and_one_that_begins_with_damage_stays(cut_off) -> None:
    folder, session = cut_off
    for number in (1, 2):
        session.trial_path(number).unlink()
    session.journal_path(1).write_bytes(bytes(5000))
    session.journal_path(2).write_bytes(b"\1" + session.journal_path(2).read_bytes()[1:])
    assert [entry.status for entry in recover_session(folder)] == ["empty", "unreadable"]
    assert list(session.journals) == [2] and session.trials == ()


def test_a_session_that_is_being_recorded_is_left_alone(tmp_path, make_backend, rig, step_profile) -> None:
    backend = make_backend(rig.config)
    refused = []

    def meddle(progress) -> None:
        if progress.time_s == pytest.approx(0.2):
            with pytest.raises(InputError, match="another program is recording") as refusal:
                recover_session(tmp_path / "s")
            refused.append(refusal)

    session = record_session(
        tmp_path / "s", profile=step_profile, rig_config=rig, backend=backend, trials=1, progress=meddle
    )
    assert len(refused) == 1 and session.trials[0].status == "complete" and not session.journals


def test_a_folder_that_is_no_session_and_a_journal_of_another_trial_are_refused(cut_off, tmp_path) -> None:
    with pytest.raises(InputError, match="no such session"):
        recover_session(tmp_path / "none")
    folder, session = cut_off
    session.trial_path(2).unlink()
    session.journal_path(2).rename(session.journal_path(7))
    with pytest.raises(InputError, match="holds trial 2, not 7"):
        recover_session(folder)


def test_a_disk_that_fills_up_stops_the_motor_and_keeps_what_was_committed(
    tmp_path, make_backend, rig, step_profile, assert_safe
) -> None:
    backend = make_backend(rig.config, noise_n=0.02)

    def open_journal(path, head, *room) -> JournalWriter:
        written = 0

        def write(file: int, data) -> int:
            nonlocal written
            written += len(data)
            if written > 90_000:
                raise OSError(28, "No space left on device")
            return os_write(file, data)

        return JournalWriter(path, head, *room, write=write)

    from os import write as os_write

    with pytest.raises(RecordingFault, match="No space left"):
        record_session(
            tmp_path / "s", profile=step_profile, rig_config=rig, backend=backend, trials=2, open_journal=open_journal
        )
    assert_safe(backend)
    (trial,) = Session.open(tmp_path / "s").trials
    data = trial.read()
    assert trial.status == "fault" and "No space left" in data.reason and data.n_valid >= 1000
