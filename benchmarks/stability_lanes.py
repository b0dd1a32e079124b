"""Do plausible actions, each with other parameters, come out of lanes as they come out of single runs?

    python benchmarks/stability_lanes.py [--count 10000] [--seed 1] [--workers 2]

Set A of `stability_cases`: geometry +-2 mm, everything else +-50 %, v_t 1e-2..1e-5, forces to 120 N with 0.2 ms edges,
401 output times, 1e-5 rad. Each case is run by itself and in lanes, beside whatever cases come next to it. A case
agrees where both finish and differ by at most a tenth of the tolerance, or both fail with the same error. Further
apart they must be within ten tolerances times the measured growth of a disturbance as large as the tolerance (the
largest one found in five moments and all coordinates; rounding is such a disturbance too, amplified by step control).
Exit code 1: a difference that growth does not explain, or a case that fails one way only.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

import model
from benchmarks.stability_cases import END_S, FACTOR, KICK_S, STEPS, TOLERANCE, Runner, plausible
from model import batch
from model.batch.lanes import choose
from model.simulation.options import ForceDrivenOptions

OUT = np.linspace(0.0, END_S, 401)


def growth(runner: Runner, enough: float) -> float:
    """Largest growth of a disturbance of the tolerance; stops where it is ``enough``."""
    base = runner.states(OUT, TOLERANCE / 100.0, steps=10 * STEPS)[0]
    largest = 1.0
    for moment in KICK_S:
        for kick in TOLERANCE * np.eye(5):
            moved = runner.states(OUT, TOLERANCE / 100.0, moment, kick, steps=10 * STEPS)[0]
            largest = max(largest, float(np.abs(moved - base).max()) / TOLERANCE)
            if largest >= enough:
                return largest
    return largest


def jobs_of(seed: int, count: int) -> list[batch.Job]:
    options = ForceDrivenOptions(tolerance=TOLERANCE, output_time_s=OUT)
    action, out = model.load_action(), []
    for number in range(count):
        case = plausible(seed, number)
        out += batch.make_jobs(action, {str(number): (case.time_s, case.force_n)}, {"": case.overrides}, options)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args()
    jobs = jobs_of(chosen.seed, chosen.count)
    spent, runs = [], []
    for lanes in (False, True):
        marked = choose(jobs, lanes)
        batch.run_jobs(marked[:1])  # compile or load
        start = time.process_time()
        runs.append(batch.run_jobs(marked, workers=chosen.workers))
        spent.append(time.process_time() - start)
    tally: Counter[str] = Counter()
    apart, bad = [], 0
    for number, (alone, beside) in enumerate(zip(*runs, strict=True)):
        if alone.solution is None or beside.solution is None:
            same = type(alone.error) is type(beside.error)
            tally["both fail, same kind of error" if same else "fails one way only"] += 1
            bad += not same
            if not same:
                print(f"case {number}: by itself {alone.error or 'finished'}; in lanes {beside.error or 'finished'}")
            continue
        difference = float(np.abs(alone.solution.angle_rad - beside.solution.angle_rad).max())
        apart.append(difference)
        if difference <= 0.1 * TOLERANCE:
            tally["within a tenth of the tolerance"] += 1
        elif difference <= FACTOR * TOLERANCE:
            tally[f"within {FACTOR:g} tolerances"] += 1
        else:
            needed = difference / (FACTOR * TOLERANCE)
            found = growth(Runner(plausible(chosen.seed, number)), needed)
            explained = found >= needed
            tally["explained by growth" if explained else "not explained"] += 1
            bad += not explained
            print(f"case {number}: {difference:.2g} rad apart, growth {found:.3g} (of {needed:.3g} needed)", flush=True)
    print(f"{chosen.count} cases: by itself {spent[0]:.0f} s, in lanes {spent[1]:.0f} s of processor time")
    for what, n in tally.most_common():
        print(f"  {n:6d}  {what}")
    middle, most = np.quantile(apart, [0.5, 0.99]) / TOLERANCE
    print(f"  apart by {middle:.2g} tolerances in the median, {most:.2g} in 99 %, {max(apart) / TOLERANCE:.2g} at most")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
