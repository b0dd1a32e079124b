"""Do plausible and absurd actions run with felt that remembers and a string, and are they right?

    python benchmarks/stability_felt.py [--count 100] [--first 0] [--seed 1] [--set A|B]
                                        [--with hysteresis|stulov|string|all]

The cases are those of `stability.py`. Right means here: the energy audit, integrated with the motion at 1e-9, closes
to 1e-6 of what was turned over (input and losses), and the angles at the tolerance 1e-5 stay within ten times that of
those at 1e-9; a miss counts as said where the estimated error says so.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.stability_cases import MAKERS, Case
from model.parameters.action import CONTACTS
from model.scene.selection import SceneChoice

TIGHT, LOOSE, MISS = 1e-9, 1e-5, 10.0
CLOSES = 1e-6


def changed(action: model.Action, what: str) -> tuple[model.Action, SceneChoice]:
    """The action and the scene with what is under test; felt that softens keeps the thesis's law."""
    choice = SceneChoice(effects=("string",)) if what in ("string", "all") else SceneChoice()
    law = {"hysteresis": "hysteresis", "stulov": "stulov", "string": None, "all": "hysteresis"}[what]
    if law is None:
        return action, choice
    rises = [
        c for c in CONTACTS
        if action[f"{c}.normal.b"] >= 0.0
        or action[f"{c}.normal.b"] ** 2 <= 3.0 * action[f"{c}.normal.a"] * action[f"{c}.normal.c"]
    ]  # fmt: skip
    laws = {c: law for c in rises if not (choice.effects and c == "contact12")}
    if what == "all":
        laws |= {c: "stulov" for c in ("contact02", "contact04") if c in laws}
    return action.with_laws(laws), choice


def judge(case: Case, what: str) -> str:
    """Outcome of one case in a word or two."""
    try:
        action, choice = changed(model.load_action().with_values(case.overrides), what)
        times, forces = model.check_force_table(case.time_s, case.force_n)
        initial = None
        if case.angle_rad is not None:
            initial = model.State(float(times[0]), np.array(case.angle_rad), np.array(case.speed_rad_per_s))
        fine = model.simulate(
            action, times, forces, scene=choice, tolerance=TIGHT, energy=True, initial=initial, contact_forces=True
        )
        coarse = model.simulate(action, times, forces, scene=choice, tolerance=LOOSE, initial=initial)
    except model.ModelError as problem:
        return f"{type(problem).__name__}" + (" (expected)" if case.expect == type(problem).__name__ else "")
    energy = fine.energy
    assert energy is not None
    turned = abs(energy.work_in) + energy.lost_in_felt + energy.lost_in_contact_friction + energy.lost_in_joint_friction
    if not abs(energy.residual) <= CLOSES * turned:
        return f"wrong: energy {abs(energy.residual) / turned:.1e}"
    error = float(np.max(np.abs(fine.angle_rad - coarse.angle_rad)))
    if error <= MISS * LOOSE:
        return "right"
    told = model.simulate(
        action, times, forces, scene=choice, tolerance=LOOSE, initial=initial, estimate_error=True
    ).misses_tolerance
    return "right, a missed tolerance said" if told else f"missed silently: {error:.1e} rad"


def main() -> None:
    """Count outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", choices=["A", "B"], default="A")
    parser.add_argument("--with", dest="what", choices=["hysteresis", "stulov", "string", "all"], default="all")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    outcomes: Counter[str] = Counter()
    for number in range(given.first, given.first + given.count):
        word = judge(replace(MAKERS[given.set](given.seed, number)), given.what)
        outcomes[word.split(":")[0]] += 1
        if word.startswith(("wrong", "missed")):
            print(f"  {given.set} {number}: {word}")
    print(f"set {given.set}, {given.what}: " + ", ".join(f"{n} {word}" for word, n in outcomes.most_common()))


if __name__ == "__main__":
    main()
