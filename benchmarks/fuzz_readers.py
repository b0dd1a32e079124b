"""Damaged films and recordings in numbers: the tests of the readers, run with as many inputs a format as asked for.

    python -m benchmarks fuzz_readers [--count 12000] [--seed 1]

A film must be refused in one line or read right, in no more memory than its own size; a recording must be refused or
give the values of a second, independent reading. What fails is printed by pytest.
"""

from __future__ import annotations

import os
import subprocess
import sys

from benchmarks.runner import ROOT, Run

TESTS = ("tests/rig/fuzz/test_damage_survives.py", "tests/vision/film/test_fuzzed_films.py")


def main(run: Run) -> bool:
    """Run the tests; whether all films and recordings are refused or read right."""
    more = {"FUZZ_INPUTS": str(run.count), "FUZZ_SEED": str(run.seed)}
    command = [sys.executable, "-m", "pytest", "-n0", "-q", *TESTS]
    return subprocess.run(command, cwd=ROOT, env=os.environ | more, check=False).returncode == 0
