"""Requested tolerance against true error and run time of one blow, for each integration method.

Run:  python benchmarks/tolerance.py
The error is the largest difference of any angle from a reference made by an independent explicit method
(tests/model/data/make_reference.py). Exits with 1 when an error exceeds twice its tolerance.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

import model
from model.integrators import METHODS

DATA = Path(__file__).parents[1] / "tests" / "model" / "data"
BLOWS = ("forte", "piano", "noisy")
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def main() -> int:
    action = model.load_action()
    bad = 0
    print(
        f"{'blow':6} {'method':8} {'tolerance':>9} {'error rad':>10} {'error/tol':>9} {'ms':>7} "
        f"{'steps':>7} {'rejected':>8} {'rhs':>7}"
    )
    for blow in BLOWS:
        force = np.loadtxt(DATA / f"{blow}_force.csv", delimiter=",", skiprows=1)
        rows = np.loadtxt(DATA / f"{blow}_reference.csv", delimiter=",", skiprows=1)
        for method in METHODS:
            for tolerance in TOLERANCES:
                best = float("inf")
                for _ in range(3):
                    start = time.perf_counter()
                    solution = model.simulate(
                        action, force[:, 0], force[:, 1], tolerance=tolerance, method=method, output_time_s=rows[:, 0]
                    )
                    best = min(best, time.perf_counter() - start)
                error = float(np.abs(solution.angle_rad - rows[:, 1:6]).max())
                c = solution.counters
                bad += error > 2 * tolerance
                print(
                    f"{blow:6} {method:8} {tolerance:9.0e} {error:10.1e} {error / tolerance:9.2f} {best * 1e3:7.1f} "
                    f"{c['n_steps']:7d} {c['n_rejected']:8d} {c['n_rhs']:7d}"
                )
    if bad:
        print(f"{bad} errors above twice their tolerance")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
