"""The rows of docs/safety.md in which a process dies: the bench is served in another process, its clock decides.

That clock runs at a quarter of the wall's, so that a busy machine is late by a quarter as much. Committed is what an
observer read in the journal before the program was told to end.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from pianorig.workflows.predict_blow import predictor
from rig.configuration.profile import load_profile
from rig.configuration.rig_file import load_rig
from rig.errors import DeviceNotFound
from rig.recording.recorder import record_session
from rig.recording.recover import recover_session
from rig.safety.permission import Permission
from rig.selftest import read_record
from rig.session import Session
from rig.session.journal import scan_journal

STEP = Path(__file__).parents[1] / "step.toml"
MOST_UNCOMMITTED = 500
"""Samples: 100 ms."""
HELD = (
    'name = "held"\npoints = [{time_s=0,force_n=0},{time_s=0.1,force_n=3},{time_s=5,force_n=3},{time_s=5.1,force_n=0}]'
)

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows ends a program without asking it")


def enabled(line: dict[str, object]) -> bool:
    return line.get("drive") == "enabled"


def live(line: dict[str, object]) -> bool:
    return line.get("motor") == "live"


def safe(line: dict[str, object]) -> bool:
    return line.get("motor") == "0 V" and line["drive"] == "disabled"


@pytest.fixture
def recording(serve, start, permitted, tmp_path):
    """A recording in one process on a bench in another: (bench, recorder, session folder)."""

    def begin(fault: str = ""):
        bench, address = serve(f"sim://?clock=0.25&fault={fault}")
        profile = tmp_path / "held.toml"
        profile.write_text(HELD)
        folder = tmp_path / "s"
        recorder = start("record", "--profile", profile, "--backend", address, "--out", folder, *permitted)
        return bench, recorder, folder

    return begin


@pytest.mark.parametrize(
    "number", [pytest.param(number, marks=pytest.mark.slow) for number in (signal.SIGTERM, signal.SIGINT)]
)
def test_a_recording_asked_to_end_makes_the_outputs_safe_itself_and_seals_the_trial(
    number, recording, recover, stated_s
) -> None:
    bench, recorder, folder = recording()
    began = bench.wait_for(live)
    committed = scan_journal(folder / "trial_0001.journal").n_samples
    assert recorder.end(number) == 130
    after = bench.wait_for(safe)
    assert after["watchdog"] == "quiet" and after["time_s"] - began["time_s"] <= stated_s[number.name]
    (trial,) = Session.open(folder).trials
    data = trial.read()
    assert trial.status == "interrupted" and data.n_valid >= committed >= 1500
    assert "stopped by" in data.reason and recover(folder) == []


def test_when_the_recording_is_killed_the_watchdog_makes_the_outputs_safe(recording, recover, stated_s) -> None:
    bench, recorder, folder = recording()
    began = bench.wait_for(live)
    committed = scan_journal(folder / "trial_0001.journal").n_samples
    recorder.end(signal.SIGKILL)
    after = bench.wait_for(safe)
    assert after["watchdog"] == "tripped" and after["time_s"] - began["time_s"] <= stated_s["kill -9"]
    (entry,) = recover(folder)
    data = Session.open(folder).trial(1).read()
    assert data.status == entry["status"] == "incomplete" and "the recording was cut off" in data.reason
    # the bench outlives the program and has counted what it acquired
    assert after["samples"] - MOST_UNCOMMITTED <= data.n_valid <= after["samples"]
    assert data.n_valid >= committed
    np.testing.assert_array_equal(data.time_s, np.arange(data.n_valid) / 5000)


@pytest.mark.slow
def test_when_the_recording_is_killed_with_the_drive_just_enabled_it_is_disabled_again(recording, stated_s) -> None:
    bench, recorder, folder = recording()
    began = bench.wait_for(enabled)
    recorder.end(signal.SIGKILL)
    after = bench.wait_for(safe)
    assert after["watchdog"] == "tripped" and after["time_s"] - began["time_s"] <= stated_s["kill -9"]
    (entry,) = recover_session(folder)
    assert entry.status in ("empty", "incomplete") and recover_session(folder) == []


@pytest.mark.slow
def test_when_the_server_answers_no_more_the_watchdog_makes_the_outputs_safe(recording, recover, stated_s) -> None:
    bench, recorder, folder = recording("server-gone@1/0.6")
    bench.wait_for(live)
    after = bench.wait_for(safe)
    assert after["watchdog"] == "tripped" and after["samples"] <= (0.6 + 0.02) * 5000
    assert recorder.process.wait(60) == 3
    (trial,) = Session.open(folder).trials
    data = trial.read()
    assert trial.status == "fault" and "use the emergency stop" in data.reason and "does not answer" in data.reason
    assert after["samples"] - MOST_UNCOMMITTED <= data.n_valid <= after["samples"] and recover(folder) == []


@pytest.mark.slow
def test_when_the_server_is_killed_the_trial_ends_with_what_was_committed(serve, permitted, tmp_path, recover) -> None:
    server, address = serve("sim://?clock=real")
    rig = load_rig(permitted[1])
    permission = Permission("--yes", rig.sha256, read_record(Path(permitted[4])))
    committed = []

    def progress(state) -> None:
        committed.append(round(state.committed_s * 5000))
        if state.time_s > 0.4:
            server.process.kill()

    with pytest.raises(DeviceNotFound, match="does not answer"):
        record_session(
            tmp_path / "s", profile=load_profile(STEP), rig_config=rig, backend=address, trials=2,
            permission=permission, predict=predictor(rig), progress=progress,
        )  # fmt: skip
    (trial,) = Session.open(tmp_path / "s").trials
    data = trial.read()
    assert trial.status == "fault" and "use the emergency stop" in data.reason
    assert data.n_valid >= committed[-1] >= 2000
    assert recover(tmp_path / "s") == []
