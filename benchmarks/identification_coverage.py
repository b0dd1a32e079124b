"""How often do the 95 % intervals of an identification hold the truth? Virtual experiments with random true parameters.

    python -m benchmarks identification_coverage [--sessions 10] [--cells nothing,lacking] [--kinds forte,piano]
                                                 [--trials 5] [--free 5 | --asked friction,felt:contact02]
                                                 [--spread 0.5] [--seed 1] [--from-truth] [--results FILE]

Cells: ``nothing``: the specimen is the model; what is free and the errors of force and encoders are drawn from
their priors, all frictions scatter from trial to trial. ``lacking``: the same on the bench with motor arm, balance
rail and shank, which the model lacks. ``--free N``: N laws drawn at random for each experiment are free, and all else
is as the model has it; ``--free 0``: those of ``--asked``, and all else is free, drawn, and fitted beside them. One
randomly drawn asked parameter is profiled in each experiment. ``--from-truth``: one fit that starts at the
truth, which shows whether sizes of noise are right, whatever the search.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import Any

import numpy as np

import model
from benchmarks.bench_strokes import BEFORE_S, BENCH, FINE, KINDS, command_n, record
from benchmarks.runner import Run, Table, interval, may_be
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
        """A trial of this force and these turns (n, 5) since rest."""
        true = turn[:, [model.BODIES.index(e.name) for e in self.encoders]]
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


def played(
    specimen: model.Action, kind: str, n: int, sensors: Sensors, rng: np.random.Generator, read: Any = None
) -> list[Any]:
    """Trials of one kind on a specimen that the model can be: its force is prescribed.

    ``read`` makes a trial of its number, times, force and turns (n, 5) since rest; by default the sensors do.
    """
    at, newton = KINDS[kind]
    out = []
    for number in range(1, n + 1):
        own = scattered(specimen, rng)
        t = np.arange(int((BEFORE_S + at[-1] + AFTER_S) * RATE_HZ)) / RATE_HZ
        corners = BEFORE_S + rng.uniform(0, 1e-3) + rng.uniform(0.99, 1.01) * np.array(at)
        force = sensors.preload_n + (1 + STRENGTH * rng.uniform(-1, 1)) * np.interp(t, corners, newton)
        rest = model.rest_state(own, force_n=sensors.preload_n)
        turn = model.simulate(own, t, force, tolerance=TOLERANCE, initial=rest).angle_rad - rest.angle_rad
        out.append((read or sensors.read)(number, t, force, turn, rng))
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
def tested() -> ModelUnderTest:
    """The printed action under test."""
    return ModelUnderTest(model.load_action(), 1e-6)


def observed(kind: str, session: int, data: Sequence[TrialData]) -> list[ObservedTrial]:
    """Trials as a fit sees them."""
    return observe(kind, session, [measure(d, None, tested().geometry_at(d.force_info.preload_n)) for d in data])


def problem_of(start: model.Action, free: Unknowns, trials: Sequence[ObservedTrial]) -> Problem:
    """The fit of these trials."""
    response = ForceRuns(start, (*free.moved, *free.held), trials, RUNS)
    return Problem(start, free, tuple(trials), response, held_columns(response, free))


def acting(start: model.Action, free: Sequence[Any], kinds: Sequence[str]) -> tuple[str, ...]:
    """Those of the parameters that move an encoder in strokes of these kinds."""
    rng = np.random.default_rng(0)
    sensors, found = Sensors(rng), np.zeros(len(free))
    for i, kind in enumerate(kinds):
        trials = observed(kind, i, played(start, kind, 1, sensors, rng))
        (jacobian,) = ForceRuns(start, free, trials).jacobian(np.zeros(found.size), range(found.size))
        found = np.maximum(found, np.abs(jacobian).max(axis=(0, 1)))
    return tuple(p.name for p, size in zip(free, found, strict=True) if size > LEAST_EFFECT_RAD)


@cache
def acting_laws(kinds: tuple[str, ...]) -> tuple[str, ...]:
    """Laws of the printed action that act in strokes of these kinds."""
    start = model.load_action()
    return acting(start, unknowns(start, LAWS, ["*"]).asked, kinds)


def freed(start: model.Action, options: Any, rng: np.random.Generator) -> Unknowns:
    """What is free in one experiment."""
    if not options.free:
        return unknowns(start, options.asked)
    some = rng.choice(acting_laws(tuple(options.kinds)), options.free, replace=False)
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


def experiment(cell: str, k: int, options: Any) -> dict[str, Any]:
    """One experiment as plain data; ``failed`` says why it has no estimates."""
    rng = np.random.default_rng([options.seed, k, len(cell), options.free])
    start = model.load_action()
    free = freed(start, options, rng)
    truth, specimen = drawn_truth(start, free, options.spread, rng)
    sensors, seed, began = Sensors(rng), int(rng.integers(1, 10**6)), time.process_time()
    profiled = str(rng.choice([p.name for p in free.asked]))
    trials: list[ObservedTrial] = []
    try:
        for i, kind in enumerate(options.kinds):
            if cell == "lacking":
                data = played_on_bench(specimen, kind, options.trials, seed, rng)
            else:
                data = played(specimen, kind, options.trials, sensors, rng)
            trials += observed(kind, i, data)
        problem = problem_of(start, free, trials)
        fits = (
            [refine(problem, fit(problem, truth_z(problem, truth, sensors)))]
            if options.from_truth
            else search(problem, 1, None, None)
        )
        fitted = fits[0]
        fit_s = time.process_time() - began
        found = estimate_all(problem, fitted, [] if options.from_truth else [profiled], lambda text: None)
    except (ModelError, RigError, ValidationError) as error:
        return {"failed": str(error)}
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
    return {
        "estimates": rows, "converged": fitted.converged, "steps": sum(f.steps for f in fits), "fits": len(fits),
        "lacking": lacking(fitted),
        "processor_s": time.process_time() - began, "fit_s": fit_s,
    }  # fmt: skip


def table(cell: str, rows: Sequence[dict[str, Any]]) -> bool:
    """Print the coverage of a cell, of all, identified and profiled; whether all may be 95 %."""
    here = [e for r in rows for e in r.get("estimates", ())]
    kinds = {"all": here, "identified": [e for e in here if e["verdict"] == IDENTIFIED]}
    shown = Table(f"{cell}, of:24s", "intervals:d", "hold:d", "share:.3f", "99 % low:.3f", "high:.3f")
    for name, some in (kinds | {"profiled": [e for e in here if e["profiled"]]}).items():
        if some:
            hold = sum(e["inside"] for e in some)
            shown.row(name, len(some), hold, hold / len(some), *interval(hold, len(some), 0.99))
    narrow = [e for e in here if e["u"] < 0.5]
    if narrow:
        off = np.sqrt(np.mean([((e["z"] - e["true_z"]) / e["u"]) ** 2 for e in narrow]))
        called = sum(e["verdict"] == IDENTIFIED for e in narrow)
        print(f"interval below half the prior: {len(narrow)}, called identified {called}; error over u {off:.2f} RMS")
    failed, settled = sum("failed" in r for r in rows), sum(r.get("converged", False) for r in rows)
    print(f"experiments {len(rows)}, settled {settled}, could not be played or fitted {failed}")
    return may_be(0.95, sum(e["inside"] for e in here), len(here))


def main(run: Run) -> bool:
    """Print the table of each cell; whether intervals may hold the truth as often as stated."""
    same = [getattr(run, name) for name in SAME]
    keys = [(cell, k, *same) for k, cell in product(range(run.sessions), run.cells)]
    kept = list(run.cases(keys, lambda cell, k, *_: experiment(cell, k, run)))
    return all([table(cell, [row for key, row in kept if key[0] == cell]) for cell in run.cells])
