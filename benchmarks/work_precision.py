"""Work-precision comparison: our integrators and their peers on the same equations and force tables.

Run:  python benchmarks/work_precision.py [--quick] [--blow NAME] [--peer NAME] [--out DIAGRAM] [--json FILE]
Error is max |difference| over the five angles (rad), every 1 ms, from a reference made by two methods that share
neither the equations' code nor the algorithm: explicit order 8 at 1e-13 that steps to every force point, and our own
highest-order method at 1e-12; their difference is printed. Time is processor time, the best of several runs, all
methods taking turns; compilation is excluded and printed separately. A ratio is a method's time over that of our
default method at no larger error, interpolated on the log-log line between its points ("-": ours do not reach it).
Peers get the equations with all parameters compiled in as constants; missing peers are named and left out.
Exit code 1: an error of ours exceeds twice its requested tolerance, or the references differ by more than 1e-9 rad.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TypeVar

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # measure the checkout that contains this file

import numpy as np  # noqa: E402
from methods import COMPARISON  # noqa: E402
from peers import solvers, traced  # noqa: E402
from peers.compiled import CompiledEquations, pack  # noqa: E402
from peers.cvode_from_c import version  # noqa: E402
from peers.diagram import draw  # noqa: E402
from peers.equations import largest_deviation  # noqa: E402
from peers.forces import BLOWS, force_table  # noqa: E402
from peers.jacobian import CompiledJacobian  # noqa: E402
from peers.race import Entry, Row, add_ratios, race, time_at_error  # noqa: E402

import model  # noqa: E402
from model.integrators.methods import DEFAULT_METHOD, METHODS  # noqa: E402

OUR_TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
PEERS: dict[str, tuple[Callable[[solvers.Task], solvers.Solver], tuple[float, ...]]] = {
    "CVODE from C": (solvers.c_cvode, (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)),
    "CVODE from C, analytic J": (solvers.c_cvode_analytic, (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)),
    "scikit-sundae CVODE": (solvers.sundae_cvode, (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)),
    "CasADi CVODES": (traced.casadi_cvodes, (1e-4, 1e-5, 1e-6, 1e-7)),
    "diffrax Kvaerno5": (traced.diffrax_kvaerno5, (1e-4, 1e-6)),
    "SciPy odeint (LSODA)": (solvers.scipy_odeint, (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)),
    "SciPy LSODA": (solvers.scipy_lsoda, (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)),
    "SciPy BDF": (solvers.scipy_bdf, (1e-4, 1e-6)),
    "SciPy Radau": (solvers.scipy_radau, (1e-4, 1e-6)),
    "explicit DOP853, compiled": (solvers.explicit_dop853, (1e-4, 1e-6, 1e-8, 1e-10)),
    "plain NumPy, LSODA": (solvers.plain_numpy, (1e-4,)),
}
QUICK_OURS = (1e-3, 1e-5)
QUICK_PEERS = ("CVODE from C", "CVODE from C, analytic J", "scikit-sundae CVODE", "SciPy odeint (LSODA)")
ONCE = ("plain NumPy, LSODA", "diffrax Kvaerno5")  # slow: on the first blow only
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


def table(rows: list[Row]) -> str:
    lines = [
        f"{'blow':10} {'method':26} {'tolerance':>9} {'error rad':>9} {'ms':>9} {'ratio':>7} "
        f"{'steps':>7} {'rejected':>8} {'rhs':>8} {'jacobians':>9} {'runs':>4}"
    ]
    for r in rows:
        ratio = "-" if r.ratio is None else f"{r.ratio:.2f}"
        counts = ["-" if c is None else str(c) for c in (r.steps, r.rejected, r.rhs, r.jacobians)]
        lines.append(
            f"{r.blow:10} {r.method:26} {r.tolerance:9.0e} {r.error_rad:9.1e} {r.best_s * 1e3:9.1f} {ratio:>7} "
            f"{counts[0]:>7} {counts[1]:>8} {counts[2]:>8} {counts[3]:>9} {r.repeats:4d}"
        )
    return "\n".join(lines)


def summary(rows: list[Row], blow: str, default: str) -> str:
    """Milliseconds to reach a given error, and the ratio to our default method."""
    lines = [
        f"{blow}: ms to reach an error of (ratio to {default})",
        " " * 26 + "".join(f"{e:>18.0e}" for e in TARGETS),
    ]
    of = {m: [r for r in rows if r.blow == blow and r.method == m] for m in dict.fromkeys(r.method for r in rows)}
    for method, own in of.items():
        cells = []
        for target in TARGETS:
            own_s, our_s = time_at_error(own, target), time_at_error(of[default], target)
            ratio = "" if own_s is None or our_s is None else f"({own_s / our_s:.2f})"
            cells.append(f"{'-':>18}" if own_s is None else f"{own_s * 1e3:9.1f} {ratio:>8}")
        if own:
            lines.append(f"{method:26}" + "".join(cells))
    return "\n".join(lines)


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


def machine() -> dict[str, object]:
    cpu = platform.processor()
    if Path("/proc/cpuinfo").exists():
        names = [x for x in Path("/proc/cpuinfo").read_text().splitlines() if x.startswith("model name")]
        cpu = names[0].split(":", 1)[1].strip() if names else cpu
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {"cpu": cpu, "cores": os.cpu_count(), "load_1min": load, "python": platform.python_version()}


def parse(arguments: list[str] | None) -> argparse.Namespace:
    p = argparse.ArgumentParser(description="Error against run time: our integrators and their peers.")
    p.add_argument("--quick", action="store_true", help="one blow, few tolerances, quick peers; draws only with --out")
    p.add_argument("--blow", action="append", choices=BLOWS, help="only this blow (may be repeated)")
    p.add_argument("--only-ours", action="store_true", help="no peers")
    p.add_argument("--peer", action="append", choices=PEERS, help="only this peer (may be repeated)")
    p.add_argument("--repeats", type=int, default=None, help="rounds of runs (default 5, quick 2)")
    p.add_argument("--out", type=Path, help="diagram (default docs/work_precision.svg for a full run)")
    p.add_argument("--json", type=Path, help="also write all rows and the machine as JSON")
    METHODS.update(COMPARISON)  # raced beside the methods of the package, in this process only
    args = p.parse_args(arguments)
    args.repeats = args.repeats or (2 if args.quick else 5)
    return args


def first_call(action: model.Action) -> model.RestState:
    """Load or compile what a run needs; the rest state."""
    at_rest = model.rest_state(action)
    model.simulate(action, [0.0, 1e-3], [0.0, 0.0], initial=at_rest)
    return at_rest


def main(arguments: list[str] | None = None) -> int:
    args = parse(arguments)
    blows = args.blow or (["forte"] if args.quick else list(BLOWS))
    names = [] if args.only_ours else args.peer or list(QUICK_PEERS if args.quick else PEERS)
    here = machine() | ({"cvode": version()} if names else {})
    print(", ".join(f"{k} {v}" for k, v in here.items()), flush=True)

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
    deviation = largest_deviation(equations.accelerations, action, rest.angle_rad)
    print(f"peers' equations differ from the plain NumPy twin by {deviation:.1e} relative", flush=True)
    if not deviation < 1e-9:
        print("the peers' equations are not the model's", file=sys.stderr)
        return 1
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
            f"({other.steps} steps) differs by {differences[blow]:.1e} rad; peers' right-hand side "
            f"{equations.seconds_per_call(explicit, task.table) * 1e6:.2f} µs",
            flush=True,
        )
        off = jacobian.largest_deviation(equations, explicit[::23], task.table)
        print(f"{blow}: the analytic Jacobian differs from differences by {off:.1e} of its largest entry", flush=True)
        ours = QUICK_OURS if args.quick else OUR_TOLERANCES
        entries = [Entry(f"ours {m}", True, our_solver(task, rest, m), ours) for m in METHODS]
        for name in names:
            factory, tolerances = PEERS[name]
            if name in skipped or (name in ONCE and blow != blows[0]):
                continue
            try:
                solver = timed(f"{name}, {blow}", partial(factory, task))
            except solvers.Unavailable as reason:
                skipped[name] = str(reason)
                print(f"skipped: {name}: {reason}", flush=True)
                continue
            entries.append(Entry(name, False, solver, (1e-5,) if args.quick else tolerances, name not in ONCE))
        rows += race(blow, entries, reference, args.repeats, partial(print, flush=True))
    add_ratios(rows, default)
    print("\n" + table(rows) + "\n")
    for blow in blows:
        print(summary(rows, blow, default) + "\n")
    print("not in the times, s: " + "; ".join(f"{k} {v:.2f}" for k, v in preparation.items() if v > 0.05))
    bad = check(rows, differences)
    out = args.out or (
        None if args.quick or args.blow or args.peer or args.only_ours else ROOT / "docs" / "work_precision.svg"
    )
    if out is not None:
        draw(rows, blows, default, out)
        print(f"diagram: {out}")
    if args.json is not None:
        record = {
            "machine": here, "reference_difference_rad": differences, "skipped": skipped,
            "preparation_s": preparation, "failed": bad, "rows": [r.as_dict() for r in rows],
        }  # fmt: skip
        write_record(args.json, record)
    for line in bad:
        print(f"WRONG  {line}", file=sys.stderr)
    return 1 if bad else 0


def write_record(path: Path, record: dict[str, object]) -> None:
    """Write all rows and the machine as JSON."""
    record = {"made": datetime.now(UTC).isoformat(timespec="seconds"), "default_method": DEFAULT_METHOD, **record}
    path.write_text(json.dumps(_plain(record), indent=1) + "\n", encoding="utf-8")


def _plain(value: object) -> object:
    """Convert numbers for JSON: NumPy's to Python's, non-finite ones to None."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    sys.exit(main())
