"""Many runs of a model at once: side by side in vector lanes where the machine has them, one by one for a stand-in.

Conventions: runs share nothing but the model; results come in the order of the runs, None for one that cannot be
carried out. Lanes are asked for outright, however few the runs are: a run's numbers must not depend on what else has
to be computed, or a result that is kept would differ from one that is made again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import model
from model.batch.job import Job, make_jobs
from model.batch.lanes import choose
from model.batch.run import run_jobs
from model.errors import ModelError
from model.force_driven import ForceDrivenOptions
from validation.conventions import WORKERS, Array
from validation.errors import PredictionError
from validation.prediction.model_under_test import ModelUnderTest

AT_ONCE = 96  # runs whose results are held at one time
T = TypeVar("T")


@dataclass(frozen=True)
class Run:
    """One run: an action from its rest under a force table (s, N), at the output times (s), to a tolerance (rad)."""

    action: model.Action
    rest: model.RestState
    time_s: Array
    force_n: Array
    output_time_s: Array
    tolerance: float


def run_many(
    tested: ModelUnderTest, runs: Sequence[Run | None], use: Callable[[int, model.Solution], T]
) -> list[T | None]:
    """Carry out runs and keep what is wanted of each.

    Parameters
    ----------
    tested : ModelUnderTest
        What simulates; a stand-in's function is called once for each run.
    runs : sequence of Run or None
        None stands for a run that cannot be made.
    use : callable
        Given the place of a run and its solution, on a thread; what it returns is kept, the solution is not.

    Returns
    -------
    list
        One for each run; None where it cannot be carried out.
    """
    out: list[T | None] = [None] * len(runs)
    todo = [i for i, run in enumerate(runs) if run is not None]
    with ThreadPoolExecutor(WORKERS) as pool:
        for first in range(0, len(todo), AT_ONCE):
            part = todo[first : first + AT_ONCE]
            found = _solutions(tested, [run for i in part if (run := runs[i]) is not None], pool)
            kept = pool.map(lambda i, solution: None if solution is None else use(i, solution), part, found)
            for i, value in zip(part, kept, strict=True):
                out[i] = value
    return out


def _solutions(tested: ModelUnderTest, runs: Sequence[Run], pool: Executor) -> list[model.Solution | None]:
    if tested.own_model:
        members = run_jobs(choose([_job(run) for run in runs], lanes=True), executor=pool, workers=WORKERS)
        defects = [m.error for m in members if m.error is not None and not isinstance(m.error, ModelError)]
        if defects:
            raise defects[0]
        return [member.solution for member in members]

    def one(run: Run) -> model.Solution | None:
        options = {"tolerance": run.tolerance, "output_time_s": run.output_time_s, "initial": run.rest}
        try:
            return tested.simulate(run.action, run.time_s, run.force_n, **options)
        except (ModelError, PredictionError):
            return None

    return list(pool.map(one, runs))


def _job(run: Run) -> Job:
    options = ForceDrivenOptions(tolerance=run.tolerance, output_time_s=run.output_time_s)
    return make_jobs(run.action, {"": (run.time_s, run.force_n)}, {"": {}}, options, run.rest)[0]
