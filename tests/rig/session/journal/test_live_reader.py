"""A second reader of a journal that grows: it sees whole blocks only, at any moment, and leaves the file alone."""

from __future__ import annotations

import os

import numpy as np
import pytest

from rig.recording.recorder import record_session
from rig.session.journal.live_reader import JournalFollower, SessionFollower
from rig.storage.platform_calls import remove


def test_a_journal_cut_anywhere_shows_its_whole_blocks_and_goes_on(tmp_path, make_backend, rig, step_profile) -> None:
    snapshot = tmp_path / "snapshot"

    def copy(at) -> None:
        if at.time_s > 0.5 and not snapshot.exists():
            snapshot.write_bytes((tmp_path / "s" / "trial_0001.journal").read_bytes())

    session = record_session(
        tmp_path / "s", profile=step_profile, rig_config=rig, backend=make_backend(rig.config), trials=1, progress=copy
    )
    data = session.trials[0].read()
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
    np.testing.assert_array_equal(force, data.force_n[: force.size])


def test_a_session_is_seen_while_it_is_recorded(tmp_path, make_backend, rig, step_profile) -> None:
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

    session = record_session(
        tmp_path / "s", profile=step_profile, rig_config=rig, backend=make_backend(rig.config), trials=2, progress=view
    )
    assert {view.state for view in views} == {"recording"} and not any(view.finished for view in views)
    end = follower[0].poll()
    data = session.trials[1].read()
    assert end.finished and end.state == "complete" and (end.trial, end.sealed) == (2, 2)
    np.testing.assert_array_equal(end.force_n, data.force_n)
    np.testing.assert_array_equal(views[-1].angle_rad, data.angle_rad()[: views[-1].time_s.size])


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
