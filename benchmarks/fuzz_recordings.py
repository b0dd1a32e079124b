"""Fuzz the readers of the rig's files: damaged input must give a one-line error or the correct values.

    python benchmarks/fuzz_recordings.py [--count 10000] [READER ...]

The cases and the meaning of "correct" are those of `tests/rig/fuzz`: settings (rig, profile, plan, mapping, film and
self-test record, bodies, camera), recordings (CSV, LVM, TDMS), session with annotations and trial, journal. Prints per
reader the number of inputs and how many were refused; the rest were read and verified. The first input that gives a
traceback, hangs or is misread ends the script with an exception.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from tests.rig.fuzz.damage import survive
from tests.rig.fuzz.test_recordings_survive import CASES as BINARY
from tests.rig.fuzz.test_texts_survive import CASES as TEXTS


def main() -> int:
    """Fuzz each reader and print the counts."""
    cases = {**TEXTS, **BINARY}
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("readers", nargs="*", choices=[*cases, []], default=[])
    parser.add_argument("--count", type=int, default=10_000)
    arguments = parser.parse_args()
    print(f"{'reader':18s}{'inputs':>8s}{'refused':>9s}{'read right':>12s}{'s of CPU':>10s}")
    for name in arguments.readers or cases:
        with tempfile.TemporaryDirectory() as folder:
            whole, read, check = cases[name](Path(folder))
            began = time.process_time()
            refused = survive(whole, read, check, arguments.count)
        took = time.process_time() - began
        print(f"{name:18s}{arguments.count:8d}{refused:9d}{arguments.count - refused:12d}{took:10.1f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
