"""Every example runs as it stands and prints what it promises."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PROMISES = {
    "simulate_blow.py": ["the hammer strikes at", "held in check at"],
    "record_session.py": ["trial 2: complete", "turned by key"],
    "track_film.py": ["jack: turned 11.5 deg", "repetition: turned 5.7 deg"],
    "thesis_chapter_4.py": [
        "damping x 4.5",
        "Session double, RMSE of damping x 4.5 against hirschkorn2004",
        "report.html",
    ],
    "felt_with_two_times.py": ["share 0.5: peak", "energy closes to"],
    "felt_with_restitution.py": ["restitution: 0.68", "of 1.13 m/s"],
    "own_optimiser.py": ["hammer.joint_friction.A: ", "of the prior's"],
    "validate_session.py": ["as printed", "string_impact", "report.html"],
}


def test_no_example_is_forgotten() -> None:
    assert {p.name for p in EXAMPLES.glob("*.py")} == set(PROMISES)


@pytest.mark.slow  # each starts a fresh process and compiles or records by itself
@pytest.mark.parametrize("name", PROMISES)
def test_example_runs(name: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", str(EXAMPLES / name)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path), "TEMP": str(tmp_path)},
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    for words in PROMISES[name]:
        assert words in done.stdout, done.stdout
