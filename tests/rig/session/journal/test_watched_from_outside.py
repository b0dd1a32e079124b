"""A recording in real time with ``pianorig watch`` in a second process: the data grow there, none are lost here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.journal_delay import Timed
from rig.recording.recorder import record_session
from rig.session import Session
from rig.simulated.bench.clock import PacedClock

TRIALS = 2
# loaded before the recording begins, then waiting for its folder
WATCH = """
import pathlib, sys, time
import pianorig.workflows.bench.watch, rig.session.journal.live_reader
from pianorig.cli import main
print("{}", flush=True)
while not (pathlib.Path(sys.argv[2]) / "session.toml").exists():
    time.sleep(0.01)
main(sys.argv[1:])
"""
ROOT = Path(__file__).parents[4]


def record(folder: Path, backend: Any, rig: Any, profile: Any) -> tuple[Session, float]:
    """Record in real time; the session and the 99th percentile of sample to journal, s."""
    Timed.log = []
    session = record_session(
        folder, profile=profile, rig_config=rig, backend=backend, trials=TRIALS, open_journal=Timed
    )
    return session, float(np.percentile(Timed.ages_s(), 99))


@pytest.mark.slow
def test_a_second_process_sees_the_data_grow_and_disturbs_nothing(tmp_path, make_backend, rig, step_profile) -> None:
    def bench() -> Any:
        return make_backend(rig.config, clock=PacedClock(1.0), noise_n=0.02)

    alone, quiet_s = record(tmp_path / "alone", bench(), rig, step_profile)
    seen = tmp_path / "seen.jsonl"
    with seen.open("wb") as out:
        watcher = subprocess.Popen(
            [sys.executable, "-c", WATCH, "watch", str(tmp_path / "watched"), "--json", "--every", "0.05"],
            stdout=out,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            cwd=tmp_path,
        )
        try:
            while not seen.stat().st_size:
                assert watcher.poll() is None, seen.read_text()
                time.sleep(0.05)
            watched, watched_s = record(tmp_path / "watched", bench(), rig, step_profile)
            assert watcher.wait(30) == 0, seen.read_text()
        finally:
            watcher.kill()
            watcher.wait()
    views = [json.loads(line) for line in seen.read_text().splitlines()[1:]]
    for trial in range(1, TRIALS + 1):
        sizes = [view["samples"] for view in views if view["trial"] == trial and view["state"] == "recording"]
        assert sizes == sorted(sizes)
        assert len(set(sizes)) >= 3, (trial, sizes)
    assert views[-1]["state"] == "complete" and views[-1]["trial"] == TRIALS
    # the bench's noise has a seed: what was recorded under watch is what is recorded alone, sample for sample
    for one, other in zip(alone.trials, watched.trials, strict=True):
        a, b = one.read(), other.read()
        n = min(a.n_valid, b.n_valid)
        np.testing.assert_array_equal(b.time_s, np.arange(b.n_valid) / 5000.0)
        np.testing.assert_array_equal(a.force_n[:n], b.force_n[:n])
        np.testing.assert_array_equal(a.encoder_count[:n], b.encoder_count[:n])
        assert b.status == "complete" and abs(a.n_valid - b.n_valid) <= 200
    assert watched_s <= max(0.05, 2 * quiet_s), (watched_s, quiet_s)
