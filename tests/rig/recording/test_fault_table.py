"""Every fault of the table in docs/safety.md but the death of the program, planted by time and by call.

Each row shows: motor at 0 V and drive disabled within the stated time on the bench's clock, the fault latched with its
reason in the file, every committed sample readable, and a valid session marked incomplete when the program dies in
that moment. The rows in which the program dies are in simulated/test_process_death.py.

Faults and Ctrl-C at any call of a session, alone and several at once: configure, arm, blow, stop, the next trial.

Whatever happens when: half a second later the motor is at 0 V and the drive disabled, what was committed is readable,
a fault that ended a trial is named in it, and recovery leaves nothing to recover.
"""

from __future__ import annotations

import contextlib
import gc
import os
import random
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig import HardwareFault, Profile, RecordingFault, Session, parse_profile
from rig import record as record_session
from rig import recover as recover_session
from rig.session.journal_writer import JournalWriter
from rig.simulated import SimulatedBackend
from rig.simulated.device.faults import parse_faults
from rig.simulated.device.state import FaultPlan
from rig.simulated.device.watchdog import check_watchdogs
from rig.simulated.driver import reset_device
from rig.simulated.status import DaqStatusError, ServerGone

COUNTED = (('mode = "pulses"', 'mode = "counted"'), ('terminal = "/cDAQ1Mod4/PFI4"', 'terminal = "/cDAQ1Mod4/PFI0"'))
FULL_BLOCK = 20
"""The motor pushes from 0.36 s, within block 18, to 0.43 s; before block 20 the bench is at 0.38 s."""
PUSHING_S = 0.38
RISING_S, RISING_BLOCK = 0.36, 19


@dataclass(frozen=True)
class Row:
    """How a fault is planted by time and by call (behind the blocks and questions of trial 1), and what it says."""

    words: str
    by_time: str
    by_call: str
    at_s: float = PUSHING_S


ROWS = {
    "overwrite -200279": Row("-200279", "overwrite@2/0.38", "overwrite@ReadAnalogF64#{block}"),
    "timeout -200284": Row("-200284", "timeout@2/0.38", "timeout@ReadAnalogF64#{block}"),
    "AO underrun -200290": Row("-200290", "underrun@2/0.38", "underrun@IsTaskDone#{asked}"),
    "reserved -50103": Row("-50103", "reserved@2/0.38", "reserved@ReadCounterF64Ex#{counter}"),
    "device lost": Row("cannot be reached", "device-lost@2/0.38", "device-lost@ReadAnalogF64#{block}"),
    "server gone": Row("does not answer", "server-gone@2/0.38", "server-gone@ReadAnalogF64#{block}"),
    "bridge open": Row("open bridge", "bridge-open@2/0.38", "bridge-open@ReadAnalogF64#{block}"),
    "saturated cell": Row("saturated or stuck", "saturated@2/0.38", "saturated@ReadAnalogF64#{block}"),
    "force missing": Row("told to push", "silent@2/0.38", "silent@ReadAnalogF64#{block}"),
    "stuck channel": Row(
        "whippen encoder does not move", "stuck:whippen@2/0.36", "stuck:whippen@ReadAnalogF64#{rising}", RISING_S
    ),
    "encoder miscount": Row("hammer encoder rests", "miscount:hammer@2/0.38", "miscount:hammer@ReadAnalogF64#{block}"),
    "dropped frames": Row("drops frames", "dropped@2/0.38", "dropped@ReadAnalogF64#{block}"),
}
COUNTED_CALLS = ("overwrite -200279", "AO underrun -200290", "reserved -50103", "stuck channel")
IN_TEST = ("slow disk", "full disk", "crash of the writer")
IN_ANOTHER_PROCESS = ("SIGINT", "SIGTERM", "kill -9")


def test_every_fault_of_the_safety_page_has_its_row(stated_s) -> None:
    assert set(stated_s) == {*ROWS, *IN_TEST, *IN_ANOTHER_PROCESS}


class Watched:
    """A recording of trials on a bench that is watched from outside: what was committed, when a trial began."""

    def __init__(
        self, backend: SimulatedBackend, rig: Any, profile: Profile, folder: Path, journal: type[JournalWriter]
    ) -> None:
        self.backend, self.device, self.folder = backend, backend.device, folder
        self.began_s: dict[int, float] = {}
        self.committed: dict[int, int] = {}
        self.live = False
        self._rig, self._profile, self.journal = rig, profile, journal
        begin = self.device.bench.begin

        def begun(trial: int, *arguments: Any, **options: Any) -> None:
            begin(trial, *arguments, **options)
            self.began_s[trial] = self.device.bench.clock.now_s

        self.device.bench.begin = begun

    def progress(self, state: Any) -> None:
        self.committed[state.trial] = round(state.committed_s * 5000)
        self.live = self.live or not self.safe()

    def safe(self) -> bool:
        return self.device.output_v["cDAQ1Mod2/ao0"] == 0.0 and not self.device.drive_enabled()

    def record(self, *, trials: int, open_journal: Any = None, progress: Callable[..., None] | None = None) -> None:
        record_session(
            self.folder, profile=self._profile, rig_config=self._rig, backend=self.backend, trials=trials,
            progress=progress or self.progress, open_journal=open_journal or self.journal,
        )  # fmt: skip

    def safe_after_s(self, trial: int, at_s: float) -> float:
        """Return when both outputs were safe, after ``at_s`` of a trial; what the program left is the watchdog's."""
        clock = self.device.bench.clock
        for _ in range(200):
            if self.safe():
                return clock.now_s - self.began_s[trial] - at_s
            clock.advance(0.01)
            check_watchdogs(self.device)
        raise AssertionError("never safe")


@pytest.fixture
def watched(edited_rig, make_backend, step_profile, tmp_path, undeleted_journal) -> Callable[..., Watched]:
    rig = edited_rig(*COUNTED)

    def make(faults: str = "", profile: Profile = step_profile, folder: str = "s") -> Watched:
        backend = make_backend(rig.config, noise_n=0.02)
        backend.device.faults = FaultPlan(parse_faults(faults))
        return Watched(backend, rig, profile, tmp_path / folder, undeleted_journal)

    return make


@pytest.fixture(scope="module")
def blocks(tmp_path_factory) -> list[int]:
    """Blocks of trial 1, and how often it asked whether the command has ended; found once."""
    return []


@pytest.mark.parametrize(
    ("fault", "planted"),
    [*((fault, "by time") for fault in ROWS), *((fault, "by call") for fault in COUNTED_CALLS)],
)
def test_the_bench_is_safe_in_time_and_nothing_committed_is_lost(
    fault, planted, watched, blocks, stated_s, died_then, recover
) -> None:
    row = ROWS[fault]
    if planted == "by call" and not blocks:
        clean = watched(folder="clean")
        clean.record(trials=1)
        blocks += clean.committed[1] // 100, clean.backend.service.trace.count("IsTaskDone")
    how = row.by_time
    if planted == "by call":
        block = blocks[0] + FULL_BLOCK
        how = row.by_call.format(
            block=block, rising=blocks[0] + RISING_BLOCK, counter=4 * block - 3, asked=blocks[1] + FULL_BLOCK
        )
    run = watched(how)
    with pytest.raises(HardwareFault) as raised:
        run.record(trials=3)
    assert raised.value.exit_code == 3 and "\n" not in str(raised.value)
    assert run.live and 0 <= run.safe_after_s(2, row.at_s) <= stated_s[fault]
    session = Session.open(run.folder)
    assert [trial.status for trial in session.trials] == ["complete", "fault"]  # latched: no third trial
    data = session.trial(2).read()
    assert row.words in data.reason and data.n_valid >= run.committed[2] > 0
    run.device.faults = FaultPlan()
    if fault in ("device lost", "server gone"):
        reset_device(run.device)  # as a lab does: what the program had reserved is still held
    (_, entry) = recover(died := died_then(run.folder, 2))
    again = Session.open(died).trial(2).read()
    assert entry["status"] == again.status == "incomplete"
    np.testing.assert_array_equal(again.raw_force_n, data.raw_force_n)
    np.testing.assert_array_equal(again.encoder_count, data.encoder_count)


@pytest.mark.parametrize("call", ["TaskControl#15", "StartTask#8", "CfgSampClkTiming#7"])
def test_a_trial_that_cannot_begin_leaves_its_reason_in_the_session_and_the_motor_still(watched, call) -> None:
    run = watched(f"reserved@{call}")
    with pytest.raises(HardwareFault, match="-50103"):
        run.record(trials=3)
    assert run.safe()
    session = Session.open(run.folder)
    assert [trial.status for trial in session.trials] == ["complete"]
    (note,) = session.annotations
    assert note.trial == 0 and note.reason.startswith("trial 2 did not begin: ResourceBusy") and "-50103" in note.reason


HELD = parse_profile(
    'name = "held"\npoints = [{time_s=0,force_n=0},{time_s=0.1,force_n=3},{time_s=6,force_n=3},{time_s=6.1,force_n=0}]'
)
"""Longer than a disk may hang."""


def breaking(run: Watched, how: str, at_s: float, released: threading.Event) -> Callable[..., JournalWriter]:
    """Return what opens a journal on a disk that goes bad ``at_s`` after the first trial began."""

    def write(file: int, data: Any) -> int:
        if run.began_s and run.device.bench.clock.now_s - run.began_s[1] >= at_s:
            if how == "crash of the writer":
                raise ZeroDivisionError("planted")
            if how == "full disk":
                raise OSError(28, os.strerror(28))
            assert released.wait(30)
        return os.write(file, data)

    def open_journal(path: Path, head: Any, *room: int) -> JournalWriter:
        return run.journal(path, head, *room, write=write, now_s=lambda: run.device.bench.clock.now_s)

    return open_journal


@pytest.mark.parametrize(
    ("fault", "words", "raised", "status"),
    [
        ("slow disk", "taken nothing for 5.", RecordingFault, "fault"),
        ("full disk", "No space left", RecordingFault, "fault"),
        ("crash of the writer", "planted", ZeroDivisionError, "defect"),
    ],
)
def test_a_disk_that_fails_stops_the_motor_in_time_and_keeps_what_it_took(
    fault, words, raised, status, watched, stated_s, died_then, recover
) -> None:
    run, released, at_s = watched(profile=HELD), threading.Event(), 0.5
    stop = run.backend.safe_stop

    def safe_stop() -> None:
        stop()
        if run.live:
            released.set()  # the disk comes back only when the bench is safe

    run.backend.safe_stop = safe_stop
    with pytest.raises(raised, match=words):
        run.record(trials=2, open_journal=breaking(run, fault, at_s, released))
    assert run.live and 0 <= run.safe_after_s(1, at_s) <= stated_s[fault]
    (trial,) = Session.open(run.folder).trials
    data = trial.read()
    assert trial.status == status and words in data.reason and data.n_valid >= run.committed[1] > 0
    (entry,) = recover(died := died_then(run.folder, 1))
    again = Session.open(died).trial(1).read()
    assert entry["status"] == again.status == "incomplete" and again.n_valid >= run.committed[1]
    np.testing.assert_array_equal(again.raw_force_n, data.raw_force_n[: again.n_valid])


def test_a_disk_that_stands_still_for_two_seconds_loses_nothing(watched) -> None:
    run, released = watched(profile=HELD), threading.Event()
    behind = []

    def progress(state: Any) -> None:
        run.progress(state)
        behind.append(round((state.time_s - state.committed_s) * 5000))
        if state.time_s >= 2.5:
            released.set()

    run.record(trials=1, open_journal=breaking(run, "slow disk", 0.5, released), progress=progress)
    (trial,) = Session.open(run.folder).trials
    data = trial.read()
    # that none is missing was held against the driver's own count; committed was what the observer was told
    assert trial.status == "complete" and data.n_valid >= run.committed[1]
    assert max(behind) >= 2 * 5000
    np.testing.assert_array_equal(data.time_s, np.arange(data.n_valid) / 5000)


@pytest.mark.skipif(os.name == "nt", reason="needs a limit of the file size")
def test_when_the_disk_is_full_for_the_trial_and_for_its_seal_both_are_told_and_the_journal_is_recovered(
    watched, recover
) -> None:
    import resource

    run = watched()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def progress(state: Any) -> None:
        run.progress(state)
        if state.time_s >= PUSHING_S:
            resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))

    try:
        with pytest.raises(RecordingFault, match=r"File too large.*trial_0001.h5.*File too large.*pianorig recover"):
            run.record(trials=2, open_journal=JournalWriter, progress=progress)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert run.safe()
    (entry,) = recover(run.folder)
    data = Session.open(run.folder).trial(1).read()
    assert entry["status"] == data.status == "incomplete" and data.n_valid >= run.committed[1] > 0


KEYBOARD = 0
FIRST = (-200279, -200284, -50103, -201003, None, KEYBOARD, KEYBOARD)
"""Status codes; None is a server that does not answer."""
LATER = (-50103, -201003, None, KEYBOARD)
MOST_BETWEEN = 12
"""Calls between two faults: within one way out of a trial."""


class FaultsByCount(FaultPlan):
    """Faults at the n-th call of all; a lasting one stays."""

    def __init__(self, planted: dict[int, tuple[int | None, bool]]) -> None:
        super().__init__()
        self.planted, self.calls = planted, 0
        self.struck: set[int | None] = set()
        self.stays: list[int | None] = []

    def raise_due(self, call: str, device: Any, timeout_s: float = 0.0) -> None:
        self.calls += 1
        if self.stays:
            self.strike(self.stays[0])
        if self.calls in self.planted:
            code, lasting = self.planted[self.calls]
            if lasting and code != KEYBOARD:
                self.stays.append(code)
            self.strike(code)

    def strike(self, code: int | None) -> None:
        self.struck.add(code)
        if code == KEYBOARD:
            signal.raise_signal(signal.SIGINT)  # arrives at once, or after what may not be interrupted
            return
        if code is None:
            raise ServerGone("planted")
        raise DaqStatusError(code, "planted")


def planted(chance: random.Random, calls: int) -> dict[int, tuple[int | None, bool]]:
    """Draw one fault, and up to three more shortly behind it."""
    at = chance.randint(3, calls)
    faults = {at: (chance.choice(FIRST), chance.random() < 0.25)}
    for _ in range(chance.randint(0, 3)):
        faults[at + chance.randint(1, MOST_BETWEEN)] = (chance.choice(LATER), chance.random() < 0.4)
    return faults


def run_into(faults: FaultsByCount, backend: Any, rig: Any, profile: Any, folder: Path) -> None:
    device, committed = backend.device, {}
    device.faults = faults
    fault: BaseException | None = None
    try:
        record_session(
            folder, profile=profile, rig_config=rig, backend=backend, trials=2,
            progress=lambda p: committed.update({p.trial: round(p.committed_s * 5000)}),
        )  # fmt: skip
    except (HardwareFault, KeyboardInterrupt) as raised:
        fault = raised
        assert "\n" not in str(fault)
    device.bench.clock.advance(rig.config.watchdog.timeout_s + 0.01)
    check_watchdogs(device)
    assert device.output_v.get("cDAQ1Mod2/ao0", 0.0) == 0.0 and not device.drive_enabled()
    device.faults = FaultPlan()
    with contextlib.suppress(HardwareFault):
        backend.close()
    reset_device(device)
    if not folder.exists():
        assert fault is not None and not committed
        return
    session = Session.open(folder)
    trials = session.trials
    assert all(trials[number - 1].read().n_valid >= samples for number, samples in committed.items())
    words = [{None: "does not answer", KEYBOARD: "stopped by"}.get(code, str(code)) for code in faults.struck]
    told = [t.read().reason for t in trials if t.status != "complete"] + [note.reason for note in session.annotations]
    assert all(any(word in reason for word in words) for reason in told)
    if not isinstance(fault, KeyboardInterrupt):  # which may come when a trial has ended, and leaves no mark then
        assert (fault is None) == ([trial.status for trial in trials] == ["complete"] * 2)
        assert len(told) == (fault is not None)
    assert recover_session(folder) == []


@pytest.mark.usefixtures("keyboard")
@pytest.mark.skipif(os.name == "nt", reason="signal.raise_signal(SIGINT) ends the test run on Windows")
@pytest.mark.filterwarnings("ignore:Task of name:Warning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_at_whatever_call_faults_strike_the_bench_ends_safe_and_nothing_is_hidden(
    make_backend, rig, step_profile, tmp_path
) -> None:
    clean = FaultsByCount({})
    run_into(clean, make_backend(rig.config, noise_n=0.02), rig, step_profile, tmp_path / "clean")
    chance = random.Random(6)
    for turn in range(6):
        faults = FaultsByCount(planted(chance, clean.calls))
        try:
            run_into(faults, make_backend(rig.config, noise_n=0.02), rig, step_profile, tmp_path / str(turn))
        except AssertionError as error:
            raise AssertionError(f"{faults.planted}: {error}") from error
    del faults
    gc.collect()  # what the client says of timers whose making failed belongs to this test, not to whichever comes next
