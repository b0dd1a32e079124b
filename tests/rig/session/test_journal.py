"""The journal: what is read is the beginning of what was written; disks that fail are in recording/test_fault_table.py.

A second reader of a journal that grows: it sees whole blocks only, at any moment, and leaves the file alone.
"""

from __future__ import annotations

import errno
import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rig import Block, EncoderInfo, ForceInfo, HardwareFault, InputError, RecordingFault
from rig.platform_calls import remove
from rig.session.journal_records import BLOCK, COMMAND, END, HEAD, encode, encode_block, scan, scan_journal
from rig.session.journal_writer import JournalWriter
from rig.session.live_view import JournalFollower, SessionFollower
from rig.session.trial_head import FrameClock, TrialHead
from tests.rig.fuzz.stored_cases import journal_in


def head(number: int = 3) -> TrialHead:
    scales = (("key", 327680, 1), ("whippen", 327684, 1), ("hammer", 163840, -1))
    return TrialHead(
        number=number,
        started_utc="2026-11-21T09:00:00+00:00",
        simulated=True,
        sample_rate_hz=5000.0,
        blow_start_s=0.36,
        command_v=np.array([0.0, 0.25, 0.0]),
        encoders=tuple(EncoderInfo(name, counts, sign, f"ctr {name}", 1e-5) for name, counts, sign in scales),
        force_info=ForceInfo("cell", "certificate 7", (0.0, 2.0), (0.0, 111.2), group_delay_s=0.008),
        frame_clock=FrameClock(2000.0, 1e-3, 1e-4, 1e-6),
    )


def blocks(n: int = 4, size: int = 5) -> list[Block]:
    made = []
    for i in range(n):
        at = np.arange(i * size, (i + 1) * size)
        made.append(Block(i * size, 0.1 + at, -1e-3 * at, at[:, None] * np.array([1, -2, 2**40])))
    return made


def journal_bytes(ending: bool = True) -> bytes:
    data = encode(HEAD, 0, 0, 0, json.dumps(head().to_plain()).encode())
    data += encode(COMMAND, 1, 0, 3, head().command_v.tobytes())
    for i, block in enumerate(blocks()):
        data += encode(BLOCK, 2 + i, block.first_sample, block.force_n.size, encode_block(block))
    return data + (encode(END, 6, 20, 0, b'{"status": "fault", "reason": "why"}') if ending else b"")


WHOLE = journal_bytes()


def assert_beginning(data: bytes) -> int:
    """What is read is the beginning of what was written; return the number of blocks."""
    journal, read = journal_in(data)
    for found, written in zip(read, blocks(), strict=False):
        assert found.first_sample == written.first_sample
        np.testing.assert_array_equal(found.force_n, written.force_n)
        np.testing.assert_array_equal(found.force_raw, written.force_raw)
        np.testing.assert_array_equal(found.encoder_count, written.encoder_count)
    assert journal.ending is None or (journal.ending == ("fault", "why") and len(read) == 4)
    if journal.head is not None:
        assert journal.head.to_plain() == head().to_plain()
        np.testing.assert_array_equal(journal.head.command_v, head().command_v)
    assert journal.n_samples == 5 * len(read) <= 20
    return len(read)


def test_what_is_written_is_read(tmp_path) -> None:
    path = tmp_path / "trial_0003.journal"
    writer = JournalWriter(path, head(), 1000, 10)
    assert path.stat().st_size > 40_000 or os.name == "nt"  # room was set aside
    assert [writer.append(block) for block in blocks()] == [5, 10, 15, 20]
    writer.close("complete", "")
    assert writer.synced_samples == 20
    journal, read = journal_in(path.read_bytes())
    assert assert_beginning(WHOLE) == 4 == len(read)
    assert journal.ending == ("complete", "") and journal.left_over == 0 and not journal.records_behind
    trial = journal.head.assemble(read, *journal.ending)
    np.testing.assert_array_equal(trial.encoder_count[:, 2], 2**40 * np.arange(20))
    np.testing.assert_array_equal(trial.motor_command_v[:4], [0, 0.25, 0, 0])


@given(st.integers(0, len(WHOLE)), st.integers(0, 200))
@example(1495, 2)
def test_a_journal_cut_off_anywhere_gives_all_whole_blocks(cut, zeros) -> None:
    size = len(encode(BLOCK, 0, 0, 5, encode_block(blocks()[0])))
    ends = [len(journal_bytes(ending=False)) - size * missing for missing in range(4)]
    data = WHOLE[:cut] + bytes(zeros)
    # zeros behind the cut may be the very bytes that were cut off: what counts is how far the file is as written
    pairs = zip(data, WHOLE, strict=False)
    intact = next((i for i, (found, written) in enumerate(pairs) if found != written), min(len(data), len(WHOLE)))
    assert assert_beginning(data) == sum(intact >= end for end in ends)


@given(st.lists(st.tuples(st.integers(0, len(WHOLE) - 1), st.integers(1, 255)), min_size=1, max_size=6))
def test_changed_bytes_never_give_other_values(changes) -> None:
    data = bytearray(WHOLE)
    for at, flip in changes:
        data[at] ^= flip
    assert_beginning(bytes(data))
    if bytes(data) != WHOLE:
        journal, _ = journal_in(bytes(data))
        assert journal.ending is None and journal.left_over > 0


@given(st.binary(max_size=300))
def test_anything_at_all_can_be_read(data) -> None:
    assert scan(io.BytesIO(data)).n_samples == scan(io.BytesIO(WHOLE[:4] + data)).n_samples == 0
    assert_beginning(WHOLE + data)


@pytest.mark.parametrize("payload", [b"[]", b"{}", b'{"number": 1}', b"\xff", b"1e999"])
def test_whole_records_with_another_content_are_not_a_trial(payload) -> None:
    for size in (7, 8):
        data = encode(HEAD, 0, 0, 0, payload) + encode(COMMAND, 1, 0, 0, bytes(size))
        assert scan(io.BytesIO(data)).head is None


def test_blocks_that_do_not_follow_each_other_are_refused(tmp_path) -> None:
    first, second, third, _ = blocks()
    with pytest.raises(HardwareFault, match="starts at sample 10, expected 5"):
        head().assemble([first, third], "complete", "")
    writer = JournalWriter(tmp_path / "j", head())
    writer.append(first)
    with pytest.raises(RecordingFault, match="starts at sample 10, expected 5"):
        writer.append(third)
    assert writer.append(second) == 10
    writer.close("fault", "hole")


class Disk:
    """A disk that can be made to take a few bytes at a time; a clock; a journal on it."""

    def __init__(self, path: Path) -> None:
        self.most = 10**9
        self.now_s = 0.0
        self.syncs = 0
        self.writer = JournalWriter(
            path, head(), write=self.write, synchronise=self.synchronise, now_s=lambda: self.now_s
        )

    def write(self, file: int, data: Any) -> int:
        return os.write(file, data[: self.most])

    def synchronise(self, file: int) -> None:
        self.syncs += 1


@pytest.fixture
def disk(tmp_path) -> Disk:
    return Disk(tmp_path / "j")


def test_a_disk_that_takes_a_few_bytes_at_a_time_gets_them_all(disk, tmp_path) -> None:
    disk.most = 7
    writer = disk.writer
    for block in blocks():
        writer.append(block)
    writer.close("complete", "")
    assert scan_journal(tmp_path / "j").n_samples == 20


def test_the_disk_is_synchronised_at_least_every_second_of_data(disk, tmp_path) -> None:
    writer = disk.writer
    before = disk.syncs
    for block in blocks(150):
        disk.now_s += 0.02
        writer.append(block)
    assert disk.syncs - before >= 3
    writer.close("complete", "")
    assert writer.synced_samples == 750


def test_no_room_for_the_trial_is_found_before_anything_moves(tmp_path, monkeypatch) -> None:
    def full(*arguments: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("rig.platform_calls.reserve", full)
    with pytest.raises(InputError, match="no room for a trial of .* MB"):
        JournalWriter(tmp_path / "j", head(), 10**6, 10**4)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="cannot be created"):
        JournalWriter(tmp_path / "missing" / "j", head())


def test_a_journal_cut_anywhere_shows_its_whole_blocks_and_goes_on(tmp_path, rig, record_steps) -> None:
    snapshot = tmp_path / "snapshot"

    def copy(at) -> None:
        if at.time_s > 0.5 and not snapshot.exists():
            snapshot.write_bytes((tmp_path / "s" / "trial_0001.journal").read_bytes())

    data = record_steps(rig, progress=copy).trials[0].read()
    whole, live = snapshot.read_bytes(), tmp_path / "live"
    follower = JournalFollower(live)
    assert not follower.poll()
    sizes = []
    for end in sorted({*np.random.default_rng(1).integers(0, len(whole), 60).tolist(), len(whole)}):
        live.write_bytes(whole[:end])
        assert follower.poll()
        sizes.append(sum(block.force_n.size for block in follower.blocks))
    assert sizes == sorted(sizes) and sizes[0] == 0 and sizes[-1] >= 2500 and len(set(sizes)) > 5
    force = np.concatenate([block.force_n for block in follower.blocks])
    np.testing.assert_array_equal(force, data.raw_force_n[: force.size])


def test_a_session_is_seen_while_it_is_recorded(tmp_path, rig, record_steps) -> None:
    views = []
    follower: list[SessionFollower] = []

    def view(at) -> None:
        follower[:] = follower or [SessionFollower(tmp_path / "s")]
        before = os.stat(tmp_path / "s" / f"trial_{at.trial:04d}.journal")
        view = follower[0].poll()
        after = os.stat(tmp_path / "s" / f"trial_{at.trial:04d}.journal")
        assert before.st_size == after.st_size
        assert view.trial == at.trial and view.time_s.size == round(at.committed_s * 5000)
        views.append(view)

    session = record_steps(rig, trials=2, progress=view)
    assert {view.state for view in views} == {"recording"} and not any(view.is_finished for view in views)
    end = follower[0].poll()
    data = session.trials[1].read()
    assert end.is_finished and end.state == "complete" and (end.trial, end.sealed) == (2, 2)
    np.testing.assert_array_equal(end.raw_force_n, data.raw_force_n)
    np.testing.assert_array_equal(views[-1].angle_rad, data.angle_rad[: views[-1].time_s.size])


def test_a_file_that_a_reader_holds_open_is_deleted_later_or_left() -> None:
    class Held:
        def __init__(self, times: int) -> None:
            self.times = times

        def unlink(self, missing_ok: bool) -> None:
            assert missing_ok
            self.times -= 1
            if self.times >= 0:
                raise PermissionError(32, "in use")

    waited: list[float] = []
    held = Held(3)
    remove(held, wait=waited.append)  # type: ignore[arg-type]
    assert held.times == -1 and waited == [0.01] * 3
    for_ever = Held(1000)
    remove(for_ever, wait=waited.append)  # type: ignore[arg-type]
    assert for_ever.times == 980 and sum(waited) == pytest.approx(0.22)
