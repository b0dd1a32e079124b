"""Random actions regulated: which can be, which cannot, and whether a search of another kind agrees.

Each seed is an action: the printed or the regulated set, all its points and radii off by up to 0.05 to 0.5 mm (the
amplitude varies from action to action), masses within 5 %, felts within 20 %. Prints a line each. What `regulate`
refuses is searched by SciPy's least squares over all screws and the rest rail, from several starts. "missed": it found
screws that meet all targets. "confirmed": it did not, and it succeeds once the screw that the message names may go
further, or the target that the message names does not count. "unconfirmed": neither. The search takes minutes for an
action; ``--no-search`` says "refused" instead, and ``--seeds`` names those to search. With ``--again`` each regulated
action is regulated once more, and must come back as it is ("turned again"). ``--scene`` regulates the same actions in
these scenes, one after the other. Exits with 1 if an action was missed or an obstacle is unconfirmed.
"""

from __future__ import annotations

import math
import time
from collections import Counter

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import model
from benchmarks.runner import Run
from model.regulation.measures import TARGETS, measure
from model.regulation.measures import at_rest as rest_measures
from model.regulation.screws import REST_RAIL, SCREWS, limits

Array = NDArray[np.float64]

TOLERANCE_MM = 0.02
FURTHER_MM = 6.0  # for the named screw, when its obstacle is confirmed
DIFFERENCE_MM = 0.01
AT_REST, STARTS, NEAR_STARTS = 4, 14, 6
SPREAD_MM = 0.3, 1.2  # of the starts at rest, near and far
RAIL_MM = (0.0, -1.0, -2.0, -0.5, -3.0, -4.0)
LOST_MM = 20.0  # residual of what cannot be measured
ALL = (*SCREWS, REST_RAIL)
BAD = ("missed", "unconfirmed", "off target", "turned again")


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


class Search:
    """Least squares over all screws; ``free`` may go further, ``left_out`` does not count."""

    def __init__(self, action: model.Action, free: str = "", left_out: str = "") -> None:
        self.action = action
        ends = [1e3 * np.array(limits(action, s, 1e-3 * FURTHER_MM if s.path == free else 0.0)) for s in ALL]
        self.low, self.high = np.array(ends).T
        self.counts = np.array([t.name != left_out for t in TARGETS])

    def changed(self, turns_mm: Array) -> model.Action:
        """The action with its screws turned."""
        return self.action.with_values(
            {s.path: self.action[s.path] + 1e-3 * float(x) for s, x in zip(ALL, turns_mm, strict=True)}
        )

    def errors(self, turns_mm: Array, rest_only: bool = False) -> Array:
        """Errors of the seven targets, mm; those at rest only where only they are wanted."""
        try:
            changed = self.changed(turns_mm)
            found = rest_measures(changed) if rest_only else measure(changed).value_m
        except (model.StaticsError, model.InputError, model.IntegrationError):
            return np.full(AT_REST if rest_only else len(TARGETS), LOST_MM)
        wanted = TARGETS[:AT_REST] if rest_only else TARGETS
        e = np.array([1e3 * (found[t.name] - t.wanted_m) for t in wanted])
        return np.where(np.isfinite(e), e, LOST_MM) * self.counts[: len(e)]

    def _least(self, columns: list[int], turns: Array, rest_only: bool, most: int) -> Array:
        def errors(x: Array) -> Array:
            here = turns.copy()
            here[columns] = x
            return self.errors(here, rest_only)

        def slopes(x: Array) -> Array:
            e = errors(x)
            steps = np.where(x + DIFFERENCE_MM > self.high[columns], -DIFFERENCE_MM, DIFFERENCE_MM)
            return np.column_stack([(errors(x + step) - e) / step[j] for j, step in enumerate(np.diag(steps))])

        low, high = self.low[columns], self.high[columns]
        start = np.clip(turns[columns], low + 1e-6, high - 1e-6)
        found = least_squares(errors, start, slopes, bounds=(low, high), x_scale="jac", max_nfev=most, xtol=1e-9)
        out = turns.copy()
        out[columns] = found.x
        return out

    def succeeds(self, seed: int, in_motion: bool) -> bool:
        """Whether some position of the screws meets all targets that count."""
        random = np.random.default_rng(seed)
        for k in range(STARTS):
            turns = np.zeros(len(ALL))
            spread = SPREAD_MM[k >= NEAR_STARTS]
            turns[:AT_REST] = random.uniform(-spread, spread, AT_REST) * (k > 0)
            turns[[4, 5, 6]] += (1.0, 1.0, -1.0) if k % 2 else (0.0, 0.0, 0.0)
            turns[-1] = RAIL_MM[k % len(RAIL_MM)]
            if self.low[-1] > turns[-1]:
                turns[-1] = self.low[-1]
            turns = self._least([0, 1, 2, 3], turns, True, 40)
            if np.max(np.abs(self.errors(turns, True))) > TOLERANCE_MM:
                continue
            if not in_motion:
                return True
            for columns, most in (([4, 5], 12), ([6], 20), ([0, 1, 2, 3, 4, 5, 6], 4)):
                turns = self._least(columns, turns, False, most)
            if np.max(np.abs(self.errors(turns))) <= TOLERANCE_MM:
                return True
        return False


def judge(action: model.Action, refusal: str, seed: int) -> str:
    """What an independent search says of a refusal."""
    named = next((t for t in TARGETS if f"regulated: {t.words} " in refusal), None)
    in_motion = named is not None and named.measured_in != "rest"
    if Search(action).succeeds(seed, True):
        return "missed"
    screw = next((s.path for s in ALL if f"({s.path})" in refusal), "")
    if "would have to go" in refusal and Search(action, free=screw).succeeds(seed, in_motion):
        return "confirmed: screw"
    if named is not None and Search(action, left_out=named.name).succeeds(seed, in_motion):
        return "confirmed: target"
    return "unconfirmed"


def regulated(scene: str, seed: int, again: bool, search: bool) -> list[str]:
    """What became of one action in a scene: the verdict, its set and how far it is off, words, seconds."""
    action, off = random_action(seed)
    action, start = model.load_scene(scene).on(action), time.process_time()
    try:
        done = model.regulation.regulate(action)
        worst = max(abs(measure(done.action).value_m[t.name] - t.wanted_m) for t in TARGETS)
        verdict = "regulated" if 1e3 * worst <= TOLERANCE_MM else "off target"
        if again and model.regulation.regulate(done.action).action is not done.action:
            verdict = "turned again"
        words = f"worst {1e6 * worst:.1f} um, rail {1e3 * done.rest_rail_m:+.2f} mm"
    except model.ModelError as problem:
        words = str(problem).partition(": ")[2]
        verdict = judge(action, words, seed) if search else "refused"
    return [verdict, f"+-{1e3 * off:.2f} mm {action.name}", words, f"{time.process_time() - start:.1f} s"]


def main(run: Run) -> bool:
    """Print a line for each action; whether none was missed, and every obstacle is confirmed."""
    seen: Counter[str] = Counter()
    seeds = run.seeds or range(run.count)
    keys = [(scene, seed, run.again, not run.no_search) for scene in run.scene for seed in seeds]
    for (scene, seed, *_), (verdict, what, words, taken) in run.cases(keys, regulated):
        seen[f"{scene}: {verdict}"] += 1
        print(f"{scene:15} {seed:4d} {what:36} {verdict:18} {taken:>8}  {words}", flush=True)
    print("\n".join(f"{count} {verdict}" for verdict, count in sorted(seen.items())))
    run.figure(
        "regulation", " / ".join(str(seen[f"{run.scene[0]}: {verdict}"]) for verdict in ("regulated", "refused"))
    )
    return not any(verdict.endswith(BAD) for verdict in seen)
