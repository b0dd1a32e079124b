"""Do plausible and absurd actions run with joints that give, and are they right?

    python benchmarks/stability_joints.py [--count 100] [--first 0] [--seed 1] [--set A|B] [--scene giving-joints]

The cases are those of `stability.py`, each with bushings of its own: stiffness 1e4 to 1e7 N/m, damping 0 to critical,
loads of up to 5 N. Right means here: the energy audit, integrated with the motion at 1e-9, closes to 1e-6 of what was
turned over (input and losses), and the angles at the tolerance 1e-5 stay within ten times that of those at 1e-9; a miss
counts as said where the estimated error says so.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.stability_cases import MAKERS, Case
from model.parameters.action import BODIES
from model.parameters.effects import PINS

TIGHT, LOOSE, MISS, CLOSES = 1e-9, 1e-5, 10.0, 1e-6


def bushings(case: Case, seed: int) -> dict[str, float]:
    """Numbers of the bushings of a case."""
    random, out = np.random.default_rng([seed, case.number]), {}
    action = model.load_action().with_values(case.overrides)
    for effect, body in PINS.items():
        stiffness = 10.0 ** random.uniform(4.0, 7.0)
        out[f"{effect}.stiffness"] = stiffness
        out[f"{effect}.damping"] = random.uniform(0.0, 2.0) * float(np.sqrt(stiffness * action[f"{body}.mass"]))
        out |= {f"{effect}.load.{axis}": random.uniform(-5.0, 5.0) for axis in "xy"}
    return out


def judge(case: Case, seed: int, choice: model.SceneChoice) -> str:
    """Outcome of one case in a word or two."""
    try:
        action = model.load_action().with_values(case.overrides).with_effects(bushings(case, seed))
        times, forces = model.check_force_table(case.time_s, case.force_n)
        initial = None
        if case.angle_rad is not None:
            lift = np.zeros(1 if "balance_rail" in choice.effects else 0)
            initial = model.State(
                float(times[0]), np.append(case.angle_rad, lift), np.append(case.speed_rad_per_s, lift)
            )
        fine = model.simulate(action, times, forces, scene=choice, tolerance=TIGHT, energy=True, initial=initial)
        coarse = model.simulate(action, times, forces, scene=choice, tolerance=LOOSE, initial=initial)
    except model.ModelError as problem:
        name = type(problem).__name__
        return f"{name} (expected)" if case.expect == name else f"{name}: {problem}"
    energy = fine.energy
    assert energy is not None
    turned = abs(energy.work_in) + energy.lost_in_felt + energy.lost_in_contact_friction + energy.lost_in_joint_friction
    turned += energy.lost_in_pins + energy.lost_in_rail
    if not abs(energy.residual) <= CLOSES * turned:
        return f"wrong: energy {abs(energy.residual) / turned:.1e}"
    error = float(np.max(np.abs(fine.angle_rad - coarse.angle_rad)[:, : len(BODIES)]))
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
    parser.add_argument("--scene", default="giving-joints")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    choice, outcomes, longest = model.load_scene(given.scene), Counter[str](), 0.0
    for number in range(given.first, given.first + given.count):
        began = time.process_time()
        word = judge(MAKERS[given.set](given.seed, number), given.seed, choice)
        longest = max(longest, time.process_time() - began)
        outcomes[word.split(":")[0]] += 1
        if ":" in word:
            print(f"  {given.set} {number}: {word}", flush=True)
    counts = ", ".join(f"{n} {word}" for word, n in outcomes.most_common())
    print(f"set {given.set}, {given.scene}: {counts}; longest case {longest:.1f} s of processor time")


if __name__ == "__main__":
    main()
