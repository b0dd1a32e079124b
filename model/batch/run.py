"""Submit the jobs of a batch to an executor and collect their members, always in the order of the jobs.

Only a few jobs are submitted ahead, so that an interrupt has little to wait for. Members of a lost worker carry its
error.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path
from typing import TypeVar, Unpack

from numpy.typing import ArrayLike

from model.batch.job import Job, Member, change_action, make_jobs_of_actions
from model.batch.lanes import group_jobs, run_job_group, select_lane_jobs
from model.batch.store import Store
from model.codegen.load import load_kernel, load_kernels
from model.errors import InputError
from model.force_driven import Recorded
from model.keywords import make_options
from model.parameters.action import Action, ActionLike
from model.simulation.lanes import warm_up_lanes
from model.simulation.options import BatchKeywords, BatchOptions
from model.simulation.statics import RestState

AHEAD = 4  # jobs submitted per worker
AHEAD_ELSEWHERE = 256  # to an executor that does not tell how many workers it has
POLL_S = 0.2  # an interrupt is noticed after this time at the latest, also where waiting cannot be interrupted

Trial = tuple[ArrayLike, ArrayLike] | Recorded
Trials = Mapping[str, Trial] | Iterable[Trial]
ParameterSets = Mapping[str, Mapping[str, float]] | Sequence[Mapping[str, float]]
T = TypeVar("T")
Progress = Callable[[int, int], None]


class BatchInterrupt(KeyboardInterrupt):
    """Ctrl-C during a batch; ``members`` holds those that were finished, None for the rest."""

    def __init__(self, members: list[Member | None]) -> None:
        super().__init__()
        self.members = members


def count_processors() -> int:
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _load_kernels(jobs: Iterable[Job]) -> None:
    """Load or compile the kernels of every structure once, before each worker does."""
    seen = set()
    for job in jobs:
        if job.run is not None and (id(job.run.scene), job.in_lanes) not in seen:
            seen.add((id(job.run.scene), job.in_lanes))
            if job.in_lanes:
                warm_up_lanes(job.run.scene)
                continue
            load_kernels(job.run.scene.tables)
            if "energy" in job.run.outputs:
                load_kernel(job.run.scene.tables, "energy")


def run_job_groups(
    todo: Iterable[Sequence[int]],
    submit: Callable[[Executor, Sequence[int]], Future[T]],
    finish: Callable[[Sequence[int], Future[T]], None],
    *,
    executor: Executor | None,
    workers: int | None,
    progress: Progress | None = None,
    count: tuple[int, int] = (0, 0),
) -> None:
    """``submit`` units (indices of members) to ``executor`` (None: own threads, ``workers`` or one a processor), a few
    ahead, and give each with its future to ``finish`` as they end; ``progress`` is called with members done and in all.

    Parameters
    ----------
    todo : indices of the members of each unit
    submit, finish : put a unit on an executor; take it and its future when that is done
    executor, workers : where to compute, as for `simulate_many`
    progress : called with members done and members in all
    count : members done already, and in all
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers: found {workers}, allowed 1 or more")
    done, total = count
    own = ThreadPoolExecutor(workers or count_processors()) if executor is None else None
    pool = executor or own
    assert pool is not None
    at_work = workers or getattr(pool, "_max_workers", None)
    ahead = AHEAD * at_work if at_work else AHEAD_ELSEWHERE
    waiting: dict[Future[T], Sequence[int]] = {}

    def collect() -> None:
        nonlocal done
        for future in wait(waiting, timeout=POLL_S, return_when=FIRST_COMPLETED).done:
            unit = waiting.pop(future)
            finish(unit, future)
            for _ in unit:
                done += 1
                if progress is not None:
                    progress(done, total)

    try:
        for unit in todo:
            waiting[submit(pool, unit)] = unit
            while len(waiting) >= ahead:
                collect()
        while waiting:
            collect()
    except KeyboardInterrupt:
        for future in [f for f in waiting if not f.cancel()]:
            finish(waiting.pop(future), future)
        raise
    finally:
        for future in waiting:
            future.cancel()
        if own is not None:
            own.shutdown(wait=True, cancel_futures=True)


def run_jobs(
    jobs: Sequence[Job],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    store: str | Path | Store | None = None,
) -> list[Member]:
    """Compute jobs on ``executor`` (None: ``workers`` threads, by default one a processor), or read them from the
    folder ``store``, which keeps new ones; ``progress`` gets done and all. Members, with their errors, in the order of
    jobs.

    Parameters
    ----------
    jobs : from `model.batch.make_jobs`
    executor : where to compute; by default threads of this process
    workers : how many threads; by default one per processor this process may use
    progress : called with members done and members in all
    store : folder that keeps finished members

    Returns
    -------
    list of Member
        One per job.

    Raises
    ------
    InputError : workers or store cannot be used
    BatchInterrupt : Ctrl-C; running members are finished and stored, the rest cancelled

    Examples
    --------
    >>> import model
    >>> from model.force_driven import ForceDrivenOptions
    >>> jobs = model.batch.make_jobs(model.load_action(), {"forte": model.force_table("forte")}, {"printed": {}},
    ...                              ForceDrivenOptions())
    >>> len(model.batch.run_jobs(jobs, workers=1))
    1
    """
    archive = Store(store) if isinstance(store, (str, Path)) else store
    if archive is not None and any(job.run is not None and "inside" in job.run.outputs for job in jobs):
        raise InputError("store: does not keep the inside view; allowed outputs contact_forces, energy")
    members: list[Member | None] = [None] * len(jobs)
    known: dict[int, bytes] = {}
    hashes = [""] * len(jobs)
    for i, job in enumerate(jobs):
        if job.failure is not None:
            members[i] = Member(job.trial, job.parameters, "", error=job.failure)
        elif archive is not None and job.run is not None:  # without one, each worker takes the hashes of its own jobs
            hashes[i] = job.sha256(known)
            members[i] = archive.read(hashes[i], job.trial, job.parameters, job.run.scene)
    todo = [i for i, member in enumerate(members) if member is None]
    done = len(jobs) - len(todo)
    if progress is not None and done:
        progress(done, len(jobs))
    _load_kernels(jobs[i] for i in todo)

    def submit(pool: Executor, unit: Sequence[int]) -> Future[list[Member]]:
        try:
            of_unit = None if archive is None else [hashes[i] for i in unit]
            return pool.submit(run_job_group, [jobs[i] for i in unit], of_unit)
        except Exception as problem:  # the executor accepts none: its workers are gone
            refused: Future[list[Member]] = Future()
            refused.set_exception(problem)
            return refused

    def finish(unit: Sequence[int], future: Future[list[Member]]) -> None:
        try:
            found = future.result()
        except Exception as problem:  # a lost worker, an unexpected defect: it belongs to its members
            found = [Member(jobs[i].trial, jobs[i].parameters, jobs[i].sha256(known), error=problem) for i in unit]
        for i, member in zip(unit, found, strict=True):
            members[i] = member
            if archive is not None:
                archive.write(member)

    at_work = max(1, workers or getattr(executor, "_max_workers", None) or count_processors())
    try:
        run_job_groups(
            group_jobs(jobs, todo, at_work),
            submit,
            finish,
            executor=executor,
            workers=workers,
            progress=progress,
            count=(done, len(jobs)),
        )
    except KeyboardInterrupt:
        if archive is not None:  # one may have been interrupted on its way there
            for member in members:
                if member is not None and not archive.path(member.sha256).exists():
                    archive.write(member)
        raise BatchInterrupt(members) from None
    return [member for member in members if member is not None]


def _label_items(items: Mapping[str, T] | Iterable[T]) -> dict[str, T]:
    """By the names given, by the numbers of recorded trials, or by their index."""
    if isinstance(items, Mapping):
        return dict(items)
    return {str(getattr(item, "number", i)): item for i, item in enumerate(items)}


def simulate_many(
    action: ActionLike,
    trials: Trials,
    parameter_sets: ParameterSets | None = None,
    *,
    initial: RestState | None = None,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    store: str | Path | Store | None = None,
    **keywords: Unpack[BatchKeywords],
) -> list[Member]:
    """Simulate every trial (times s, forces N, or a record) with every parameter set (path -> value; None: the action
    as it is); members by set, then trial, each with its solution or error; read from and kept in the folder ``store``.

    A member computed by itself is the same, to the last bit, as a single `simulate`. Many members of one structure are
    advanced side by side in the lanes of the processor's vector registers, about four times as fast with AVX-512: then
    a member is the same, to the last bit, whatever its neighbours, executor and processor, and differs from a
    single run by rounding, which the motion may make larger: far less than the tolerance, or than the run's own error.

    Parameters
    ----------
    action : parameter set that the others start from
    trials : force tables (times s, forces N) by name or in a row (then named by their index); or recorded trials, such
        as a session, each under its corrected force from rest under its preload (named by their numbers)
    parameter_sets : parameter path -> value for each set, by name or in a row; by default the action as it is
    initial : rest state to start from, as for `simulate`
    executor : where to compute; by default threads of this process
    workers : how many threads; by default one per processor this process may use
    progress : called with members done and members in all
    store : folder that keeps finished members; a batch that was interrupted goes on where it stopped
    lanes : advance members side by side; by default where at least `model.batch.lanes.LEAST_MEMBERS` have one
        structure, never without AVX2 or for members that ask for ``energy`` or ``inside``
    tolerance, output_time_s, scene, method, contact_forces, energy, inside, estimate_error : as for `simulate`

    Returns
    -------
    list of Member
        One per parameter set and trial, trials running fastest. What failed has an ``error`` instead of a
        ``solution``; nothing is left out.

    Raises
    ------
    InputError : scene, workers or store cannot be used
    BatchInterrupt : Ctrl-C, a `KeyboardInterrupt`; running members are finished and stored, the rest cancelled

    Examples
    --------
    >>> import model
    >>> blow = model.force_table("forte")
    >>> sets = {"printed": {}, "heavy": {"hammer.mass": 0.0125}}
    >>> members = model.simulate_many(model.load_action(), {"forte": blow}, sets)
    >>> [(member.trial, member.parameters, member.error) for member in members]
    [('forte', 'printed', None), ('forte', 'heavy', None)]
    """
    options = make_options(BatchOptions, "model.simulate_many", keywords)
    sets = {"": {}} if parameter_sets is None else _label_items(parameter_sets)
    for label, values in sets.items():
        if not isinstance(values, Mapping):
            raise InputError(
                f"parameter_sets: {label!r}: found {type(values).__name__}, allowed path -> value for each set, "
                'such as [{"hammer.mass": 0.011}, {"hammer.mass": 0.012}]'
            )
    actions = change_action(action, sets)
    jobs = make_jobs_of_actions(actions, _label_items(trials), options, initial)
    members = run_jobs(
        select_lane_jobs(jobs, options.lanes), executor=executor, workers=workers, progress=progress, store=store
    )
    used = {label: one for label, one in actions.items() if isinstance(one, Action)}
    return [
        m if m.solution is None else replace(m, solution=replace(m.solution, action=used[m.parameters]))
        for m in members
    ]
