"""How long a first run takes that has to compile, beside the second, and what two first runs at once cost.

    python benchmarks/first_run.py [--demo] [--runs 1]

Each run is a process of its own with an empty kernel cache: `pianorig simulate` of the forte blow, `pianorig demo`,
first and then again; then two first runs of `simulate` at once, which compile together what one of them would.
Wall times count on an idle machine only; the processor time of the commands is printed beside them, without that of
the process that compiles beside them. Limits: first simulate 12 s, first demo 45 s.
Exit code 1: a limit is missed, or a second run compiles.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

import model  # noqa: E402

LIMIT_S = {"simulate": 12.0, "demo": 45.0}
SAYS = "compiling kernels"


def command(name: str, folder: Path, number: int) -> list[str]:
    if name == "demo":
        return ["demo", "--out", str(folder / f"session{number}")]
    return ["simulate", "--force", str(folder / "force.csv"), "--out", str(folder / f"out{number}.csv")]


def run(names: list[str], folder: Path, cache: Path, number: int) -> tuple[float, float, list[str]]:
    """Start these commands at once; wall time and processor time of all (s), and what each printed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PIANORIG_CACHE_DIR": str(cache)}
    before, start = os.times(), time.perf_counter()
    started = [
        subprocess.Popen(
            [sys.executable, "-m", "pianorig", *command(name, folder, 10 * number + k)],
            env=environment,
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for k, name in enumerate(names)
    ]
    said = [process.communicate()[0] for process in started]
    seconds, after = time.perf_counter() - start, os.times()
    for process, text in zip(started, said, strict=True):
        if process.returncode:
            raise SystemExit(f"{' '.join(process.args)}: exit code {process.returncode}\n{text}")  # type: ignore[arg-type]
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return seconds, spent, said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--demo", action="store_true", help="also the demo")
    parser.add_argument("--runs", type=int, default=1)
    chosen = parser.parse_args()
    missed = False
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors" if hasattr(os, "getloadavg") else "")
    for name in ["simulate", *(["demo"] if chosen.demo else [])]:
        for _ in range(chosen.runs):
            with tempfile.TemporaryDirectory() as place:
                folder = Path(place)
                table = np.column_stack(model.force_table("forte"))
                np.savetxt(folder / "force.csv", table, delimiter=",", header="time_s,force_n", comments="")
                first, work, said = run([name], folder, folder / "cache", 1)
                again, work_again, told = run([name], folder, folder / "cache", 2)
                print(
                    f"{name:9} first {first:.1f} s (processor {work:.1f} s; limit {LIMIT_S[name]:g} s), again "
                    f"{again:.1f} s ({work_again:.1f} s); says that it compiles: {SAYS in said[0]}, "
                    f"again: {SAYS in told[0]}"
                )
                missed |= first > LIMIT_S[name] or SAYS in told[0]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        np.savetxt(folder / "force.csv", table, delimiter=",", header="time_s,force_n", comments="")
        both, work, _ = run(["simulate", "simulate"], folder, folder / "cache", 1)
        print(f"two first simulates at once: {both:.1f} s (processor {work:.1f} s)")
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
