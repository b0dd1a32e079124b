"""Fuzz the readers of the rig's files: damaged input must give a one-line error or the correct values.

    python -m benchmarks fuzz_recordings [--count 10000] [--readers plan,journal]

The cases and the meaning of "correct" are those of `tests/rig/fuzz`: settings (rig, profile, plan, mapping, film and
self-test record, bodies, camera), recordings (CSV, LVM, TDMS), session with annotations and trial, journal. Prints per
reader the number of inputs and how many were refused; the rest were read and verified. The first input that gives a
traceback, hangs or is misread ends the script with an exception.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from benchmarks.runner import Run, Table
from tests.rig.fuzz.damage import survive
from tests.rig.fuzz.test_recordings_survive import CASES as BINARY
from tests.rig.fuzz.test_texts_survive import CASES as TEXTS


def main(run: Run) -> None:
    """Fuzz each reader and print the counts."""
    cases = {**TEXTS, **BINARY}
    table = Table("reader:18s", "inputs:d", "refused:d", "read right:d", "s of CPU:.1f")
    for name in run.readers or cases:
        with tempfile.TemporaryDirectory() as folder:
            whole, read, check = cases[name](Path(folder))
            began = time.process_time()
            refused = survive(whole, read, check, run.count)
        table.row(name, run.count, refused, run.count - refused, time.process_time() - began)
