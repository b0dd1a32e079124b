"""The work-precision benchmark runs, checks its own answers and says so when one is wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import model
from benchmarks import work_precision
from benchmarks.peers.compiled import BLOWS, force_table
from benchmarks.peers.equations import accelerations, largest_deviation
from benchmarks.peers.solvers import Answer
from benchmarks.work_precision import Entry, Row, race, time_at_error

ROOT = Path(__file__).parents[2]


@pytest.mark.slow  # half a minute, for all the peers are compiled
def test_quick_run_gives_table_and_json(tmp_path):
    record = tmp_path / "rows.json"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "benchmarks", "work_precision", "--quick"]
        + ["--json", str(record)],
        capture_output=True, text=True, cwd=ROOT, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    assert "ours " in done.stdout
    found = json.loads(record.read_text())
    assert found["failed"] == []
    assert found["reference_difference_rad"]["forte"] < 1e-10
    ours = [row for row in found["rows"] if row["ours"]]
    assert ours and all(0 < row["error_rad"] <= 2 * row["tolerance"] for row in ours)
    assert all(row["best_s"] > 0 and row["steps"] > 100 and row["rhs"] > row["steps"] for row in ours)
    # every peer that ran solved the same problem
    assert all(row["error_rad"] < 5e-3 for row in found["rows"])


def test_equations_follow_the_parameters():
    changed = model.load_action(overrides={"contact04.friction.A": 0.9, "hammer.mass": 0.02})
    rest = model.rest_state(model.load_action()).angle_rad
    assert largest_deviation(accelerations(changed), changed, rest) < 1e-11
    assert largest_deviation(accelerations(model.load_action()), changed, rest) > 1e-3


def row(method="ours a", tolerance=1e-5, error=1e-5, best=0.01):
    return Row("forte", method, method.startswith("ours"), tolerance, error, best, 1, None, None, None, None)


def test_wrong_answers_are_named():
    rows = [row(error=1.9e-5), row(error=2.1e-5), row(error=float("nan")), row("peer", error=1.0)]
    bad = work_precision.check(rows, {"forte": 5e-10, "piano": 2e-9})
    assert len(bad) == 3
    assert "2.10e-05" in bad[0] and "nan" in bad[1] and bad[2].startswith("piano")


def test_time_at_an_error_is_read_off_the_log_log_line():
    ours = [row(error=1e-4, best=0.01), row(error=1e-6, best=0.04), row(error=1e-5, best=0.9)]
    assert time_at_error(ours, 1e-5) == pytest.approx(0.02)  # the slow middle point is beaten by its neighbours
    assert time_at_error(ours, 1e-3) == pytest.approx(0.01)
    assert time_at_error(ours, 1e-7) is None


def test_force_tables_are_what_they_say():
    peak = {}
    for blow in BLOWS:
        t, f = force_table(blow)
        assert t.shape == f.shape == (3501,)
        assert np.diff(t) == pytest.approx(2e-4)
        peak[blow] = f.max()
    assert peak["fortissimo"] == pytest.approx(60.0, abs=3.0)
    noise = force_table("noisy")[1] - force_table("forte")[1]
    assert noise.std() == pytest.approx(0.05, rel=0.05)


def test_a_failing_peer_is_named_and_left_out():
    def broken(tolerance: float) -> Answer:
        raise RuntimeError("no luck")

    def steady(tolerance: float) -> Answer:
        return Answer(np.full((3, 5), tolerance))

    said: list[str] = []
    rows = race(
        "forte",
        [Entry("peer", False, broken, (1e-3,)), Entry("ours a", True, steady, (1e-3,))],
        np.zeros((3, 5)),
        2,
        said.append,
    )
    assert [r.method for r in rows] == ["ours a"]
    assert rows[0].error_rad == pytest.approx(1e-3) and rows[0].repeats == 2
    assert said == ["forte: peer at 1e-03 failed: no luck"]
