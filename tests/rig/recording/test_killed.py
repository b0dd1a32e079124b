"""A recording killed outright at random moments: nothing that was acknowledged is lost, every session opens."""

from __future__ import annotations

import contextlib
import os
import queue
import random
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rig import Session, load_profile
from rig import recover as recover_session
from tests.rig.program import DEADLINE_S, Program

HERE = Path(__file__).parents[1]


class Killed(Program):
    """The program to be killed."""

    def record_and_kill(self, folder: Path, after_s: float, step: str = "") -> list[tuple[int, int, int]]:
        """Kill the recording ``after_s`` after its first block; return what it had acknowledged by then.

        With a step of recording_to_kill.STEPS it kills itself there.
        """
        self.said.write(f"{folder}\t{step}\n")
        self.said.flush()
        pid, seen, kill_at = 0, [], time.monotonic() + DEADLINE_S
        while True:
            left = kill_at - time.monotonic()
            try:
                words = self.lines.get(timeout=max(left, 0)).split()
            except queue.Empty:
                with contextlib.suppress(ProcessLookupError):  # it has just ended by itself
                    os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))
                kill_at = time.monotonic() + DEADLINE_S
                continue
            if words[0] == "end":
                return seen
            if words[0] == "pid":
                pid = int(words[1])
            else:
                if not seen:
                    kill_at = time.monotonic() + after_s
                seen.append(tuple(map(int, words[1:])))


@pytest.fixture
def program() -> Iterator[Killed]:
    running = Killed("-W", "error", str(HERE / "recording_to_kill.py"), cwd=HERE.parents[1])
    yield running
    running.end(None)


@pytest.fixture
def whole(rig, record_steps) -> Session:
    """The same session when nobody kills it."""
    return record_steps(rig, "whole", profile=load_profile(HERE / "step.toml"), trials=3)


def check(folder: Path, seen: list[tuple[int, int, int]], whole: Session) -> str:
    """Compare a recovered session with what was acknowledged and with the whole one."""
    recover_session(folder)
    session = Session.open(folder, require_trials=False)
    assert not session.journals and not list(folder.glob(".*")) and recover_session(folder) == []
    stored = {}
    for trial, wanted in zip(session.trials, whole.trials, strict=False):
        data, reference = trial.read(), wanted.read()
        stored[trial.number] = n = data.n_valid
        np.testing.assert_array_equal(data.time_s, np.arange(n) / 5000)
        for name in ("raw_force_n", "force_raw", "motor_command_v", "encoder_count"):
            np.testing.assert_array_equal(getattr(data, name), getattr(reference, name)[:n])
        assert data.encoders == reference.encoders and data.force_info == reference.force_info
        assert trial.status == "incomplete" or n == reference.n_valid
        assert trial.status in ("complete", "incomplete")
    assert list(stored) == list(range(1, len(stored) + 1))
    assert all(stored.get(trial_number, 0) >= committed for trial_number, _, committed in seen)
    return session.trials[-1].status if stored else "nothing was committed"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork to be quick")
def test_a_recording_killed_at_each_step_of_sealing_a_trial_loses_nothing(program, tmp_path, whole) -> None:
    for step, status in {
        "before the closing record": "incomplete",
        "half the sealed file": "complete",
        "before it is on the disk": "complete",
        "before it has its name": "complete",
        "before the journal goes": "complete",
    }.items():
        folder = tmp_path / step.replace(" ", "_")
        seen = program.record_and_kill(folder, DEADLINE_S, step)
        assert max(trial for trial, *_ in seen) == 2 and (folder / "trial_0002.journal").exists()
        assert (folder / "trial_0002.h5").exists() == (step == "before the journal goes")
        assert check(folder, seen, whole) == status
        assert [trial.number for trial in Session.open(folder).trials] == [1, 2]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork to be quick")
def test_recordings_killed_at_random_moments_lose_nothing_acknowledged(program, tmp_path, whole) -> None:
    chance = random.Random(5)
    for turn in range(4):
        check(target := tmp_path / str(turn), program.record_and_kill(target, chance.uniform(0, 0.3)), whole)


@pytest.mark.skipif(hasattr(os, "fork"), reason="covered by the tests above")
def test_a_recording_killed_loses_nothing_acknowledged(program, tmp_path, whole) -> None:
    assert check(tmp_path / "s", program.record_and_kill(tmp_path / "s", 0.05), whole) == "incomplete"
