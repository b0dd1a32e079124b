"""How long a first run takes that has to compile, beside the second, and what two first runs at once cost.

    python benchmarks/first_run.py [--demo] [--runs 1] [--against CHECKOUT [--python THEIRS]]

Each run is a process of its own with empty kernel caches, that of `vision` too: `pianorig simulate` of the forte blow,
`pianorig demo`, first and then again; then two first runs of `simulate` at once, which compile together what one of
them would. Wall times count on an idle machine only; the processor time of the commands is printed beside them,
without that of the process that compiles beside them. With ``--against`` another checkout runs in turns with this one.
Limits: first simulate 12 s, first demo 30 s, demo again 15 s; the median first demo 0.65 of the other checkout's.
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
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

import model  # noqa: E402

LIMIT_S = {"simulate": 12.0, "demo": 30.0}
AGAIN_S = {"demo": 15.0}
RATIO = {"demo": 0.65}
SAYS = "compiling kernels"


def command(name: str, folder: Path, number: int) -> list[str]:
    if name == "demo":
        return ["demo", "--out", str(folder / f"session{number}")]
    return ["simulate", "--force", str(folder / "force.csv"), "--out", str(folder / f"out{number}.csv")]


class Checkout(NamedTuple):
    """A source tree and the interpreter that runs it."""

    root: Path
    python: str


def run(names: list[str], folder: Path, number: int, of: Checkout) -> tuple[float, float, list[str]]:
    """Start these commands at once; wall time and processor time of all (s), and what each printed."""
    # NUMBA_CACHE_DIR: where `vision` would keep its kernels beside its sources, and find them at every first run
    caches = {"PIANORIG_CACHE_DIR": str(folder / "cache"), "NUMBA_CACHE_DIR": str(folder / "vision")}
    environment = {**os.environ, "PYTHONPATH": str(of.root), **caches}
    before, start = os.times(), time.perf_counter()
    started = [
        subprocess.Popen(
            [of.python, "-m", "pianorig", *command(name, folder, 10 * number + k)],
            env=environment,
            cwd=of.root,
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


def first_and_again(name: str, of: Checkout) -> tuple[float, float, bool]:
    """Wall time of a first and a second run, s, and whether the second compiled; prints a line."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_force(folder)
        first, work, said = run([name], folder, 1, of)
        again, work_again, told = run([name], folder, 2, of)
    print(
        f"{name:9} first {first:.1f} s (processor {work:.1f} s; limit {LIMIT_S[name]:g} s), again {again:.1f} s "
        f"({work_again:.1f} s); says that it compiles: {SAYS in said[0]}, again: {SAYS in told[0]}; {of.root}",
        flush=True,
    )
    return first, again, SAYS in told[0]


def write_force(folder: Path) -> None:
    """The force of the blow, as a file."""
    table = np.column_stack(model.force_table("forte"))
    np.savetxt(folder / "force.csv", table, delimiter=",", header="time_s,force_n", comments="")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--demo", action="store_true", help="also the demo")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--against", type=Path, help="another checkout, in turns with this one")
    parser.add_argument("--python", default=sys.executable, help="interpreter of that checkout")
    chosen = parser.parse_args()
    own = Checkout(ROOT, sys.executable)
    other = None if chosen.against is None else Checkout(chosen.against.resolve(), chosen.python)
    missed = False
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors" if hasattr(os, "getloadavg") else "")
    for name in ["simulate", *(["demo"] if chosen.demo else [])]:
        ours, theirs = [], []
        for _ in range(chosen.runs):
            ours.append(first_and_again(name, own))
            if other is not None:
                theirs.append(first_and_again(name, other)[:2])
        missed |= any(compiled for _, _, compiled in ours)
        first, again = np.median([run[:2] for run in ours], axis=0)
        missed |= first > LIMIT_S[name] or again > AGAIN_S.get(name, np.inf)
        if theirs:
            ratio, ratio_again = np.array([first, again]) / np.median(theirs, axis=0)
            print(f"{name:9} in turns: first {ratio:.2f} of the other's, again {ratio_again:.2f}")
            missed |= ratio > RATIO.get(name, np.inf)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_force(folder)
        both, work, _ = run(["simulate", "simulate"], folder, 1, own)
        print(f"two first simulates at once: {both:.1f} s (processor {work:.1f} s)")
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
