"""Faults and Ctrl-C at any call of a session, alone and several at once: configure, arm, blow, stop, the next trial.

Whatever happens when: half a second later the motor is at 0 V and the drive disabled, what was committed is readable,
a fault that ended a trial is named in it, and recovery leaves nothing to recover.
"""

from __future__ import annotations

import contextlib
import gc
import os
import random
import signal
from pathlib import Path
from typing import Any

import pytest

from rig.errors import HardwareFault
from rig.recording.recorder import record_session
from rig.recording.recover import recover_session
from rig.session import Session
from rig.simulated.device.fault_injection import FaultPlan
from rig.simulated.device.watchdog import check_watchdogs
from rig.simulated.driver import reset_device
from rig.simulated.status import DaqStatusError, ServerGone

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

    def before_call(self, call: str, device: Any, timeout_s: float = 0.0) -> None:
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
@pytest.mark.parametrize("times", [16, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore:Task of name:Warning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_at_whatever_call_faults_strike_the_bench_ends_safe_and_nothing_is_hidden(
    times, make_backend, rig, step_profile, tmp_path
) -> None:
    clean = FaultsByCount({})
    run_into(clean, make_backend(rig.config, noise_n=0.02), rig, step_profile, tmp_path / "clean")
    chance = random.Random(times)
    for turn in range(times):
        faults = FaultsByCount(planted(chance, clean.calls))
        try:
            run_into(faults, make_backend(rig.config, noise_n=0.02), rig, step_profile, tmp_path / str(turn))
        except AssertionError as error:
            raise AssertionError(f"{faults.planted}: {error}") from error
    del faults
    gc.collect()  # what the client says of timers whose making failed belongs to this test, not to whichever comes next
