"""Jobs that run side by side in lanes: which can, how they are grouped, and their run.

A member's numbers are the same to the last bit whatever the other members of its unit are; a single run rounds in
another order (docs/explanation/lanes.md).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from model.batch.job import Job, Member, prepare_run, run_job
from model.errors import ModelError
from model.force_driven import ForceDrivenRun
from model.integrators.methods import METHODS
from model.integrators.rosenbrock import integrate
from model.kernels.lanes import LANES, has_wide_vectors
from model.simulation.lanes import advance_lanes, lane_kind
from model.simulation.run import Plan, Simulation, State

# of one structure and method. Lanes win from 2 members on; loading what is compiled takes as long as 15 to 20 members
LEAST_MEMBERS = 2 * LANES
UNIT = 64  # most members computed by one call: the last of them wait for each other in half-empty lanes
SUPPORTED = {"contact_forces"}  # outputs beyond angles and speeds


def can_run_in_lanes(job: Job) -> bool:
    if job.run is None or job.failure is not None or not set(job.run.outputs) <= SUPPORTED:
        return False
    return job.run.method in METHODS and METHODS[job.run.method].loop is integrate


Kind = tuple[object, ...]


def _lane_group_key(jobs: Sequence[Job]) -> list[Kind | None]:
    """For each job (method, structure of its scene), by which jobs can be integrated side by side; None for a job that
    cannot be."""
    of_scene: dict[int, Kind] = {}
    out: list[Kind | None] = []
    for job in jobs:
        if job.run is None or not can_run_in_lanes(job):
            out.append(None)
            continue
        scene = job.run.scene
        if id(scene) not in of_scene:
            of_scene[id(scene)] = lane_kind(scene)
        out.append((job.run.method, of_scene[id(scene)]))
    return out


def select_lane_jobs(jobs: Sequence[Job], lanes: bool | None) -> list[Job]:
    """The jobs in their order, with ``in_lanes`` set in copies of those to integrate side by side: none (``lanes``
    False, or no wide vectors), all that can be (True), those of which there are `LEAST_MEMBERS` of a kind (None)."""
    if lanes is False or not has_wide_vectors():
        return list(jobs)
    kinds = _lane_group_key(jobs)
    count, least = Counter(kinds), 1 if lanes else LEAST_MEMBERS
    return [
        replace(job, in_lanes=True) if kind is not None and count[kind] >= least else job
        for job, kind in zip(jobs, kinds, strict=True)
    ]


def group_jobs(jobs: Sequence[Job], todo: Sequence[int], workers: int) -> list[list[int]]:
    """Divide the jobs ``todo`` (indices) into units of work, lists of indices: those marked ``in_lanes`` with others of
    their kind, in units that keep ``workers`` threads equally busy; every other job alone."""
    alone: list[list[int]] = []
    groups: dict[Kind | None, list[int]] = defaultdict(list)
    for i, kind in zip(todo, _lane_group_key([jobs[i] for i in todo]), strict=True):
        if jobs[i].in_lanes:
            groups[kind].append(i)
        else:
            alone.append([i])
    together = []
    known: dict[int, tuple[float, float]] = {}
    for group in groups.values():
        group.sort(key=lambda i: (*_lane_sort_key(jobs[i].run, known), i))
        count = workers * -(-len(group) // (workers * UNIT))  # of units, so that workers end together
        row = min(LANES, -(-len(group) // count))  # whole ones: the last members of a unit leave lanes empty
        ends = [row * (-(-len(group) // row) * k // count) for k in range(count + 1)]
        together += [group[start:end] for start, end in pairwise(ends) if end > start]
    return together + alone


def _lane_sort_key(run: ForceDrivenRun | None, known: dict[int, tuple[float, float]]) -> tuple[float, ...]:
    """Sort key that puts similar members side by side: longer runs first, then more varying and stronger forces;
    ``known`` caches by force array."""
    assert run is not None
    force = run.force_n
    if id(force) not in known:
        size = float(np.max(np.abs(force)))
        known[id(force)] = -round(float(np.sum(np.abs(np.diff(force)))) / max(size, 1e-300)), -size
    end = run.output_time_s[-1] if len(run.output_time_s) else run.time_s[-1]
    return -float(end - run.time_s[0]), *known[id(force)]


def run_job_group(jobs: Sequence[Job], hashes: Sequence[str] | None = None) -> list[Member]:
    """Compute a unit of work, for an executor: members in the order of ``jobs``; ``hashes`` of the jobs (None: taken
    here)."""
    if hashes is None:
        known: dict[int, bytes] = {}
        hashes = [job.sha256(known) for job in jobs]
    if jobs[0].in_lanes:
        return run_lane_jobs(jobs, hashes)
    return [run_job(job, sha256) for job, sha256 in zip(jobs, hashes, strict=True)]


def run_lane_jobs(jobs: Sequence[Job], hashes: Sequence[str]) -> list[Member]:
    """Compute jobs of one kind side by side; members in the order of the jobs, each failure that of its own member."""
    members: list[Member | None] = [None] * len(jobs)
    seated: list[tuple[int, ForceDrivenRun, State, list[tuple[Simulation, Plan]]]] = []
    for i, job in enumerate(jobs):
        run, state = prepare_run(job)
        try:
            wanted = (False, True) if run.estimate_error else (False,)
            seated.append((i, run, state, [run.plan_run(state, companion=each) for each in wanted]))
        except ModelError as problem:
            members[i] = Member(job.trial, job.parameters, hashes[i], error=problem)
    alike: dict[int, list[Plan]] = defaultdict(list)  # a companion may have fewer modes of a string: fewer numbers
    for _, _, _, runs in seated:
        for _, plan in runs:
            alike[len(plan.scene.parameters)].append(plan)
    ends = {n: iter(advance_lanes(seated[0][1].scene.tables, plans)) for n, plans in alike.items()}
    for i, run, state, runs in seated:
        reached = [next(ends[len(plan.scene.parameters)]) for _, plan in runs]
        job, sha256 = jobs[i], hashes[i]
        try:
            motions = [one.accept_result(plan, *end) for (one, plan), end in zip(runs, reached, strict=True)]
            solution = run.solution(runs[0][0], *motions[0])
            if run.estimate_error:
                error = run.largest_difference(motions[0][0], motions[1][0])
                solution = replace(solution, error_rad=run.confirm_error(state, motions[0][0], error))
        except ModelError as problem:
            members[i] = Member(job.trial, job.parameters, sha256, error=problem)
            continue
        members[i] = Member(job.trial, job.parameters, sha256, solution)
    return [member for member in members if member is not None]
