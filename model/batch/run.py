"""Submit the jobs of a batch to an executor and collect their members, always in the order of the jobs.

By default on threads: kernels run without Python's global lock. Any ``concurrent.futures.Executor`` can take their
place (``ProcessPoolExecutor``, Dask's ``Client.get_executor()``). Only a few jobs are submitted ahead, so that an
interrupt has little to wait for. Members of a lost worker carry its error.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import TypeVar, Unpack

from numpy.typing import ArrayLike

from model.batch.job import Job, Member, make_jobs, run_job
from model.batch.store import Store
from model.errors import InputError
from model.kernels.codegen.load import energy_of, kernels_of
from model.parameters.action import Action
from model.simulation.options import ForceDrivenKeywords, ForceDrivenOptions
from model.simulation.statics import RestState

AHEAD = 4  # jobs submitted per worker
AHEAD_ELSEWHERE = 256  # to an executor that does not tell how many workers it has
POLL_S = 0.2  # an interrupt is noticed after this time at the latest, also where waiting cannot be interrupted

Trials = Mapping[str, tuple[ArrayLike, ArrayLike]] | Sequence[tuple[ArrayLike, ArrayLike]]
ParameterSets = Mapping[str, Mapping[str, float]] | Sequence[Mapping[str, float]]
T = TypeVar("T")
Progress = Callable[[int, int], None]


class BatchInterrupt(KeyboardInterrupt):
    """Ctrl-C during a batch; ``members`` holds those that were finished, None for the rest."""

    def __init__(self, members: list[Member | None]) -> None:
        super().__init__()
        self.members = members


def workers_here() -> int:
    """Processors this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _warm(jobs: Iterable[Job]) -> None:
    """Load or compile the kernels of every structure once, before each worker does."""
    seen = set()
    for job in jobs:
        if job.run is not None and id(job.run.scene) not in seen:
            seen.add(id(job.run.scene))
            kernels_of(job.run.scene.tables)
            if "energy" in job.run.outputs:
                energy_of(job.run.scene.tables)


def _submit(pool: Executor, job: Job, sha256: str) -> Future[Member]:
    """Submit a job; a future with the error where the executor accepts none (its workers are gone)."""
    try:
        return pool.submit(run_job, job, sha256)
    except Exception as problem:
        refused: Future[Member] = Future()
        refused.set_exception(problem)
        return refused


def run_jobs(
    jobs: Sequence[Job],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    store: str | Path | Store | None = None,
) -> list[Member]:
    """Compute jobs; members come in the order of the jobs. See `simulate_many`.

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
    if workers is not None and workers < 1:
        raise InputError(f"workers: found {workers}, allowed 1 or more")
    archive = Store(store) if isinstance(store, (str, Path)) else store
    if archive is not None and any(job.run is not None and "inside" in job.run.outputs for job in jobs):
        raise InputError("store: does not keep the inside view; allowed outputs contact_forces, energy")
    members: list[Member | None] = [None] * len(jobs)
    hashes = [job.sha256() if job.failure is None else "" for job in jobs]
    todo = []
    for i, job in enumerate(jobs):
        if job.failure is not None:
            members[i] = run_job(job, "")
        elif archive is not None:
            members[i] = archive.read(hashes[i], job.trial, job.parameters)
        if members[i] is None:
            todo.append(i)
    done = len(jobs) - len(todo)
    if progress is not None and done:
        progress(done, len(jobs))
    _warm(jobs[i] for i in todo)
    own = ThreadPoolExecutor(workers or workers_here()) if executor is None else None
    pool = executor or own
    assert pool is not None
    ahead = AHEAD * (workers or getattr(pool, "_max_workers", None) or AHEAD_ELSEWHERE // AHEAD)
    waiting: dict[Future[Member], int] = {}
    queue = iter(todo)

    def collect(future: Future[Member]) -> None:
        nonlocal done
        i = waiting.pop(future)
        try:
            member = future.result()
        except Exception as problem:  # a lost worker, an unexpected defect: it belongs to its member
            member = Member(jobs[i].trial, jobs[i].parameters, hashes[i], error=problem)
        members[i] = member
        done += 1
        if archive is not None:
            archive.write(member)
        if progress is not None:
            progress(done, len(jobs))

    try:
        for i in queue:
            waiting[_submit(pool, jobs[i], hashes[i])] = i
            while len(waiting) >= ahead:
                for future in wait(waiting, timeout=POLL_S, return_when=FIRST_COMPLETED).done:
                    collect(future)
        while waiting:
            for future in wait(waiting, timeout=POLL_S, return_when=FIRST_COMPLETED).done:
                collect(future)
    except KeyboardInterrupt:
        started = [future for future in waiting if not future.cancel()]
        progress = None
        for future in started:
            collect(future)
        if archive is not None:  # one may have been interrupted on its way there
            for member in members:
                if member is not None and not archive.path(member.sha256).exists():
                    archive.write(member)
        raise BatchInterrupt(members) from None
    finally:
        for future in waiting:
            future.cancel()
        if own is not None:
            own.shutdown(wait=True, cancel_futures=True)
    return [member for member in members if member is not None]


def _named(items: Mapping[str, T] | Sequence[T]) -> dict[str, T]:
    return dict(items) if isinstance(items, Mapping) else {str(i): item for i, item in enumerate(items)}


def simulate_many(
    action: Action,
    trials: Trials,
    parameter_sets: ParameterSets | None = None,
    *,
    initial: RestState | None = None,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    store: str | Path | Store | None = None,
    **keywords: Unpack[ForceDrivenKeywords],
) -> list[Member]:
    """Simulate every trial with every parameter set; each member is the same, to the last bit, as a single `simulate`.

    Parameters
    ----------
    action : parameter set that the others start from
    trials : force tables (times s, forces N) by name or in a row (then named by their index)
    parameter_sets : parameter path -> value for each set, by name or in a row; by default the action as it is
    initial : rest state to start from, as for `simulate`
    executor : where to compute; by default threads of this process
    workers : how many threads; by default one per processor this process may use
    progress : called with members done and members in all
    store : folder that keeps finished members; a batch that was interrupted goes on where it stopped
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
    jobs = make_jobs(
        action,
        _named(trials),
        {"": {}} if parameter_sets is None else _named(parameter_sets),
        ForceDrivenOptions(**keywords),
        initial,
    )
    return run_jobs(jobs, executor=executor, workers=workers, progress=progress, store=store)
