"""Runs of one structure and method advanced together, several side by side in the lanes of one processor core.

In: plans of simulations (`Simulation.plan`); out: for each the time, next step and status that a step loop gives, and
state, outputs and counters filled in place as by the loop of a single run.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.derived.load import lane_kernels_of
from model.integrators.lanes import N_NUMBERS, N_WHOLE, loop_in_lanes
from model.kernels import workspace as W
from model.kernels.lanes import aligned
from model.kernels.layout import COUNTERS, Tables
from model.kernels.signatures import LaneMembers, LaneSpace
from model.simulation.run import Plan

Array = NDArray[np.float64]


def _space(n: int, n_parameters: int, remembers: bool, lanes: int) -> LaneSpace:
    return LaneSpace(
        aligned((W.WITH_MEMORY if remembers else W.LANE_SIZE) * lanes),
        aligned(n_parameters * lanes),
        aligned(N_NUMBERS * lanes),
        np.zeros(N_WHOLE * lanes, dtype=np.int64),
        np.zeros(W.SIZE),
        np.zeros((n, n + 1)),
    )


def _one_after_the_other(tables: Sequence[tuple[Array, ...]]) -> tuple[list[Array], list[int]]:
    """Tables of equal columns in one array a column, each table once, and where each starts."""
    keys = [tuple(map(id, table)) for table in tables]
    once = dict(zip(keys, tables, strict=True))
    starts = np.cumsum([0, *(len(table[0]) for table in once.values())]).tolist()
    place = dict(zip(once, starts, strict=False))
    return [np.concatenate(column) for column in zip(*once.values(), strict=True)], [place[key] for key in keys]


def advance_together(tables: Tables, plans: Sequence[Plan], lanes: int) -> list[tuple[float, float, int]]:
    """Carry out the ``plans`` of runs whose scenes have these tables, by one method, inputs linear.

    Returns
    -------
    list of (float, float, int)
        Time reached (s), next step to try (s) and status of each, as the step loop of a single run returns them.
    """
    if any(plan.method is not plans[0].method or plan.drive.held for plan in plans):
        raise ValueError("runs side by side need one method and inputs that are linear between their points")
    (time, value), first = _one_after_the_other([plan.drive[:2] for plan in plans])
    (wanted,), first_out = _one_after_the_other([(plan.out.time,) for plan in plans])
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
    loop_in_lanes(lanes)(
        members,
        scene.parent,
        scene.n_contacts,
        lane_kernels_of(tables, lanes),
        plans[0].method.coefficients,
        _space(n, members.parameters.shape[1], members.memory.shape[1] > 0, lanes),
    )
    for i, plan in enumerate(plans):
        plan.span.angle[:], plan.span.speed[:] = members.angle[i], members.speed[i]
        plan.span.memory[:] = members.memory[i]
        plan.account.counters[:] += members.counters[i]
        plan.account.time_at_rest[0] += members.reached[i, 2]
    return [(float(t), float(h), int(s)) for (t, h, _), s in zip(members.reached, members.status, strict=True)]
