"""Stability stress test: thousands of random actions and forces; every one must finish right or fail by name.

    python benchmarks/stability.py [--count 10000] [--check 500] [--out failures/]
    python benchmarks/stability.py --replay failures/plausible_000123.json

Set "plausible": geometry within 2 mm, all else within 50 %, friction thresholds from 1e-5 to 1e-2 m/s, forces to 120 N with
0.2 ms edges, started at rest. Set "abuse": geometry within 50 %, damping or friction off, deep penetration and high speeds
at the start, thresholds to 1e-6 m/s, forces that are NaN or infinite. The default tolerance is used. ``--check`` of
each set are computed again at a hundredth of the tolerance: an angle further off than ten times the tolerance
is *sensitive* where a disturbance of the start as small as the finer tolerance grows as much, else *wrong*. Failures, wrong
and sensitive ones are saved as files that replay. Prints shares, worst run time and worst energy residual.
Exits with 1 on a wrong answer, an error that is not the model's own, a run above 60 s, or less than
99.9 % of the plausible set finished.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import model

TOLERANCE = 1e-5
END = 0.3  # s
LONGEST_RUN = 60.0  # s of wall time
MILLIMETRES = (".x", ".y", ".radius")


class Outcome(NamedTuple):
    """What became of one case."""

    kind: str  # finished, or the name of the error
    message: str
    seconds: float
    residual: float  # of the energy audit, share of the largest energy turned over
    error: float  # against a hundredth of the tolerance, rad; NaN where not checked
    growth: float  # of a small disturbance of the start; NaN where not looked at


def random_case(kind: str, seed: int) -> dict[str, Any]:
    """Parameters, force table and start of one case, as plain data."""
    random = np.random.default_rng([seed, kind == "abuse"])
    abuse = kind == "abuse"
    action = model.load_action()
    values: dict[str, float] = {}
    no_damping, no_friction = (abuse and random.random() < 0.3 for _ in range(2))
    for path, quantity in action.quantities.items():
        value, low, high = quantity.value, *model_range(path)
        if path == "friction_threshold.v_t":
            new = 10 ** random.uniform(-6 if abuse else -5, -2)
        elif path == "friction_threshold.omega_t":
            new = 10 ** random.uniform(-5 if abuse else -4, -1)
        elif path.endswith(MILLIMETRES) and ".normal." not in path:
            new = value * random.uniform(0.5, 1.5) if abuse else value + random.uniform(-2e-3, 2e-3)
        elif ".second.normal." in path or "arc_" in path:
            new = value
        else:
            new = value * random.uniform(0.5, 1.5)
        if no_damping and path.endswith("normal.D"):
            new = 0.0
        if no_friction and path.endswith("friction.A"):
            new = 0.0
        values[path] = float(np.clip(new, low + 1e-12 if low == 0 and value > 0 and not abuse else low, high))
    count = random.integers(3, 12)
    knots = np.round(random.uniform(0, END, count) / 2e-4).astype(int)
    times = np.unique(np.concatenate([[0], knots, knots + 1, [1505]])) * 2e-4
    if abuse and random.random() < 0.3:
        times = np.sort(np.append(times, times[1:-1] * (1 + 1e-15)))  # jumps, as near as a table can say
        times = times[np.append(True, np.diff(times) > 0)]
    forces = random.uniform(-5 if abuse else 0, 10 ** random.uniform(0, np.log10(120)), len(times))
    forces[0] = 0.0
    case: dict[str, Any] = {"kind": kind, "seed": seed, "values": values}
    if abuse:
        if random.random() < 0.02:
            forces[random.integers(len(forces))] = random.choice([np.nan, np.inf, -np.inf])
        case["angles"] = list(np.array([0.0286, 0.0251, 0.3198, 0.3523, 0.2951]) + random.normal(0, 0.05, 5))
        case["speeds"] = list(random.normal(0, 1, 5) * 10 ** random.uniform(-2, 1.5))
    case["time_s"], case["force_n"] = times.tolist(), forces.tolist()
    return case


def model_range(path: str) -> tuple[float, float]:
    """Smallest and largest value the parameter files allow."""
    from model.quantities import allowed_range

    low, high, _ = allowed_range(path)
    return low, high


def run_case(case: dict[str, Any], tolerance: float, nudge: float = 0.0) -> tuple[np.ndarray, float]:
    """Angles at the end and at 30 times before it, and the energy residual; raises what the model raises."""
    action = model.load_action().with_values(case["values"])
    if "angles" in case:
        angles, speeds = np.array(case["angles"]), np.array(case["speeds"])
    else:
        angles, speeds = model.rest_state(action).angle_rad, np.zeros(5)
    start = model.State(0.0, angles + nudge * np.array([1, -1, 1, -1, 1]), speeds)
    out = model.simulate(
        action, case["time_s"], case["force_n"], tolerance=tolerance, initial=start, energy=True,
        output_time_s=np.linspace(0, END, 31),
    )  # fmt: skip
    e = out.energy
    assert e is not None
    scale = abs(e.work_in) + abs(e.stored_change) + e.lost_in_felt + e.lost_in_contact_friction + 1e-3
    return out.angle_rad, abs(e.residual) / scale


def judge(job: tuple[str, int, bool]) -> tuple[str, int, Outcome]:
    """Run one case, and check it where asked to."""
    kind, seed, check = job
    case = random_case(kind, seed)
    nan = float("nan")
    begun = time.perf_counter()
    try:
        angles, residual = run_case(case, TOLERANCE)
    except model.ModelError as problem:
        return kind, seed, Outcome(type(problem).__name__, str(problem), time.perf_counter() - begun, nan, nan, nan)
    except Exception as problem:  # noqa: BLE001: anything else is a defect, and is reported as one
        return kind, seed, Outcome("DEFECT", repr(problem), time.perf_counter() - begun, nan, nan, nan)
    seconds = time.perf_counter() - begun
    if not np.all(np.isfinite(angles)):
        return kind, seed, Outcome("DEFECT", "angles are not finite", seconds, residual, nan, nan)
    error = growth = nan
    if check:
        try:
            fine, _ = run_case(case, TOLERANCE / 100)
            error = float(np.abs(angles - fine).max())
            if error > 10 * TOLERANCE:
                moved, _ = run_case(case, TOLERANCE / 100, nudge=TOLERANCE)
                growth = float(np.abs(moved - fine).max()) / TOLERANCE
        except model.ModelError as problem:
            return kind, seed, Outcome("finished", f"check: {problem}", seconds, residual, error, growth)
    return kind, seed, Outcome("finished", "", seconds, residual, error, growth)


def verdict(outcome: Outcome) -> str:
    """Finished, sensitive or wrong; else the name of the error."""
    if outcome.kind != "finished" or not outcome.error > 10 * TOLERANCE:
        return outcome.kind
    return "sensitive" if outcome.error <= 10 * TOLERANCE * max(outcome.growth, 0.0) else "wrong"


def report(kind: str, outcomes: dict[int, Outcome], out: Path) -> bool:
    """Print one set's figures, save what should be looked at; True where all is well."""
    verdicts = {seed: verdict(o) for seed, o in outcomes.items()}
    counts = Counter(verdicts.values())
    done = [o for o in outcomes.values() if o.kind == "finished"]
    checked = [o for o in done if not np.isnan(o.error)]
    share = len(done) / len(outcomes)
    print(f"{kind}: {len(outcomes)} cases, finished {share:.2%}; " + ", ".join(f"{k} {v}" for k, v in counts.most_common()))
    print(f"  run time: worst {max(o.seconds for o in outcomes.values()):.2f} s, median {np.median([o.seconds for o in outcomes.values()]) * 1e3:.1f} ms")
    residuals = np.array([o.residual for o in done])
    print(f"  energy residual: worst {residuals.max():.1e}, 99 % below {np.quantile(residuals, 0.99):.1e}, median {np.median(residuals):.1e}")
    if checked:
        errors = np.array([o.error for o in checked])
        print(
            f"  checked {len(checked)} at a hundredth of the tolerance: error median {np.median(errors):.1e}, 90 % below "
            f"{np.quantile(errors, 0.9):.1e}, above ten times the tolerance {np.mean(errors > 10 * TOLERANCE):.1%}, of these wrong "
            f"{counts['wrong']}"
        )
    for text, number in Counter(o.message.split(":")[-1].strip()[:90] for o in outcomes.values() if o.kind != "finished").most_common(6):
        print(f"  {number:6d} x {text}")
    for seed, v in verdicts.items():
        if v != "finished" and not (kind == "abuse" and v == "InputError"):
            out.mkdir(parents=True, exist_ok=True)
            content = {**random_case(kind, seed), "verdict": v, "message": outcomes[seed].message}
            (out / f"{kind}_{seed:06d}.json").write_text(json.dumps(content))
    slow = max(o.seconds for o in outcomes.values()) > LONGEST_RUN
    return not (counts["wrong"] or counts["DEFECT"] or slow or (kind == "plausible" and share < 0.999))


def replay(path: Path) -> int:
    """Run a saved case and print what becomes of it."""
    case = json.loads(path.read_text())
    print(f"{path.name}: saved as {case['verdict']} {case['message']}")
    for tolerance in (TOLERANCE, TOLERANCE / 100):
        try:
            angles, residual = run_case(case, tolerance)
            print(f"  tolerance {tolerance:g}: end {np.array2string(angles[-1], precision=7)} rad, energy residual {residual:.1e}")
        except model.ModelError as problem:
            print(f"  tolerance {tolerance:g}: {type(problem).__name__}: {problem}")
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="cases of each set")
    parser.add_argument("--check", type=int, default=500, help="of these, computed again at a hundredth of the tolerance")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path("stability_failures"))
    parser.add_argument("--replay", type=Path)
    chosen = parser.parse_args()
    if chosen.replay:
        return replay(chosen.replay)
    judge(("plausible", 0, False))  # compile before the workers start
    every = max(1, chosen.count // max(1, chosen.check))
    well = True
    with ProcessPoolExecutor(chosen.workers) as pool:
        for kind in ("plausible", "abuse"):
            begun = time.perf_counter()
            seeds = range(chosen.first, chosen.first + chosen.count)
            jobs = [(kind, s, chosen.check > 0 and s % every == 0) for s in seeds]
            outcomes = {seed: outcome for _, seed, outcome in pool.map(judge, jobs, chunksize=8)}
            well &= report(kind, outcomes, chosen.out)
            print(f"  {time.perf_counter() - begun:.0f} s with {chosen.workers} workers", flush=True)
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
