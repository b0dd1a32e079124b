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
from numpy.typing import NDArray

from model.batch.job import Job, Member, prepare_run, run_job
from model.codegen.load import load_lane_kernels
from model.errors import ModelError
from model.force_driven import ForceDrivenRun
from model.integrators.lanes import N_NUMBERS, N_WHOLE, compile_lane_loop
from model.integrators.methods import METHODS
from model.integrators.rosenbrock import integrate
from model.kernels import workspace as W
from model.kernels.lanes import LANES, allocate_aligned, has_wide_vectors
from model.kernels.layout import COUNTERS, Tables
from model.kernels.signatures import LaneMembers, LaneSpace
from model.scene.build import Scene
from model.simulation.run import Plan, Simulation, State

Array = NDArray[np.float64]


def _allocate_lane_space(n: int, n_parameters: int, remembers: bool, lanes: int) -> LaneSpace:
    return LaneSpace(
        allocate_aligned((W.WITH_MEMORY if remembers else W.LANE_SIZE) * lanes),
        allocate_aligned(n_parameters * lanes),
        allocate_aligned(N_NUMBERS * lanes),
        np.zeros(N_WHOLE * lanes, dtype=np.int64),
        np.zeros(W.SIZE),
        np.zeros((n, n + 1)),
    )


def _concatenate_tables(tables: Sequence[tuple[Array, ...]]) -> tuple[list[Array], list[int]]:
    """Tables of equal columns in one array a column, each table once, and where each starts."""
    keys = [tuple(map(id, table)) for table in tables]
    once = dict(zip(keys, tables, strict=True))
    starts = np.cumsum([0, *(len(table[0]) for table in once.values())]).tolist()
    place = dict(zip(once, starts, strict=False))
    return [np.concatenate(column) for column in zip(*once.values(), strict=True)], [place[key] for key in keys]


def advance_lanes(tables: Tables, plans: Sequence[Plan], lanes: int) -> list[tuple[float, float, int]]:
    """Carry out the ``plans`` of runs whose scenes have these tables, by one method, inputs linear.

    Returns
    -------
    list of (float, float, int)
        Time reached (s), next step to try (s) and status of each, as the step loop of a single run returns them.
    """
    if any(plan.method is not plans[0].method or plan.drive.held for plan in plans):
        raise ValueError("runs side by side need one method and inputs that are linear between their points")
    (time, value), first = _concatenate_tables([plan.drive[:2] for plan in plans])
    (wanted,), first_out = _concatenate_tables([(plan.out.time,) for plan in plans])
    count, n = len(plans), len(plans[0].span.angle)
    start = np.array(
        [(p.span.time, p.span.end, p.span.step, p.limits.rest, p.limits.longest_step, p.limits.angle, p.limits.speed)
         for p in plans]
    )  # fmt: skip
    place = np.array(
        [(at, len(plan.drive.time), out, len(plan.out.time), plan.limits.most_steps)
         for plan, at, out in zip(plans, first, first_out, strict=True)]
    )  # fmt: skip
    memory = np.array([plan.span.memory for plan in plans]).reshape(count, -1)
    members = LaneMembers(
        start,
        place,
        np.array([plan.scene.parameters for plan in plans]),
        np.array([plan.span.angle for plan in plans]),
        np.array([plan.span.speed for plan in plans]),
        memory,
        time,
        value,
        wanted,
        np.array([[rows.ctypes.data for rows in (plan.out.angle, plan.out.speed, plan.out.memory)] for plan in plans]),
        np.zeros((count, 3)),
        np.zeros(count, dtype=np.int64),
        np.zeros((count, len(COUNTERS)), dtype=np.int64),
    )
    scene = plans[0].scene
    compile_lane_loop(lanes)(
        members,
        scene.parent,
        scene.n_contacts,
        load_lane_kernels(tables, lanes),
        plans[0].method.coefficients,
        _allocate_lane_space(n, members.parameters.shape[1], members.memory.shape[1] > 0, lanes),
    )
    for i, plan in enumerate(plans):
        plan.span.angle[:], plan.span.speed[:] = members.angle[i], members.speed[i]
        plan.span.memory[:] = members.memory[i]
        plan.account.counters[:] += members.counters[i]
        plan.account.time_at_rest[0] += members.reached[i, 2]
    return [(float(t), float(h), int(s)) for (t, h, _), s in zip(members.reached, members.status, strict=True)]


# of one structure and method. Lanes win from 2 members on; loading what is compiled takes as long as 15 to 20 members
LEAST_MEMBERS = 16
UNIT = 64  # most members computed by one call: the last of them wait for each other in half-empty lanes
SUPPORTED = {"contact_forces"}  # outputs beyond angles and speeds


def can_run_in_lanes(job: Job) -> bool:
    if job.run is None or job.failure is not None or not set(job.run.outputs) <= SUPPORTED:
        return False
    return job.run.method in METHODS and METHODS[job.run.method].loop is integrate


Kind = tuple[object, ...]


def _lane_group_key(jobs: Sequence[Job]) -> list[Kind | None]:
    """What members of one unit share: method, structure, count of numbers (a string's modes); None: not for lanes."""
    of_scene: dict[int, Kind] = {}
    out: list[Kind | None] = []
    for job in jobs:
        if job.run is None or not can_run_in_lanes(job):
            out.append(None)
            continue
        scene = job.run.scene
        if id(scene) not in of_scene:
            tables = ((table.shape, table.tobytes()) for table in scene.tables)
            of_scene[id(scene)] = (scene.size, len(scene.vector), *tables)
        out.append((job.run.method, of_scene[id(scene)]))
    return out


def select_lane_jobs(jobs: Sequence[Job], lanes: bool | None) -> list[Job]:
    """The jobs, those for lanes marked: none of them, all that can, or by default where they are many of a kind."""
    if lanes is False or not has_wide_vectors():
        return list(jobs)
    kinds = _lane_group_key(jobs)
    count, least = Counter(kinds), 1 if lanes else LEAST_MEMBERS
    return [
        replace(job, in_lanes=True) if kind is not None and count[kind] >= least else job
        for job, kind in zip(jobs, kinds, strict=True)
    ]


def group_jobs(jobs: Sequence[Job], todo: Sequence[int], workers: int) -> list[list[int]]:
    """Indices of jobs in units of work: those in lanes with others of their kind, every other by itself."""
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
    """What sorts like members side by side, which touch and end at about the same time; those with more steps first.

    Longer ones come first, then those whose force goes up and down more often, then the stronger; the same force is
    looked at once, as ``known`` by its ``id``.
    """
    assert run is not None
    force = run.force_n
    if id(force) not in known:
        size = float(np.max(np.abs(force)))
        known[id(force)] = -round(float(np.sum(np.abs(np.diff(force)))) / max(size, 1e-300)), -size
    end = run.output_time_s[-1] if len(run.output_time_s) else run.time_s[-1]
    return -float(end - run.time_s[0]), *known[id(force)]


def warm_up_lanes(scene: Scene) -> None:
    """Load or compile the loop and the kernels of a structure for lanes."""
    load_lane_kernels(scene.tables, LANES)
    compile_lane_loop(LANES)


def run_job_group(jobs: Sequence[Job], hashes: Sequence[str] | None = None) -> list[Member]:
    """Members of a unit of work, for an executor; ``hashes`` of its jobs where they are known."""
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
    ends = {n: iter(advance_lanes(seated[0][1].scene.tables, plans, LANES)) for n, plans in alike.items()}
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
