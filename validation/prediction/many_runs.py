"""Many runs of a model at once: side by side in vector lanes where the machine has them, one by one for a stand-in.

Conventions: runs share nothing but the model; results come in the order of the runs, None for one that cannot be
carried out. Lanes are asked for outright, however few the runs are: a run's numbers must not depend on what else has
to be computed, or a result that is kept would differ from one that is made again. Runs of another scene than the
model's are kept in answers to questions that always ask the same; a scene's lanes take longer to compile than twenty
runs, so few run one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from scipy.linalg import solveh_banded

import model
from model.batch.job import Job, make_jobs
from model.batch.lanes import select_lane_jobs
from model.batch.run import run_jobs
from model.errors import ModelError
from model.force_driven import ForceDrivenOptions
from validation.conventions import WORKERS, Array
from validation.errors import PredictionError
from validation.prediction.model_under_test import ModelUnderTest

SPACING_S = 6e-4  # an action does not follow what happens within a millisecond


def coarse_force(time_s: Array, force_n: Array, spacing_s: float = SPACING_S) -> tuple[Array, Array]:
    """Piecewise linear force (times (m,), s, values (m,), N) on every k-th sample time, at most ``spacing_s`` apart,
    and the last, closest to the samples by least squares; the table itself where its samples are too far apart.

    Conventions: straight lines between points, s and N. A sampled force bends at each of its samples, and no step of an
    integrator may cross a bend; an action does not follow what happens within a millisecond. The coarse force is the
    piecewise linear one that differs least from the samples (least squares), so that impulses over a few points are
    kept. Its angles differ from those of the full table by some hundredths of what the draws scatter
    (docs/explanation/uncertainty.md).

    Parameters
    ----------
    time_s : (n,), increasing
    force_n : (n,)
    spacing_s : float, largest distance of its points

    Returns
    -------
    (times, forces)
        (m,) each; the table itself where its samples are too far apart to be thinned.
    """
    every = int(spacing_s / float(np.median(np.diff(time_s))) * (1 + 1e-9)) if time_s.size > 1 else 1
    if every < 2 or time_s.size < 2 * every:
        return time_s, force_n
    knots = np.append(time_s[:-1:every], time_s[-1])
    count = knots.size
    left = np.clip(np.searchsorted(knots, time_s, side="right") - 1, 0, count - 2)
    right_share = (time_s - knots[left]) / (knots[left + 1] - knots[left])
    left_share = 1.0 - right_share

    def total(at_left: Array, at_right: Array) -> Array:
        return np.asarray(np.bincount(left, at_left, count) + np.bincount(left + 1, at_right, count), dtype=float)

    normal = np.zeros((2, count))  # upper diagonal and diagonal of the hat functions' normal equations
    normal[0, 1:] = np.bincount(left, left_share * right_share, count)[:-1]
    normal[1] = total(left_share**2, right_share**2)
    return knots, np.asarray(solveh_banded(normal, total(left_share * force_n, right_share * force_n)))


AT_ONCE, AT_ONCE_WHOLE = 32, 4  # runs whose results are held at one time; of those that give forces and energies, too
T = TypeVar("T")


@dataclass(frozen=True)
class Run:
    """One run: an action from its rest under a force table (s, N), at the output times (s), to a tolerance (rad).

    ``outputs`` beyond angles and speeds, as `model.simulate` names them; none but contact forces come out of lanes.
    """

    action: model.Action
    rest: model.RestState
    time_s: Array
    force_n: Array
    output_time_s: Array
    tolerance: float
    outputs: tuple[str, ...] = ()


def run_many(
    tested: ModelUnderTest, runs: Sequence[Run | None], use: Callable[[int, model.Solution], T]
) -> list[T | None]:
    """What ``use(index, solution)`` returns for each run, in their order; None for a run that is None or cannot be
    carried out.

    Parameters
    ----------
    tested : what simulates; a stand-in's function is called once for each run
    runs : None stands for a run that cannot be made
    use : given the place of a run and its solution, on a thread; what it returns is kept, the solution is not
    """
    out: list[T | None] = [None] * len(runs)
    todo = [i for i, run in enumerate(runs) if run is not None]
    at_once = AT_ONCE_WHOLE if any(run.outputs for run in runs if run is not None) else AT_ONCE
    with ThreadPoolExecutor(WORKERS) as pool:
        for first in range(0, len(todo), at_once):
            part = todo[first : first + at_once]
            found = _solutions(tested, [run for i in part if (run := runs[i]) is not None], pool)
            kept = pool.map(lambda i, solution: None if solution is None else use(i, solution), part, found)
            for i, value in zip(part, kept, strict=True):
                out[i] = value
    return out


def _solutions(tested: ModelUnderTest, runs: Sequence[Run], pool: Executor) -> list[model.Solution | None]:
    """Solution of each run, in their order, computed on ``pool``; None where the model refuses a run. Another error is
    raised."""
    if tested.own_model:
        members = run_jobs(_choose_jobs(tested.action, runs), executor=pool, workers=WORKERS)
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


def _choose_jobs(action: model.Action, runs: Sequence[Run]) -> list[Job]:
    """Job of each run, in their order: in vector lanes always for the scene of ``action``, for another scene only where
    the runs are many enough to compile them."""
    jobs, own = [_job(run) for run in runs], model.choice_of(action)
    mine = [model.choice_of(run.action) == own for run in runs]
    return [
        always if is_mine else many
        for is_mine, always, many in zip(
            mine, select_lane_jobs(jobs, lanes=True), select_lane_jobs(jobs, lanes=None), strict=True
        )
    ]


def _job(run: Run) -> Job:
    wanted: dict[str, Any] = dict.fromkeys(run.outputs, True)
    options = ForceDrivenOptions(tolerance=run.tolerance, output_time_s=run.output_time_s, **wanted)
    return make_jobs(run.action, {"": (run.time_s, run.force_n)}, {"": {}}, options, run.rest)[0]
