"""Random actions regulated: which can be, and which cannot.

Each seed is an action: the printed or the regulated set, all its points and radii off by up to 0.05 to 0.5 mm (the
amplitude varies from action to action), masses within 5 %, felts within 20 %. Prints a line each. Each regulated action
is regulated once more, and must come back as it is ("turned again"). ``--scene`` regulates the same actions in these
scenes, one after the other.
"""

from __future__ import annotations

import math
import time
from collections import Counter

import numpy as np
from numpy.typing import NDArray

import model
from benchmarks.runner import Run
from model.regulation.measures import TARGETS, measure

Array = NDArray[np.float64]

TOLERANCE_MM = 0.02
BAD = ("off target", "turned again")


def random_action(seed: int) -> tuple[model.Action, float]:
    """An action and the amplitude (m) by which its geometry is off."""
    random = np.random.default_rng(seed)
    base = model.load_action("hirschkorn2004-regulated" if random.random() < 0.5 else "hirschkorn2004")
    off = float(np.exp(random.uniform(math.log(0.05e-3), math.log(0.5e-3))))
    values = {}
    for path, q in base.quantities.items():
        if q.unit == "m" and path.endswith((".x", ".y", ".radius")) and not path.startswith("drive"):
            values[path] = q.value + random.uniform(-off, off)
        elif path.endswith(".mass"):
            values[path] = q.value * (1.0 + random.uniform(-0.05, 0.05))
    for contact in range(1, 14):
        stiffer = 1.0 + random.uniform(-0.2, 0.2)
        for k in "abc":
            path = f"contact{contact:02d}.normal.{k}"
            values[path] = base[path] * stiffer
    return base.with_values(values), off


def regulated(scene: str, seed: int) -> list[str]:
    """What became of one action in a scene: the verdict, its set and how far it is off, words, seconds."""
    action, off = random_action(seed)
    action, start = model.load_scene(scene).apply_to(action), time.process_time()
    try:
        done = model.regulation.regulate(action)
        worst = max(abs(measure(done.action).value_m[t.name] - t.wanted_m) for t in TARGETS)
        verdict = "regulated" if 1e3 * worst <= TOLERANCE_MM else "off target"
        if model.regulation.regulate(done.action).action is not done.action:
            verdict = "turned again"
        words = f"worst {1e6 * worst:.1f} um, rail {1e3 * done.rest_rail_m:+.2f} mm"
    except model.ModelError as problem:
        verdict, words = "refused", str(problem).partition(": ")[2]
    return [verdict, f"+-{1e3 * off:.2f} mm {action.name}", words, f"{time.process_time() - start:.1f} s"]


def main(run: Run) -> bool:
    """Print a line for each action; whether what is regulated is on its targets and stays so."""
    seen: Counter[str] = Counter()
    seeds = run.seeds or range(run.count)
    keys = [(scene, seed) for scene in run.scene for seed in seeds]
    for (scene, seed), (verdict, what, words, taken) in run.cases(keys, regulated):
        seen[f"{scene}: {verdict}"] += 1
        print(f"{scene:15} {seed:4d} {what:36} {verdict:18} {taken:>8}  {words}", flush=True)
    print("\n".join(f"{count} {verdict}" for verdict, count in sorted(seen.items())))
    run.figure(
        "regulation", " / ".join(str(seen[f"{run.scene[0]}: {verdict}"]) for verdict in ("regulated", "refused"))
    )
    return not any(verdict.endswith(BAD) for verdict in seen)
