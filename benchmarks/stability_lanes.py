"""Do plausible actions, each with other parameters, come out of lanes as they come out of single runs?

    python -m benchmarks stability_lanes [--count 10000] [--seed 1] [--workers 2]

Set A of `stability`: geometry +-2 mm, everything else +-50 %, v_t 1e-2..1e-5, forces to 120 N with 0.2 ms edges,
401 output times, 1e-5 rad. Each case is run by itself and in lanes, beside whatever cases come next to it. A case
agrees where both finish and differ by at most a tenth of the tolerance, or both fail with the same error. Further
apart they must be within ten tolerances times the measured growth of a disturbance as large as the tolerance (the
largest one found in five moments and all coordinates; rounding is such a disturbance too, amplified by step control).
Wrong is a difference that growth does not explain, or a case that fails one way only.
"""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

import model
from benchmarks.runner import Run
from benchmarks.stability import FACTOR, OUTPUT_S, STEPS, TOLERANCE, Runner, plausible
from model import batch
from model.batch.lanes import choose
from model.simulation.options import ForceDrivenOptions

ONE_WAY, UNEXPLAINED = "fails one way only", "not explained"


def jobs_of(seed: int, count: int) -> list[batch.Job]:
    options = ForceDrivenOptions(tolerance=TOLERANCE, output_time_s=OUTPUT_S)
    action, out = model.load_action(), []
    for number in range(count):
        case = plausible(seed, number)
        out += batch.make_jobs(action, {str(number): (case.time_s, case.force_n)}, {"": case.overrides}, options)
    return out


def main(run: Run) -> bool:
    """Print how far lanes are from single runs; whether growth explains all differences."""
    jobs = jobs_of(run.seed, run.count)
    spent, runs = [], []
    for lanes in (False, True):
        marked = choose(jobs, lanes)
        batch.run_jobs(marked[:1])  # compile or load
        start = time.process_time()
        runs.append(batch.run_jobs(marked, workers=run.workers))
        spent.append(time.process_time() - start)
    tally: Counter[str] = Counter()
    apart = []
    for number, (alone, beside) in enumerate(zip(*runs, strict=True)):
        if alone.solution is None or beside.solution is None:
            same = type(alone.error) is type(beside.error)
            tally["both fail, same kind of error" if same else ONE_WAY] += 1
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
            runner, fine = Runner(plausible(run.seed, number)), TOLERANCE / 100.0
            found = runner.growth(runner.states(OUTPUT_S, fine, steps=10 * STEPS)[0], fine, needed, False)
            tally["explained by growth" if found >= needed else UNEXPLAINED] += 1
            print(f"case {number}: {difference:.2g} rad apart, growth {found:.3g} (of {needed:.3g} needed)", flush=True)
    print(f"{run.count} cases: by itself {spent[0]:.0f} s, in lanes {spent[1]:.0f} s of processor time")
    for what, n in tally.most_common():
        print(f"  {n:6d}  {what}")
    beyond = tally["explained by growth"] + tally[UNEXPLAINED]
    near = (tally[what] for what in ("within a tenth of the tolerance", f"within {FACTOR:g} tolerances"))
    counts = " / ".join(f"{n:,}" for n in (*near, beyond))
    run.figure("stability-lanes", f"{counts}; {spent[1]:.0f} s beside {spent[0]:.0f} s")
    middle, most = np.quantile(apart, [0.5, 0.99]) / TOLERANCE
    print(f"  apart by {middle:.2g} tolerances in the median, {most:.2g} in 99 %, {max(apart) / TOLERANCE:.2g} at most")
    return not tally[ONE_WAY] + tally[UNEXPLAINED]
