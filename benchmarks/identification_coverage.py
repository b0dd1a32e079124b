"""How often do the 95 % intervals of an identification hold the truth? Virtual experiments with random true parameters.

    python benchmarks/identification_coverage.py [--sessions 10] [--cells nothing,lacking] [--kinds forte,piano]
                                                 [--trials 5] [--free 5 | --asked friction,felt:contact02]
                                                 [--spread 0.5] [--seed 1] [--from-truth] [--results FILE] [--minutes M]

Cells: ``nothing``: the specimen is the model; what is free and the errors of force and encoders are drawn from
their priors, all frictions scatter from trial to trial. ``lacking``: the same on the bench with motor arm, balance
rail and shank, which the model lacks. ``--free N``: N laws drawn at random for each experiment are free, and all else
is as the model has it; ``--free 0``: those of ``--asked``, and all else is free, drawn, and fitted beside them. One
randomly drawn asked parameter is profiled in each experiment. ``--from-truth``: one fit that starts at the
truth, which shows whether sizes of noise are right, whatever the search. A line per experiment is kept in
``--results``; what it holds is not computed again, so that a long run can be stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.bench_strokes import BEFORE_S, BENCH, FINE, KINDS, command_n, record
from model.errors import ModelError
from rig.configuration.rig_file import load_rig
from rig.errors import RigError
from rig.session import EncoderInfo, ForceInfo, TrialData
from rig.simulated.bench.plant import ActionPlant, load_plant
from validation.errors import ValidationError
from validation.identification.estimates import IDENTIFIED, estimate_all
from validation.identification.fit import fit
from validation.identification.force_runs import ForceRuns
from validation.identification.identify import LEAST_EFFECT_RAD, held_columns
from validation.identification.minima import refine, search
from validation.identification.observations import ObservedTrial, observe
from validation.identification.problem import Problem
from validation.identification.scatter import lacking
from validation.identification.unknowns import FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL, Unknowns, unknowns
from validation.measurement.trial import measure
from validation.prediction.model_under_test import ModelUnderTest

RATE_HZ, DELAY_S, AFTER_S, TOLERANCE = 5000.0, 0.0024, 0.3, 1e-7
SCATTER = 0.02  # of every friction, from trial to trial
STRENGTH = 0.02
EFFECTS = ("balance_rail", "shank")
WILDEST = 2.5
LAWS = ("friction", "joint_friction", "damping", "stiffness", "springs")
SAME = ("seed", "spread", "kinds", "trials", "free", "asked", "from_truth")
RUNS = 2e-7  # rad, error of the runs of a fit


def drawn_truth(
    start: model.Action, free: Unknowns, spread: float, rng: np.random.Generator
) -> tuple[dict[str, float], model.Action]:
    """True z of every parameter, and the specimen."""
    z = {p.name: spread * float(np.clip(rng.standard_normal(), -WILDEST, WILDEST)) for p in free.moved}
    values: dict[str, float] = {}
    for p in free.moved:
        values |= p.values(start, z[p.name])
    return z, start.with_values(values)


def scattered(specimen: model.Action, rng: np.random.Generator) -> model.Action:
    """The specimen of one trial."""
    paths = [path for path in specimen.quantities if path.endswith("friction.A") and specimen[path] > 0]
    return specimen.with_values({p: specimen[p] * (1 + SCATTER * float(np.clip(rng.normal(), -3, 3))) for p in paths})


class Sensors:
    """Force and encoders with errors drawn once for all sessions of an experiment."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.config = load_rig("virtual").config
        f = self.config.force
        self.encoders = tuple(EncoderInfo.of(e) for e in self.config.encoders)
        self.gain = 1 + f.u_gain_relative * rng.standard_normal()
        self.delay_s = DELAY_S + f.u_group_delay_s * rng.standard_normal()
        self.preload_n = f.preload_n + f.u_preload_n * rng.standard_normal()
        self.turn = np.array([e.u_turn_relative for e in self.encoders]) * rng.standard_normal(len(self.encoders))
        self.change = np.array([e.u_change_rad for e in self.encoders]) * rng.standard_normal(len(self.encoders))

    def read(self, number: int, t: np.ndarray, force_n: np.ndarray, turn: np.ndarray, rng: Any) -> TrialData:
        """A trial of this force and these turns of key, whippen and hammer since rest."""
        order = [("key", "whippen", "hammer").index(e.name) for e in self.encoders]
        true = turn[:, order]
        read = true * (1 + self.turn) + self.change * (1 - np.exp(-np.abs(true) / 1e-3))
        per = np.array([e.rad_per_count for e in self.encoders])
        count = np.floor(read / per + rng.uniform(0, 1, len(per))).astype(np.int64)
        felt = np.interp(t - self.delay_s, t, force_n, left=force_n[0])
        noise = self.config.force.u_noise_n * rng.standard_normal(t.size)
        seen = (felt - self.preload_n) / self.gain + 0.3 + noise
        return TrialData(
            number=number, status="complete", started_utc="2026-11-22T09:00:00Z", simulated=True,
            sample_rate_hz=RATE_HZ, time_s=t, force_n=seen, force_raw=seen, motor_command_v=np.zeros(t.size),
            encoder_count=count - count[0], encoders=self.encoders,
            force_info=ForceInfo.of(self.config, DELAY_S), blow_start_s=BEFORE_S,
        )  # fmt: skip


def played(specimen: model.Action, kind: str, n: int, sensors: Sensors, rng: np.random.Generator) -> list[TrialData]:
    """Trials of one kind on a specimen that the model can be: its force is prescribed."""
    at, newton = KINDS[kind]
    out = []
    for number in range(1, n + 1):
        own = scattered(specimen, rng)
        t = np.arange(int((BEFORE_S + at[-1] + AFTER_S) * RATE_HZ)) / RATE_HZ
        corners = BEFORE_S + rng.uniform(0, 1e-3) + rng.uniform(0.99, 1.01) * np.array(at)
        force = sensors.preload_n + (1 + STRENGTH * rng.uniform(-1, 1)) * np.interp(t, corners, newton)
        rest = model.rest_state(own, force_n=sensors.preload_n)
        solution = model.simulate(own, t, force, tolerance=TOLERANCE, initial=rest)
        turn = (solution.angle_rad - rest.angle_rad)[:, [0, 1, 4]]
        out.append(sensors.read(number, t, force, turn, rng))
    return out


def played_on_bench(specimen: model.Action, kind: str, n: int, seed: int, rng: np.random.Generator) -> list[TrialData]:
    """Trials of one kind on the bench, with arm, rail and shank."""
    out = []
    shipped = load_plant(BENCH, seed, FINE * RATE_HZ, EFFECTS)
    for number in range(1, n + 1):
        own = shipped.choice.on(scattered(specimen, rng))
        plant = ActionPlant(own, shipped.choice, shipped.torque_per_volt_nm, {}, seed, FINE * RATE_HZ)
        edges = np.arange(int((BEFORE_S + 1.2 * KINDS[kind][0][-1] + AFTER_S) * RATE_HZ)) / RATE_HZ
        newton = (1 + STRENGTH * rng.uniform(-1, 1)) * command_n(kind, edges, np.random.default_rng([seed, 99]))
        plant.advance(np.repeat(newton / 12.0, FINE))
        out.append(record(plant.truth(), seed, number, RATE_HZ, 0.0))
    return out


@cache
def acting_laws(kinds: str) -> tuple[str, ...]:
    """Laws of the printed action that move an encoder in strokes of these kinds."""
    start, rng = model.load_action(), np.random.default_rng(0)
    free = unknowns(start, LAWS, ["*"])
    tested, sensors = ModelUnderTest(start, 1e-6), Sensors(rng)
    found = np.zeros(len(free.moved))
    for i, kind in enumerate(kinds.split(",")):
        data = played(start, kind, 1, sensors, rng)
        trials = observe(kind, i, [measure(d, None, tested.geometry_at(d.force_info.preload_n)) for d in data])
        (jacobian,) = ForceRuns(start, free.moved, trials).jacobian(np.zeros(found.size), range(found.size))
        found = np.maximum(found, np.abs(jacobian).max(axis=(0, 1)))
    return tuple(p.name for p, size in zip(free.asked, found, strict=False) if size > LEAST_EFFECT_RAD)


def freed(start: model.Action, options: argparse.Namespace, rng: np.random.Generator) -> Unknowns:
    """What is free in one experiment."""
    if not options.free:
        return unknowns(start, options.asked.split(","))
    some = rng.choice(acting_laws(options.kinds), options.free, replace=False)
    return unknowns(start, [str(name) for name in some], ["*"])


def force_errors(s: Sensors) -> dict[str, float]:
    """True errors of the force, in standard uncertainties."""
    f = s.config.force
    return {
        FORCE_GAIN: (s.gain - 1) / f.u_gain_relative,
        FORCE_LEVEL: (s.preload_n - f.preload_n) / f.u_preload_n,
        FORCE_DELAY: -(s.delay_s - DELAY_S) / f.u_group_delay_s,
    }


def truth_z(problem: Problem, truth: dict[str, float], sensors: Sensors) -> np.ndarray:
    """The true values (p,), errors of the force among them."""
    force = force_errors(sensors)
    return np.array([truth[p.name] if p.paths else force[p.name] for p in problem.unknowns.moved])


def experiment(cell: str, k: int, options: argparse.Namespace) -> dict[str, Any]:
    """One experiment as plain data; ``failed`` says why it has no estimates."""
    kinds = options.kinds.split(",")
    out: dict[str, Any] = {"cell": cell, "session": k} | {name: getattr(options, name) for name in SAME}
    rng = np.random.default_rng([options.seed, k, len(cell), options.free])
    start = model.load_action()
    free = freed(start, options, rng)
    truth, specimen = drawn_truth(start, free, options.spread, rng)
    sensors, seed, began = Sensors(rng), int(rng.integers(1, 10**6)), time.process_time()
    profiled = str(rng.choice([p.name for p in free.asked]))
    tested = ModelUnderTest(start, 1e-6)
    trials: list[ObservedTrial] = []
    try:
        for i, kind in enumerate(kinds):
            if cell == "lacking":
                data = played_on_bench(specimen, kind, options.trials, seed, rng)
            else:
                data = played(specimen, kind, options.trials, sensors, rng)
            measured = [measure(d, None, tested.geometry_at(d.force_info.preload_n)) for d in data]
            trials += observe(kind, i, measured)
        response = ForceRuns(start, (*free.moved, *free.held), trials, RUNS)
        problem = Problem(start, free, tuple(trials), response, held_columns(response, free))
        fits = (
            [refine(problem, fit(problem, truth_z(problem, truth, sensors)))]
            if options.from_truth
            else search(problem, 1, None, None)
        )
        fitted = fits[0]
        fit_s = time.process_time() - began
        found = estimate_all(problem, fitted, [] if options.from_truth else [profiled], lambda text: None)
    except (ModelError, RigError, ValidationError) as error:
        return out | {"failed": str(error)}
    rows = []
    for e in found:
        p = next(p for p in free.asked if p.name == e.name)
        true = p.physical(start, truth[e.name])
        rows.append(
            {
                "name": e.name, "true_z": truth[e.name], "z": e.z, "u": e.z_u, "u_lacking": e.u_form,
                "u_jackknife": e.u_jackknife, "inside": bool(e.low <= true <= e.high), "profiled": e.profiled,
                "interval": e.interval, "verdict": e.verdict,
            }
        )  # fmt: skip
    return out | {
        "estimates": rows, "converged": fitted.converged, "steps": sum(f.steps for f in fits), "fits": len(fits),
        "lacking": lacking(fitted),
        "processor_s": time.process_time() - began, "fit_s": fit_s,
    }  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Coverage by cell: of all, of those called identified, of those profiled."""
    out = [f"{'cell':10s} {'of':14s} {'intervals':>9s} {'hold':>5s} {'share':>6s} {'99 % interval':>16s}"]
    for cell in dict.fromkeys(r["cell"] for r in rows):
        here = [e for r in rows if r["cell"] == cell and "failed" not in r for e in r["estimates"]]
        kinds = {
            "all": here,
            "identified": [e for e in here if e["verdict"] == IDENTIFIED],
            "profiled": [e for e in here if e["profiled"]],
        }
        for name, some in kinds.items():
            if some:
                hold = sum(e["inside"] for e in some)
                low, high = stats.binomtest(hold, len(some)).proportion_ci(0.99, "exact")
                share = hold / len(some)
                out.append(f"{cell:10s} {name:14s} {len(some):9d} {hold:5d} {share:6.3f} {low:7.3f} to {high:.3f}")
        narrow = [e for e in here if e["u"] < 0.5]
        if narrow:
            off = np.sqrt(np.mean([((e["z"] - e["true_z"]) / e["u"]) ** 2 for e in narrow]))
            out.append(f"{cell:10s} root mean square of error over u, of those below half the prior: {off:.2f}")
            called = sum(e["verdict"] == IDENTIFIED for e in narrow)
            out.append(f"{cell:10s} interval below half the prior: {len(narrow)}, called identified {called}")
        told = [r for r in rows if r["cell"] == cell]
        failed = sum("failed" in r for r in told)
        settled = sum(r.get("converged", False) for r in told)
        out.append(f"{cell:10s} experiments {len(told)}, settled {settled}, could not be played or fitted {failed}")
    return "\n".join(out)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=10, help="experiments of each cell")
    parser.add_argument("--cells", default="nothing,lacking")
    parser.add_argument("--kinds", default="forte,piano")
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--free", type=int, default=5, help="laws that are free, all else known; 0: all of --asked")
    parser.add_argument("--asked", default="friction,joint_friction,felt:contact02")
    parser.add_argument("--spread", type=float, default=0.5, help="of the truth, in prior standard uncertainties")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--from-truth", action="store_true", help="no search: one fit that starts at the truth")
    parser.add_argument("--results", type=Path, help="file of outcomes, a JSON line per experiment")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="start none after this time")
    options = parser.parse_args()
    until = time.monotonic() + 60 * options.minutes
    kept: list[dict[str, Any]] = []
    if options.results is not None and options.results.exists():
        kept = [json.loads(line) for line in options.results.read_text(encoding="utf-8").splitlines()]
    kept = [r for r in kept if all(r.get(name) == getattr(options, name) for name in SAME)]
    done = {(r["cell"], r["session"]) for r in kept}
    for k, cell in product(range(options.sessions), options.cells.split(",")):
        if (cell, k) in done or time.monotonic() > until:
            continue
        kept.append(experiment(cell, k, options))
        if options.results is not None:
            with options.results.open("a", encoding="utf-8") as sheet:
                sheet.write(json.dumps(kept[-1]) + "\n")
    print(table(kept))
    return 0


if __name__ == "__main__":
    sys.exit(main())
