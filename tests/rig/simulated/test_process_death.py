"""The rows of docs/safety.md in which a process dies: the bench is served in another process, its clock decides.

That clock runs at a quarter of the wall's, so that a busy machine is late by a quarter as much. Committed is what an
observer read in the journal before the program was told to end.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from rig import SelftestFinding, SelftestRecord, Session, load_rig
from rig.session.journal_records import scan_journal
from tests.rig.program import Program

HERE = Path(__file__).parents[1]
MOST_UNCOMMITTED = 500
"""Samples: 100 ms."""
HELD = (
    'name = "held"\npoints = [{time_s=0,force_n=0},{time_s=0.1,force_n=3},{time_s=5,force_n=3},{time_s=5.1,force_n=0}]'
)

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows ends a program without asking it")


def live(line: dict[str, object]) -> bool:
    return line.get("motor") == "live"


def safe(line: dict[str, object]) -> bool:
    return line.get("motor") == "0 V" and line["drive"] == "disabled"


@pytest.fixture(scope="module")
def bench() -> Iterator[tuple[Program, str]]:
    """A bench served in another process that tells how its outputs are: (program, backend address)."""
    program = Program(str(HERE / "watched_bench.py"), "sim://?clock=0.25")
    yield program, "ni-grpc://" + program.wait_for(lambda line: "address" in line)["address"]
    program.end()


@pytest.fixture
def recorder(bench, tmp_path) -> Iterator[Program]:
    """A recording in a process of its own into ``tmp_path / "s"``, permitted to move the bench's motor."""
    profile, rig_file, folder = tmp_path / "held.toml", tmp_path / "rig.toml", tmp_path / "s"
    profile.write_text(HELD)
    rig_file.write_text(load_rig("virtual").text.replace("allow_yes = false", "allow_yes = true"))
    passed = SelftestRecord(
        created_utc=datetime.now(UTC), rig="virtual", rig_sha256=load_rig(rig_file).sha256, product="cDAQ-9189",
        device="cDAQ1", backend="test", simulated=True, serial_number="none (simulated)",
        findings=(SelftestFinding(check="all", passed=True, found="", allowed=""),),
    ).write(tmp_path)  # fmt: skip
    words = ("--profile", profile, "--backend", bench[1], "--out", folder, "--rig", rig_file, "--selftest", passed)
    program = Program("-c", "from pianorig.cli import main; main()", "record", "--yes", *map(str, words))
    yield program
    program.end()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_recording_asked_to_end_makes_the_outputs_safe_itself_and_seals_the_trial(
    number, bench, recorder, recover, stated_s, tmp_path
) -> None:
    (bench, _), folder = bench, tmp_path / "s"
    began = bench.wait_for(live)
    committed = scan_journal(folder / "trial_0001.journal").n_samples
    assert recorder.end(number) == 130
    after = bench.wait_for(safe)
    assert after["watchdog"] == "quiet" and after["time_s"] - began["time_s"] <= stated_s[number.name]
    (trial,) = Session.open(folder).trials
    data = trial.read()
    assert trial.status == "interrupted" and data.n_valid >= committed >= 1500
    assert "stopped by" in data.reason and recover(folder) == []


def test_when_the_recording_is_killed_the_watchdog_makes_the_outputs_safe(
    bench, recorder, recover, stated_s, tmp_path
) -> None:
    (bench, _), folder = bench, tmp_path / "s"
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
