"""Error against run time: our methods and other people's solvers on five blows.

    python benchmarks/work_precision.py [--quick] [--repeat 3] [--blow forte ...] [--plot docs/work_precision.svg]

Error: largest difference of any of the five angles, at 1 kHz, from the reference. Reference: compiled explicit Runge-Kutta of
order 8 at 1e-13, restarted at every force point; its difference from Rodas5P at 1e-12 is printed. Time: best of
``--repeat`` runs in this process, after a first one that compiles. Speed ratios are printed for the time each solver
needs for an error of 1e-5 and 2e-6 rad, interpolated between its runs. Exits with 1 when the references
differ by more than 1e-10 rad, or when an error of ours is more than 10 times the requested tolerance.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import model
from model.integrators import METHODS

sys.path.insert(0, str(Path(__file__).parent))
import peers  # noqa: E402
from blows import blows  # noqa: E402
from reference import explicit  # noqa: E402

OURS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


class Point(NamedTuple):
    blow: str
    solver: str
    tolerance: float
    error: float
    ms: float
    n_rhs: int
    n_steps: int
    n_rejected: int


def ours(method: str) -> Callable[[peers.Problem, np.ndarray, float], tuple[peers.Answer, int]]:
    def run(problem: peers.Problem, at: np.ndarray, tolerance: float) -> tuple[peers.Answer, int]:
        out = model.simulate(
            problem.action, problem.time, problem.force, tolerance=tolerance, output_time_s=at, method=method
        )
        c = out.counters
        rows = np.hstack([out.angle_rad, out.speed_rad_per_s])
        return peers.Answer(rows, int(c["n_rhs"]), int(c["n_steps"])), int(c["n_rejected"])

    return run


def contenders(quick: bool) -> tuple[dict[str, tuple[Callable, tuple[float, ...], bool]], list[str]]:
    """Solver, its tolerances, whether it runs on the forte only; and a line for each one left out."""
    out: dict[str, tuple[Callable, tuple[float, ...], bool]] = {m: (ours(m), OURS, False) for m in METHODS}
    missing = []
    library = peers.build_cvode()
    if isinstance(library, str):
        missing.append(f"skipped: CVODE from C: {library}")
    else:
        out["CVODE from C"] = (peers.cvode_from_c(library), (1e-5, 1e-6, 1e-7, 1e-8, 1e-9), False)
    try:
        import sksundae  # noqa: F401

        out["scikit-sundae CVODE"] = (peers.sundae, (1e-5, 1e-6, 1e-7, 1e-8), False)
    except ImportError:
        missing.append("skipped: scikit-sundae CVODE: not installed (pip install scikit-sundae)")
    out["SciPy LSODA"] = (peers.scipy_solver("LSODA"), (1e-5, 1e-6, 1e-7, 1e-8), False)
    if not quick:
        out["SciPy BDF"] = (peers.scipy_solver("BDF"), (1e-5, 1e-6), True)
        out["SciPy Radau"] = (peers.scipy_solver("Radau"), (1e-5, 1e-6), True)
        out["NumPy twin, LSODA"] = (peers.twin_lsoda, (1e-5,), True)
    return out, missing


def time_at_error(points: list[Point], error: float) -> float:
    """Milliseconds a solver needs for that error: along the lower envelope of its runs, log-log; NaN beyond them."""
    points = sorted(points, key=lambda p: p.ms)
    envelope = [p for i, p in enumerate(points) if all(p.error < q.error for q in points[:i])]
    errors = np.log([max(p.error, 1e-15) for p in envelope])[::-1]
    times = np.log([p.ms for p in envelope])[::-1]
    if len(envelope) == 0 or np.log(error) < errors[0]:
        return float("nan")
    return float(np.exp(np.interp(np.log(error), errors, times)))


def measure(names: list[str], quick: bool, repeat: int) -> tuple[list[Point], int]:
    action = model.load_action()
    solvers, missing = contenders(quick)
    print("\n".join(missing))
    bad, points = 0, []
    print(f"{'blow':11}{'solver':21}{'tolerance':>10}{'error rad':>11}{'ms':>10}{'rhs':>9}{'steps':>8}{'rejected':>10}")
    for blow in names:
        t, force = blows()[blow]
        rows = explicit(action, t, force)
        fine = model.simulate(action, t, force, tolerance=1e-12, method="rodas5p")
        apart = float(np.abs(rows[:, :5] - fine.angle_rad).max())
        print(f"{blow:11}references (explicit order 8, Rodas5P) differ by {apart:.1e} rad")
        bad += apart > 1e-10
        problem, at, truth = peers.Problem(action, t, force), t[::5], rows[::5, :5]
        for name, (run, tolerances, forte_only) in solvers.items():
            if forte_only and blow != "forte":
                continue
            run(problem, at[:2], tolerances[0])  # compile
            for tolerance in tolerances:
                best, rejected = float("inf"), -1
                for _ in range(repeat if "SciPy" not in name and "twin" not in name else 1):
                    start = time.perf_counter()
                    try:
                        answer = run(problem, at, tolerance)
                    except RuntimeError as problem_found:
                        print(f"{blow:11}{name:21}{tolerance:10.0e}  failed: {problem_found}")
                        break
                    best = min(best, time.perf_counter() - start)
                    if name in METHODS:
                        answer, rejected = answer
                else:
                    error = float(np.abs(answer.rows[:, :5] - truth).max())
                    point = Point(blow, name, tolerance, error, best * 1e3, answer.n_rhs, answer.n_steps, rejected)
                    points.append(point)
                    told = [str(k) if k >= 0 else "-" for k in point[5:]]
                    print(
                        f"{blow:11}{name:21}{tolerance:10.0e}{error:11.1e}{point.ms:10.2f}"
                        f"{told[0]:>9}{told[1]:>8}{told[2]:>10}",
                        flush=True,
                    )
                    if name in METHODS and error > 10 * tolerance + apart:
                        bad += 1
                        print(f"  error above ten times the requested {tolerance:g} rad")
    return points, bad


def ratios(points: list[Point], names: list[str]) -> None:
    solvers = list(dict.fromkeys(p.solver for p in points))
    print(f"\nms for an error of 1e-5 and of 2e-6 rad, and how many times the default method ({model.integrators.DEFAULT_METHOD})")
    for blow in names:
        for solver in solvers:
            cells = []
            for error in (1e-5, 2e-6):
                needed = [
                    time_at_error([p for p in points if p.blow == blow and p.solver == s], error)
                    for s in (solver, model.integrators.DEFAULT_METHOD)
                ]
                cells.append(f"{needed[0]:9.1f} ms {needed[0] / needed[1]:7.1f} x")
            if any("nan ms" not in c for c in cells):
                print(f"{blow:11}{solver:21}" + "   ".join(cells))


def draw(points: list[Point], names: list[str], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(names), figsize=(3.6 * len(names), 4.2), sharey=True, squeeze=False)
    for ax, blow in zip(axes[0], names, strict=True):
        for k, solver in enumerate(dict.fromkeys(p.solver for p in points)):
            mine = sorted((p for p in points if p.blow == blow and p.solver == solver), key=lambda p: p.tolerance)
            if mine:
                ax.loglog(
                    [p.error for p in mine], [p.ms for p in mine], marker="osDv^<>Xp*"[k % 10], label=solver,
                    lw=1.6 if solver in METHODS else 0.9, ms=4,
                )  # fmt: skip
        ax.set_title(blow)
        ax.set_xlabel("largest error of an angle / rad")
        ax.grid(alpha=0.3)
        ax.invert_xaxis()
    axes[0][0].set_ylabel("time for 0.6 s of motion / ms")
    handles = dict(zip(*reversed(axes[0][0].get_legend_handles_labels()), strict=True))
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncol=6, fontsize=8, frameon=False)
    figure.tight_layout(rect=(0, 0.1, 1, 1))
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
    print(f"drawn: {path}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="leave out the slowest peers")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--blow", nargs="+", choices=list(blows()), default=list(blows()))
    parser.add_argument("--plot", type=Path, default=None)
    chosen = parser.parse_args()
    print(f"numpy {np.__version__}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    points, bad = measure(chosen.blow, chosen.quick, chosen.repeat)
    ratios(points, chosen.blow)
    if chosen.plot is not None:
        draw(points, chosen.blow, chosen.plot)
    if bad:
        print(f"{bad} answers off")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
