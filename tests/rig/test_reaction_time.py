"""Every fault within a trial: outputs safe within the stated time, reason in the file, what was committed readable.

Stated: a block (20 ms), the force's delay (8 ms) and the block that is read when the fault is seen, 48 ms of data. A
force that is missing counts from its fifth millisecond.
"""

from __future__ import annotations

import shutil
import threading
from pathlib import Path

import numpy as np
import pytest

from rig.errors import HardwareFault, RecordingFault
from rig.recorder import record_session
from rig.recover import recover_session
from rig.session import Session
from rig.session.journal import JournalWriter
from rig.session.journal_format import END, encode, records
from rig.simulated.faults import FaultPlan, parse_faults

STATED_S = 0.0482
COUNTED = (('mode = "pulses"', 'mode = "counted"'), ('terminal = "/cDAQ1Mod4/PFI4"', 'terminal = "/cDAQ1Mod4/PFI0"'))
PUSHING_S = 0.39
FAULTS = {
    "overwrite": ("-200279", 0.0),
    "timeout": ("-200284", 0.0),
    "underrun": ("-200290", 0.0),
    "bridge-open": ("open bridge", 0.0),
    "saturated": ("saturated or stuck", 0.0),
    "silent": ("told to push", 0.005),
    "dropped": ("drops frames", 0.0),
}


class KeptJournal(JournalWriter):
    """A journal that stays beside its sealed trial, as a program that died in between leaves it."""

    def remove(self) -> None:
        """Keep it."""


def cut_off(folder: Path, number: int, target: Path) -> Path:
    """The session as it is when the program dies with the fault: journal without its closing record, nothing sealed."""
    shutil.copytree(folder, target)
    journal = target / f"trial_{number:04d}.journal"
    kept = [r for r in records(journal.read_bytes()) if r.kind != END]
    journal.write_bytes(b"".join(encode(r.kind, r.sequence, r.first_sample, r.n, r.payload) for r in kept))
    (target / f"trial_{number:04d}.h5").unlink()
    return target


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_ends_the_blow_in_time_and_nothing_committed_is_lost(
    kind, edited_rig, make_backend, step_profile, tmp_path, assert_safe
) -> None:
    said, later_s = FAULTS[kind]
    rig = edited_rig(*COUNTED)
    backend = make_backend(rig.config, noise_n=0.02)
    device = backend.device
    device.faults = FaultPlan(parse_faults(f"{kind}@2/{PUSHING_S}"))
    low_s, zero_s, committed = [], [], []
    write, write_lines = device.write, device.write_lines

    def volts(task, values, auto_start) -> None:
        write(task, values, auto_start)
        if task.name == "motor_zero" and device.trial == 2:
            zero_s.append(device.bench.edge / device.bench.rate_hz)

    def lines(task, states, auto_start) -> None:
        write_lines(task, states, auto_start)
        if not states[0] and device.trial == 2:
            low_s.append(device.bench.edge / device.bench.rate_hz)

    def progress(state) -> None:
        if state.trial == 2:
            committed.append(round(state.committed_s * 5000))

    device.write, device.write_lines = volts, lines
    with pytest.raises(HardwareFault) as fault:
        record_session(
            tmp_path / "s", profile=step_profile, rig_config=rig, backend=backend, trials=3, progress=progress,
            open_journal=KeptJournal,
        )  # fmt: skip
    assert fault.value.exit_code == 3
    for moment in (zero_s[0], low_s[0]):
        assert PUSHING_S <= moment <= PUSHING_S + STATED_S + later_s
    assert_safe(backend)
    session = Session.open(tmp_path / "s")
    assert [trial.status for trial in session.trials] == ["complete", "fault"]  # latched: no third trial
    data = session.trial(2).read()
    assert said in data.reason and data.n_valid >= committed[-1] > 1750
    recovered = cut_off(tmp_path / "s", 2, tmp_path / "r")
    (_, entry) = recover_session(recovered)
    again = Session.open(recovered).trial(2).read()
    assert (entry.status, again.status) == ("incomplete", "incomplete")
    np.testing.assert_array_equal(again.force_n, data.force_n)


def test_a_disk_that_hangs_stops_the_motor_and_what_it_took_is_readable(
    make_backend, rig, step_profile, tmp_path, assert_safe
) -> None:
    backend = make_backend(rig.config, noise_n=0.02)
    released, written, committed = threading.Event(), [0], []
    stop = backend.safe_stop

    def write(file: int, data) -> int:
        import os

        written[0] += len(data)
        if written[0] > 110_000:
            assert released.wait(30)
        return os.write(file, data)

    def safe_stop() -> None:
        stop()
        if written[0] > 110_000:
            released.set()  # the disk comes back only when the bench is safe

    backend.safe_stop = safe_stop

    def open_journal(path, head, *room):
        # the disk's seconds: the bench runs through 5 s of them within the trial
        return JournalWriter(path, head, *room, write=write, now_s=lambda: 40 * backend.device.bench.clock.now_s)

    with pytest.raises(RecordingFault, match="has taken nothing for 5.* s, allowed 5 s"):
        record_session(
            tmp_path / "s", profile=step_profile, rig_config=rig, backend=backend, trials=2, open_journal=open_journal,
            progress=lambda p: committed.append(round(p.committed_s * 5000)),
        )  # fmt: skip
    assert_safe(backend)
    (trial,) = Session.open(tmp_path / "s").trials
    data = trial.read()
    assert trial.status == "fault" and "record to a faster disk" in data.reason
    assert data.n_valid >= max(committed) > 0
