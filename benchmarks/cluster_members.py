"""A study of many members on a Dask cluster beside what the rate of one process predicts, and memory along it.

Members of a Sobol' study of 60 parameters of a forte, nine marks each. Predicted: processor time of a member in this
process, the median of ten units, times members over workers. The ratio by processor time (of workers and this process
over the same prediction times workers) says something on a busy machine, too; that by the clock on one at rest only.
Memory: largest resident set of a worker after a fifth of the members, and how much more each later one takes.
"""

from __future__ import annotations

import resource
import time

import numpy as np

import model
from benchmarks.runner import Run, Table
from model.screening import Variants, spreads
from model.screening.members import UNIT, Study

COUNT = 60


def used() -> tuple[float, float]:
    """Processor time, s, and largest resident set, MB, of a process."""
    return time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main(run: Run) -> bool:
    """Print the ratios; whether the study takes at most 1.15 of what is predicted, by processor time, memory flat."""
    import dask
    from dask.distributed import Client

    # with Dask's own 64 kB a worker gives memory back after every member and asks for it again: a third of its time
    kept = dict.fromkeys(("MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_"), 1 << 30)
    dask.config.set({"distributed.nanny.pre-spawn-environ": {**kept, "OPENBLAS_NUM_THREADS": 1}})

    action, blow = model.load_action(), model.force_table("forte")
    drawn = spreads(action, [path for path, q in action.quantities.items() if q.u > 0.0 and q.value != 0.0][:COUNT])
    variants, random = Variants(action, *blow, tuple(s.parameter for s in drawn)), np.random.default_rng(0)
    values = np.column_stack([s.at(random.random(run.members)) for s in drawn])
    variants.marks(values[:UNIT])  # compiles
    spent = []
    for k in range(10):
        began = time.process_time()
        variants.marks(values[k * UNIT : (k + 1) * UNIT])
        spent.append((time.process_time() - began) / UNIT)
    predicted = run.members * float(np.median(spent)) / run.workers
    early, rows = run.members // 5, []
    with Client(n_workers=run.workers, threads_per_worker=1, processes=True, dashboard_address=":0") as client:
        study = Study(executor=client.get_executor())
        study.run(variants, values[: UNIT * run.workers])  # each worker loads what is compiled
        for part in (values[:early], values[early:]):
            before, clock, mine = client.run(used), time.monotonic(), time.process_time()
            study.run(variants, part)
            wall, own, after = time.monotonic() - clock, time.process_time() - mine, client.run(used)
            rows.append((wall, own + sum(after[w][0] - before[w][0] for w in after), max(m for _, m in after.values())))
    wall, work = (sum(row[k] for row in rows) for k in (0, 1))
    each = 1024.0 * (rows[1][2] - rows[0][2]) / (run.members - early)
    table = Table(
        "members:d", "predicted s:.1f", "by the clock:.2f", "by processor time:.2f", "MB:.0f", "kB more each:.2f"
    )
    table.row(run.members, predicted, wall / predicted, work / (predicted * run.workers), rows[0][2], each)
    text = (
        f"{wall / predicted:.2f} by the clock, {work / (predicted * run.workers):.2f} by processor time; {each:.2f} kB"
    )
    run.figure(f"{run.members} members on Dask over what one process predicts; memory of a worker a member", text)
    return work <= 1.15 * predicted * run.workers and each < 1.0
