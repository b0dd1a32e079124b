"""Runs side by side in lanes: what may share them, and the step loop's call.

A run's numbers are the same to the last bit whatever the others are; a single run rounds in another order
(docs/explanation/lanes.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.codegen.load import load_lane_kernels
from model.integrators.lanes import N_NUMBERS, N_WHOLE, compile_lane_loop
from model.kernels import workspace as W
from model.kernels.lanes import LANES, allocate_aligned
from model.kernels.layout import COUNTERS, Tables
from model.kernels.signatures import LaneMembers, LaneSpace
from model.scene.build import Scene
from model.simulation.run import Plan

Array = NDArray[np.float64]


def lane_kind(scene: Scene) -> tuple[object, ...]:
    """What scenes side by side share: structure and count of numbers (a string's modes, pieces of a motion)."""
    return scene.size, len(scene.vector), *((table.shape, table.tobytes()) for table in scene.tables)


def _allocate_lane_space(n: int, n_parameters: int, remembers: bool, lanes: int) -> LaneSpace:
    """Zeroed arrays in which a lane loop works, for n coordinates and ``lanes`` members side by side."""
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


def advance_lanes(tables: Tables, plans: Sequence[Plan], lanes: int = LANES) -> list[tuple[float, float, int]]:
    """Integrate runs side by side, filling state, counters and outputs of ``plans``; (time, next step, status) of each.

    Scenes of all runs have these tables, one method, and inputs that are linear between their points.

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


def warm_up_lanes(scene: Scene) -> None:
    """Load or compile the loop and the kernels of a structure for lanes."""
    load_lane_kernels(scene.tables, LANES)
    compile_lane_loop(LANES)
