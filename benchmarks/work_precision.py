"""Work-precision comparison: our integrators and their peers on the same equations and force tables.

Error is max |difference| over the five angles (rad), every 1 ms, from a reference made by two methods that share
neither the equations' code nor the algorithm: explicit order 8 at 1e-13 that steps to every force point, and our own
highest-order method at 1e-12; their difference is printed. Time is processor time, the best of several runs, all
methods taking turns; compilation is excluded and printed separately. A ratio is a method's time over that of our
default method at no larger error, interpolated on the log-log line between its points ("-": ours do not reach it).
Peers get the equations with all parameters compiled in as constants; missing peers are named and left out.
Wrong is: an error of ours exceeds twice its requested tolerance, or the references differ by more than 1e-9 rad.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

import model
from benchmarks.peers import solvers
from benchmarks.peers.compiled import BLOWS, CompiledEquations, CompiledJacobian, force_table, pack
from benchmarks.peers.solvers import Answer, Solver
from benchmarks.runner import Run, Table
from model.integrators.methods import DEFAULT_METHOD, METHODS

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
        with contextlib.suppress(RuntimeError, ArithmeticError):  # reported below, with its tolerance
            entry.solver(max(entry.tolerances))  # compiles
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


OUR_TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
PEERS: dict[str, tuple[Callable[[solvers.Task], solvers.Solver], tuple[float, ...]]] = {
    "CVODE from C with analytic J": (solvers.c_cvode, (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)),
    "SciPy odeint (LSODA)": (solvers.scipy_odeint, (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)),
}
QUICK_OURS = (1e-3, 1e-5)
TARGETS = (1e-4, 1e-5, 1e-6, 1e-7)
REFERENCE_TOLERANCE = (1e-13, 1e-12)
LARGEST_REFERENCE_DIFFERENCE = 1e-9
T = TypeVar("T")
OUTPUT_EVERY = 5  # points of the force table: 1 ms


def our_solver(task: solvers.Task, rest: model.RestState, method: str) -> solvers.Solver:
    def run(tolerance: float) -> solvers.Answer:
        s = model.simulate(
            task.action, task.time_s, task.force_n,
            tolerance=tolerance, method=method, initial=rest, output_time_s=task.output_s,
        )  # fmt: skip
        count = s.counters.get
        return solvers.Answer(s.angle_rad, count("n_steps"), count("n_rejected"), count("n_rhs"), count("n_jacobian"))

    return run


def table(rows: list[Row]) -> None:
    shown = Table(
        "blow:10s", "method:26s", "tolerance:9.0e", "error rad:9.1e", "ms:9.1f", "steps:7d", "rejected:d",
        "rhs:8d", "jacobians:d", "runs:d",
    )  # fmt: skip
    for r in rows:
        work = r.steps, r.rejected, r.rhs, r.jacobians, r.repeats
        shown.row(r.blow, r.method, r.tolerance, r.error_rad, 1e3 * r.best_s, *work)


def summary(rows: list[Row], blow: str, default: str) -> None:
    """Print milliseconds to reach a given error, and the ratio to our default method."""
    print(f"\n{blow}: ms to reach an error of (ratio to {default})")
    shown = Table("method:26s", *(text for e in TARGETS for text in (f"{e:.0e}:8.1f", "ratio:.2f")))
    of = {m: [r for r in rows if r.blow == blow and r.method == m] for m in dict.fromkeys(r.method for r in rows)}
    for method, own in of.items():
        cells: list[float | None] = []
        for target in TARGETS:
            own_s, our_s = time_at_error(own, target), time_at_error(of[default], target)
            cells += [own_s and 1e3 * own_s, own_s / our_s if own_s and our_s else None]
        if own:
            shown.row(method, *cells)


def check(rows: list[Row], differences: dict[str, float]) -> list[str]:
    """Failures: one line for each wrong result."""
    bad = [
        f"{r.blow}: {r.method} at {r.tolerance:.0e}: error {r.error_rad:.2e} rad, allowed {2 * r.tolerance:.0e}"
        for r in rows
        if r.ours and not r.error_rad <= 2 * r.tolerance
    ]
    return bad + [
        f"{blow}: the two references differ by {d:.1e} rad, allowed {LARGEST_REFERENCE_DIFFERENCE:.0e}"
        for blow, d in differences.items()
        if not d <= LARGEST_REFERENCE_DIFFERENCE
    ]


def first_call(action: model.Action) -> model.RestState:
    """Load or compile what a run needs; the rest state."""
    at_rest = model.rest_state(action)
    model.simulate(action, [0.0, 1e-3], [0.0, 0.0], initial=at_rest)
    return at_rest


def main(args: Run) -> bool:
    """Race all methods; whether our errors and the references are right."""
    blows = args.blow or list(BLOWS)
    names = args.peer or list(PEERS)

    def timed(what: str, work: Callable[[], T]) -> T:
        start = time.perf_counter()
        out = work()
        preparation[what] = time.perf_counter() - start
        return out

    preparation: dict[str, float] = {}
    action = model.load_action()
    rest = timed("ours, first call", partial(first_call, action))
    start = np.concatenate([rest.angle_rad, np.zeros(len(rest.angle_rad))])
    equations = timed("peers' equations, numba", partial(CompiledEquations, action))
    jacobian = timed("their Jacobian, numba", partial(CompiledJacobian, action))
    default = f"ours {DEFAULT_METHOD}"
    sharpest = max(METHODS.values(), key=lambda m: m.order).name
    rows: list[Row] = []
    differences: dict[str, float] = {}
    skipped: dict[str, str] = {}
    for blow in blows:
        t, f = force_table(blow)
        at = np.ascontiguousarray(t[::OUTPUT_EVERY])
        task = solvers.Task(action, equations, jacobian, t, f, pack(t, f), start, at)
        explicit, steps = equations.explicit(start, task.table, OUTPUT_EVERY, REFERENCE_TOLERANCE[0])
        reference = explicit[:, : len(rest.angle_rad)]
        other = our_solver(task, rest, sharpest)(REFERENCE_TOLERANCE[1])
        differences[blow] = float(np.abs(reference - other.angle_rad).max())
        print(
            f"{blow}: reference in {steps} explicit steps; {sharpest} at {REFERENCE_TOLERANCE[1]:.0e} "
            f"({other.steps} steps) differs by {differences[blow]:.1e} rad",
            flush=True,
        )
        ours = QUICK_OURS if args.quick else OUR_TOLERANCES
        entries = [Entry(f"ours {m}", True, our_solver(task, rest, m), ours) for m in METHODS]
        for name in names:
            factory, tolerances = PEERS[name]
            if name in skipped:
                continue
            try:
                solver = timed(f"{name}, {blow}", partial(factory, task))
            except solvers.Unavailable as reason:
                skipped[name] = str(reason)
                print(f"skipped: {name}: {reason}", flush=True)
                continue
            entries.append(Entry(name, False, solver, (1e-5,) if args.quick else tolerances))
        rows += race(blow, entries, reference, args.repeats, partial(print, flush=True))
    table(rows)
    for blow in blows:
        summary(rows, blow, default)
    print("not in the times, s: " + "; ".join(f"{k} {v:.2f}" for k, v in preparation.items() if v > 0.05))
    bad = check(rows, differences)
    for line in bad:
        print(f"WRONG  {line}")
    return not bad
