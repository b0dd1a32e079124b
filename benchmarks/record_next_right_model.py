"""Does a further kind of stroke shrink the intervals as `identify` predicts, where the model lacks nothing?

    python benchmarks/record_next_right_model.py [--asked friction,joint_friction] [--fixed "*"] [--first forte]
                                                 [--next piano,double] [--trials 5] [--seed 1]

The specimen is the model with frictions drawn from their priors, played with the forces of `benchmarks.bench_strokes`,
its frictions scattering by 2 % from trial to trial, read by the virtual bench's sensors with their drawn errors
(`benchmarks.identification_coverage`). Identified on the first kind, each further kind is predicted from the identified
values, then played and identified together with the first. Printed: u over what it was, predicted with its limits and
realised; and realised where the u before is taken by the sizes of noise that both kinds together teach.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.identification_coverage import Sensors, drawn_truth, played
from rig.session import TrialData
from validation.identification.fit import Fitted, fit
from validation.identification.force_runs import ForceRuns
from validation.identification.further import Candidate, prospects
from validation.identification.identify import action_at
from validation.identification.noise import Marginal
from validation.identification.observations import ObservedTrial, observe
from validation.identification.problem import Problem
from validation.identification.unknowns import Unknowns, unknowns
from validation.measurement.trial import measure
from validation.prediction.model_under_test import ModelUnderTest

NEAR = 0.2


def observed(start: model.Action, kind: str, session: int, data: list[TrialData]) -> list[ObservedTrial]:
    """The trials as a fit sees them."""
    tested = ModelUnderTest(start, 1e-6)
    measured = [measure(d, None, tested.geometry_at(d.force_info.preload_n)) for d in data]
    return observe(kind, session, measured)


def fitted(start: model.Action, free: Unknowns, trials: list[ObservedTrial]) -> tuple[Problem, Fitted]:
    """The fit of some trials."""
    problem = Problem(start, free, tuple(trials), ForceRuns(start, free.moved, trials))
    return problem, fit(problem)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--asked", default="friction,joint_friction")
    parser.add_argument("--fixed", default="*", help="held parameters; empty for none")
    parser.add_argument("--first", default="forte")
    parser.add_argument("--next", default="piano,double")
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    start = model.load_action()
    free = unknowns(start, options.asked.split(","), tuple(filter(None, options.fixed.split(","))))
    _, specimen = drawn_truth(start, free, 0.5, rng)
    sensors = Sensors(rng)
    first = observed(start, options.first, 0, played(specimen, options.first, options.trials, sensors, rng))
    problem, before = fitted(start, free, first)
    here = action_at(start, free, before.z)
    u_before = np.sqrt(np.diag(before.covariance))
    asked = [p.name for p in free.asked]
    near = total = near_alike = inside = 0
    for kind in options.next.split(","):
        dry = played(here, kind, 1, sensors, np.random.default_rng(options.seed + 1))
        candidate = Candidate(kind, observed(start, kind, 0, dry)[0])
        (predicted,) = [p for p in prospects(problem, before, [candidate], options.trials)[0] if p.name == kind]
        new = observed(start, kind, 1, played(specimen, kind, options.trials, sensors, rng))
        _, after = fitted(start, free, [*first, *new])
        u_after = np.sqrt(np.diag(after.covariance))
        realised = u_after / u_before
        old = Marginal([b for b in after.marginal.blocks if b.session == 0], after.marginal.sizes)
        alike = u_after / np.sqrt(np.diag(old.covariance)[: len(u_after)])
        print(f"{options.trials} x {kind} after {options.trials} x {options.first}: u over u before", flush=True)
        for j, name in enumerate(asked):
            off = realised[j] / predicted.shrink[name] - 1
            near += abs(off) <= NEAR
            total += 1
            near_alike += abs(alike[j] / predicted.shrink[name] - 1) <= NEAR
            low, high = predicted.range(name)
            inside += low <= realised[j] <= high
            scatter = [f.marginal.sizes.scatter[j] for f in (before, after)]
            print(
                f"  {name:28s} {predicted.shrink[name]:6.3f} ({low:.2f} to {high:.2f}) {realised[j]:6.3f} "
                f"{100 * off:+6.0f} % "
                f"  by the later sizes {alike[j]:.3f}   scatter between trials {scatter[0]:.3f} -> {scatter[1]:.3f}"
            )
        print(
            f"  common {before.marginal.sizes.common.max():.3f} -> {after.marginal.sizes.common.max():.3f}, settled "
            f"{before.converged} {after.converged}",
            flush=True,
        )
    print(f"within {NEAR:.0%} of predicted: {near} of {total}; within the limits told: {inside} of {total}")
    print(f"within {NEAR:.0%} where the first u is taken by the later sizes of noise: {near_alike} of {total}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
