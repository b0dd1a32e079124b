"""How long a first run takes that has to compile, beside the second, and what two first runs at once cost.

    python -m benchmarks first_run [--demo] [--runs 1] [--against CHECKOUT]

Each run is a process of its own with empty kernel caches, that of `vision` too: `pianorig simulate` of the forte blow,
`pianorig demo`, first and then again; then two first runs of `simulate` at once, which compile together what one of
them would. Wall times count on an idle machine only; the processor time of the commands is printed beside them,
without that of the process that compiles beside them. With ``--against`` another checkout runs in turns with this one.
Limits: first simulate 12 s, first demo 30 s, demo again 15 s; the median first demo 0.65 of the other checkout's.
Wrong is a missed limit, or a second run that compiles.
"""

from __future__ import annotations

import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

import model
from benchmarks.runner import ROOT, Checkout, Run, Table

LIMIT_S = {"simulate": 12.0, "demo": 30.0}
AGAIN_S = {"demo": 15.0}
RATIO = {"demo": 0.65}
SAYS = "compiling kernels"


def started(name: str, folder: Path, number: int, of: Checkout) -> tuple[float, float, str]:
    """Wall and processor time (s) of a command with the caches of ``folder``, and what it printed."""
    arguments = ["demo", "--out", folder / f"session{number}"]
    if name == "simulate":
        arguments = ["simulate", "--force", folder / "force.csv", "--out", folder / f"out{number}.csv"]
    # NUMBA_CACHE_DIR: where `vision` would keep its kernels beside its sources, and find them at every first run
    caches = {"PIANORIG_CACHE_DIR": str(folder / "cache"), "NUMBA_CACHE_DIR": str(folder / "vision")}
    return of.run("-m", "pianorig", *arguments, **caches)


def first_and_again(name: str, of: Checkout, table: Table) -> tuple[float, float, bool]:
    """Wall time of a first and a second run, s, and whether the second compiled; prints a line."""
    with tempfile.TemporaryDirectory() as place:
        write_force(Path(place))
        first, work, said = started(name, Path(place), 1, of)
        again, work_again, told = started(name, Path(place), 2, of)
    table.row(name, first, work, LIMIT_S[name], SAYS in said, again, work_again, SAYS in told, str(of.root))
    return first, again, SAYS in told


def write_force(folder: Path) -> None:
    """The force of the blow, as a file."""
    table = np.column_stack(model.force_table("forte"))
    np.savetxt(folder / "force.csv", table, delimiter=",", header="time_s,force_n", comments="")


def main(run: Run) -> bool:
    """Print a line for each pair of runs; whether all limits are kept."""
    own = Checkout(ROOT)
    other = None if run.against is None else Checkout(run.against)
    good = True
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors" if hasattr(os, "getloadavg") else "")
    table = Table(
        "command:9s", "first s:.1f", "processor s:.1f", "limit s:.1f", "compiles:d", "again s:.1f", "processor s:.1f",
        "compiles:d", "checkout:s",
    )  # fmt: skip
    for name in ["simulate", *(["demo"] if run.demo else [])]:
        ours, theirs = [], []
        for _ in range(run.runs):
            ours.append(first_and_again(name, own, table))
            if other is not None:
                theirs.append(first_and_again(name, other, table)[:2])
        good &= not any(compiled for _, _, compiled in ours)
        first, again = np.median([pair[:2] for pair in ours], axis=0)
        good &= bool(first <= LIMIT_S[name] and again <= AGAIN_S.get(name, np.inf))
        if theirs:
            ratio, ratio_again = np.array([first, again]) / np.median(theirs, axis=0)
            print(f"{name:9} in turns: first {ratio:.2f} of the other's, again {ratio_again:.2f}")
            good &= bool(ratio <= RATIO.get(name, np.inf))
    if not run.quick:
        with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(2) as pool:
            write_force(Path(place))
            both = list(pool.map(lambda number: started("simulate", Path(place), number, own), (1, 2)))
            print(f"two first simulates at once: {max(wall for wall, *_ in both):.1f} s")
    return good
