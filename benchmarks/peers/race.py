"""Run every method at every tolerance, in turns, and keep the best time of each.

Methods take turns within a round, so that load from other programs affects all of them; long runs are repeated less
often. All but the slowest get one uncounted warm-up run.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.solvers import Answer, Solver

ENOUGH_S = 1.5  # a run that has taken this long in total is not repeated


@dataclass
class Row:
    """One method at one tolerance on one blow."""

    blow: str
    method: str
    ours: bool
    tolerance: float
    error_rad: float
    best_s: float
    repeats: int
    steps: int | None
    rejected: int | None
    rhs: int | None
    jacobians: int | None


@dataclass
class Entry:
    """A competing method: its name, solver and tolerances."""

    method: str
    ours: bool
    solver: Solver
    tolerances: tuple[float, ...]
    warm: bool = True  # one uncounted warm-up run


def race(
    blow: str,
    entries: Iterable[Entry],
    reference_rad: NDArray[np.float64],
    repeats: int,
    say: Callable[[str], None],
) -> list[Row]:
    """Run all entries on one blow; a peer that fails at a tolerance is reported through ``say`` and left out."""
    rows: list[Row] = []
    runs: list[tuple[Row, Solver]] = []
    for entry in entries:
        if entry.warm:
            with contextlib.suppress(RuntimeError, ArithmeticError):  # reported below, with its tolerance
                entry.solver(max(entry.tolerances))
        for tolerance in entry.tolerances:
            runs.append(
                (Row(blow, entry.method, entry.ours, tolerance, math.nan, math.inf, 0, *[None] * 4), entry.solver)
            )
    spent = {id(row): 0.0 for row, _ in runs}
    for number in range(repeats):
        for row, solver in runs:
            if number and (row.repeats == 0 or spent[id(row)] > ENOUGH_S):
                continue
            start = time.process_time()
            try:
                answer = solver(row.tolerance)
            except Exception as problem:
                if row.ours:
                    raise
                say(f"{blow}: {row.method} at {row.tolerance:.0e} failed: {problem}")
                continue
            took = time.process_time() - start
            spent[id(row)] += took
            row.best_s = min(row.best_s, took)
            row.repeats += 1
            if number == 0:
                _fill(row, answer, reference_rad)
    rows += [row for row, _ in runs if row.repeats]
    return rows


def _fill(row: Row, answer: Answer, reference_rad: NDArray[np.float64]) -> None:
    row.error_rad = float(np.abs(answer.angle_rad - reference_rad).max())
    row.steps, row.rejected, row.rhs, row.jacobians = answer.steps, answer.rejected, answer.rhs, answer.jacobians


def time_at_error(rows: list[Row], error_rad: float) -> float | None:
    """Time (s) in which a method reaches an error, interpolated on the log-log line between its best points.

    If even its cheapest run is more accurate, that run's time; None if no run is accurate enough.
    """
    best: list[tuple[float, float]] = []
    for row in sorted(rows, key=lambda r: r.best_s):
        if math.isfinite(row.error_rad) and row.error_rad > 0 and (not best or row.error_rad < best[-1][0]):
            best.append((row.error_rad, row.best_s))
    if not best or best[-1][0] > error_rad:
        return None
    errors, times = np.log([b[0] for b in best])[::-1], np.log([b[1] for b in best])[::-1]
    return float(np.exp(np.interp(math.log(error_rad), errors, times)))
