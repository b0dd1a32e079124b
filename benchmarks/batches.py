"""Batches: trials per second, lanes beside scalar runs, parallel efficiency on two processors.

Forte trials of 3,501 rows that differ by up to 2 % in force, at 1e-4 rad, all angles and speeds at all rows. Runs
with one worker and with W workers alternate; the ratio is taken within a round, and the best and median rounds are
printed. Efficiency is the time of one worker over W times the time of W. Work outside the step loop holds Python's
global interpreter lock and limits thread scaling. Wall times are
meaningful only on an idle machine; the ratio of processor time to wall time is printed and approaches W when idle.
Lanes and scalar runs alternate on one worker, for members that are alike (those above) and unlike (four kinds of
blow, half to one and a half times as strong, in random order); the ratio is of processor times within a round.
Wrong is: a scalar member differs from a single run in any bit, or from a run at 1e-9 rad by more than 10 tolerances; or
95 % of the members in lanes differ from scalar runs by more than twice what the last digit of the force moves these
(step control amplifies rounding, in both alike).
"""

from __future__ import annotations

import time
from functools import partial

import numpy as np

import model
from benchmarks.peers.compiled import force_table
from benchmarks.runner import Run, Table
from model import batch
from model.batch.run import count_processors
from model.kernels.lanes import LANES, has_wide_vectors

TOLERANCE = 1e-4
TARGET_EFFICIENCY, TARGET_RATE = 0.90, 300.0
TARGET_RATIO = 2.75  # of scalar to lanes, with AVX-512


def trials(count: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    times, force = force_table("forte")
    scale = 1.0 + 0.02 * np.random.default_rng(7).uniform(-1.0, 1.0, count)
    return {f"{i:04d}": (times, force * s) for i, s in enumerate(scale)}


def unlike(count: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(11)
    out = {}
    for i in range(count):
        times, force = force_table(("forte", "piano", "double", "noisy")[int(rng.integers(4))])
        out[f"{i:04d}"] = times, force * rng.uniform(0.5, 1.5)
    return out


def timed(many: dict[str, tuple[np.ndarray, np.ndarray]], **how: object) -> tuple[float, float]:
    """Wall and processor time of a batch, s."""
    start, work = time.perf_counter(), time.process_time()
    members = model.simulate_many(model.load_action(), many, tolerance=TOLERANCE, **how)  # type: ignore[arg-type]
    seconds, work = time.perf_counter() - start, time.process_time() - work
    failed = [m for m in members if m.error is not None]
    if failed:
        raise SystemExit(f"member {failed[0].trial}: {failed[0].error}")
    return seconds, work


def check(many: dict[str, tuple[np.ndarray, np.ndarray]], workers: int) -> float:
    """Largest error (rad) of some members; exit with 1 if one differs from a single run."""
    action = model.load_action()
    members = model.simulate_many(action, many, tolerance=TOLERANCE, workers=workers, lanes=False)
    worst = 0.0
    for member in members[:: max(1, len(members) // 8)]:
        single = model.simulate(action, *many[member.trial], tolerance=TOLERANCE)
        if member.solution is None or not np.array_equal(member.solution.angle_rad, single.angle_rad):
            raise SystemExit(f"member {member.trial} differs from a single run")
        fine = model.simulate(action, *many[member.trial], tolerance=1e-9)
        worst = max(worst, float(np.abs(fine.angle_rad - member.solution.angle_rad).max()))
    if worst > 10 * TOLERANCE:
        raise SystemExit(f"error {worst:.2g} rad, allowed {10 * TOLERANCE:g}")
    return worst


def apart(one: list[batch.Member], other: list[batch.Member]) -> np.ndarray:
    """Largest difference of an angle (rad) of each member."""
    pairs = [(a.solution, b.solution) for a, b in zip(one, other, strict=True)]
    return np.array([np.abs(a.angle_rad - b.angle_rad).max() for a, b in pairs if a is not None and b is not None])


def lanes_beside_scalar(name: str, many: dict[str, tuple[np.ndarray, np.ndarray]], rounds: int) -> None:
    """Print how much faster lanes are on one worker, and by how much members differ from their scalar runs."""
    if not has_wide_vectors():
        print(f"{name:9}  no lanes: this processor has neither AVX-512 nor AVX2")
        return
    action = model.load_action()
    many_at = partial(model.simulate_many, action, tolerance=TOLERANCE, workers=1)
    scalar = many_at(many, lanes=False)
    distance = apart(scalar, many_at(many, lanes=True))
    rounded = {k: (times, force * (1.0 + 2.0**-52)) for k, (times, force) in many.items()}
    rounding = apart(scalar, many_at(rounded, lanes=False))
    typical = [float(np.quantile(one, 0.95)) for one in (distance, rounding)]
    if typical[0] > 2.0 * typical[1]:
        raise SystemExit(f"lanes are {typical[0]:.2g} rad from scalar runs, which rounding moves by {typical[1]:.2g}")
    spent = [[timed(many, workers=1, lanes=lanes) for lanes in (False, True)] for _ in range(rounds)]
    ratios = sorted(alone[1] / together[1] for alone, together in spent)
    best = [1e3 * min(r[k][1] for r in spent) / len(many) for k in (0, 1)]
    print(
        f"{name:9}  scalar {best[0]:.2f} ms, {LANES} lanes {best[1]:.2f} ms a member; ratio median "
        f"{ratios[len(ratios) // 2]:.2f}, lowest {ratios[0]:.2f}, highest {ratios[-1]:.2f} "
        f"({'reached' if ratios[len(ratios) // 2] >= TARGET_RATIO else 'missed'}: wanted {TARGET_RATIO})"
    )
    names = "lanes from scalar runs", "last digit of the force"
    for what, one in zip(names, (distance, rounding), strict=True):
        print(
            f"           {what}: {np.median(one) / TOLERANCE:.1g} tolerances in the median, 95 % "
            f"{np.quantile(one, 0.95) / TOLERANCE:.1g}, largest {one.max() / TOLERANCE:.1g}"
        )


def main(run: Run) -> None:
    """Print lanes beside scalar runs, efficiency on several workers, and what is spent beside the kernels."""
    count, workers = run.trials, run.workers
    many = trials(count)
    print(f"{count} forte trials at {TOLERANCE:g} rad on {workers} of {count_processors()} processors")
    print(f"largest error {check(many, workers):.2g} rad; members equal single runs to the last bit")
    lanes_beside_scalar("alike", many, run.rounds)
    lanes_beside_scalar("unlike", unlike(count), run.rounds)
    if run.only_lanes:
        return
    table = Table(
        "members:8s", "trials/s on 1:.0f", "on all:.0f", "efficiency best:.1%", "median:.1%", "reached:s",
        "ms on 1:.2f", "ms on all:.2f", "at work:.2f",
    )  # fmt: skip
    for name, lanes in (("scalar", False), ("in lanes", True)):
        alone, together = (partial(timed, many, workers=w, lanes=lanes) for w in (1, workers))
        together()
        rounds = [(alone(), together()) for _ in range(run.rounds)]
        efficiency = sorted(one[0] / (workers * more[0]) for one, more in rounds)
        rates = [count / min(r[k][0] for r in rounds) for k in (0, 1)]
        costs = [1e3 * min(r[k][1] for r in rounds) / count for k in (0, 1)]
        reached = "yes" if efficiency[-1] >= TARGET_EFFICIENCY and rates[1] >= TARGET_RATE else "no"
        at_work = max(more[1] / more[0] for _, more in rounds)
        table.row(name, *rates, efficiency[-1], efficiency[len(efficiency) // 2], reached, *costs, at_work)
    print(f"wanted {TARGET_RATE:.0f} trials/s and {TARGET_EFFICIENCY:.0%}")
