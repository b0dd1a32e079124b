"""How often do the 95 % intervals of an identification hold the truth? Virtual experiments with random true parameters.

Cells: ``nothing``: the specimen is the model; what is free and the errors of force and encoders are drawn from
their priors, all frictions scatter from trial to trial. ``lacking``: the same on the bench with motor arm, balance
rail and shank, which the model lacks. ``shank``, ``form``, ``felt``: the specimen has a shank, a felt with memory, or
another felt than the model, which was not freed; what is called known in spite of it (`infer.lacks`) is
counted beside what the right model's fit knows. ``--free N``: N laws drawn at random for each experiment are free, and
all else is as the model has it; ``--free 0``: those of ``--asked``, and all else is free, drawn, and fitted beside
them. One randomly drawn asked parameter is profiled in each experiment.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import product
from types import SimpleNamespace
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
from validation.conventions import Array
from validation.errors import ValidationError
from validation.infer.blocks import INSTRUMENT, Block
from validation.infer.budget import BIFURCATION, CONVERGED, Budget, End
from validation.infer.channels import FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL
from validation.infer.estimates import IDENTIFIED, LACKING, NORMAL, estimate_all
from validation.infer.fit import Fitted, fit_multistart
from validation.infer.further import HALF_KNOWN, SENSORS, Candidate, Prospect, add_trials, prospects, remaining_u
from validation.infer.hypotheses import ADDED, list_addable_effects
from validation.infer.identifiability import directions
from validation.infer.identify import FIT_SHARE, LEAST_EFFECT_RAD, default_budget_s
from validation.infer.lacks import SIZE_U, find_supported_estimates, fit_with_change
from validation.infer.noise import LEAST, Marginal, Sizes, select_noise_model
from validation.infer.observations import (
    ObservedTrial,
    observe,
)
from validation.infer.problem import Columns, Problem, linear_residuals, make_problem_at_start
from validation.infer.response import ModelResponse
from validation.infer.scatter import factors, measure_lack
from validation.infer.unknowns import LAW_U, Parameter, Unknowns, unknowns
from validation.measurement.trial import measure
from validation.prediction.model_under_test import ModelUnderTest

RATE_HZ, DELAY_S, AFTER_S, TOLERANCE = 5000.0, 0.0024, 0.3, 1e-7
SCATTER = 0.02  # of every friction, from trial to trial
STRENGTH = 0.02
EFFECTS = ("balance_rail", "shank")
WILDEST = 2.5
LAWS = ("friction", "joint_friction", "damping", "stiffness", "springs")
SAME = ("seed", "spread", "kinds", "trials", "free", "asked")
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
        self.encoders = tuple(EncoderInfo.from_config(e) for e in self.config.encoders)
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
            sample_rate_hz=RATE_HZ, time_s=t, raw_force_n=seen, force_raw=seen, motor_command_v=np.zeros(t.size),
            encoder_count=count - count[0], encoders=self.encoders,
            force_info=ForceInfo.from_config(self.config, DELAY_S), blow_start_s=BEFORE_S,
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
        turn = model.simulate(own, t, force, tolerance=TOLERANCE, initial=rest).angle_rad - rest.angle_rad
        out.append(sensors.read(number, t, force, turn, rng))
    return out


def played_on_bench(specimen: model.Action, kind: str, n: int, seed: int, rng: np.random.Generator) -> list[TrialData]:
    """Trials of one kind on the bench, with arm, rail and shank."""
    out = []
    shipped = load_plant(BENCH, seed, FINE * RATE_HZ, EFFECTS)
    for number in range(1, n + 1):
        own = shipped.choice.apply_to(scattered(specimen, rng))
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
    return make_problem_at_start(start, free, trials, ModelResponse(start, (*free.moved, *free.held), trials, RUNS))[0]


def acting(start: model.Action, free: Sequence[Any], kinds: Sequence[str]) -> tuple[str, ...]:
    """Those of the parameters that move an encoder in strokes of these kinds."""
    rng = np.random.default_rng(0)
    sensors, found = Sensors(rng), np.zeros(len(free))
    for i, kind in enumerate(kinds):
        trials = observed(kind, i, played(start, kind, 1, sensors, rng))
        (jacobian,) = ModelResponse(start, free, trials).jacobian(np.zeros(found.size), range(found.size))
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
        return unknowns(start, options.asked, getattr(options, "fixed", ()))
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


def truth_z(free: Unknowns, truth: dict[str, float], sensors: Sensors) -> np.ndarray:
    """The true values (p,), errors of the force among them."""
    force = force_errors(sensors)
    return np.array([truth[p.name] if p.paths else force[p.name] for p in free.moved])


def experiment(cell: str, k: int, options: Any) -> dict[str, Any]:
    """One experiment as plain data; ``failed`` says why it has no estimates."""
    rng = np.random.default_rng([options.seed, k, len(cell), options.free])
    start = model.load_action()
    free = freed(start, options, rng)
    truth, specimen = drawn_truth(start, free, options.spread, rng)
    sensors, seed = Sensors(rng), int(rng.integers(1, 10**6))
    profiled = str(rng.choice([p.name for p in free.asked]))
    if cell in LACKS:
        specimen = planted(cell, start, free, options, rng)[3](specimen)
    trials: list[ObservedTrial] = []
    try:
        for i, kind in enumerate(options.kinds):
            if cell == "lacking":
                data = played_on_bench(specimen, kind, options.trials, seed, rng)
            else:
                data = played(specimen, kind, options.trials, sensors, rng)
            trials += observed(kind, i, data)
        began = time.process_time()
        problem = problem_of(start, free, trials)
        budget = Budget(default_budget_s(problem))
        fits = fit_multistart(problem, 1, None, budget.fraction(FIT_SHARE))
        fitted = fits[0]
        fit_s = time.process_time() - began
        found = estimate_all(problem, fitted, [profiled], lambda text: None, budget=budget)
        spent_s = time.process_time() - began
        at_best = fisher_covariance(problem, fitted, truth_z(free, truth, sensors))
    except (ModelError, RigError, ValidationError) as error:
        return {"failed": str(error)}
    n, names, rows = len(found), [e.name for e in found], []
    known, could = (len(directions(names, c)[1]) for c in (fitted.covariance[:n, :n], at_best))
    for j, e in enumerate(found):
        p = next(p for p in free.asked if p.name == e.name)
        true = p.physical(start, truth[e.name])
        rows.append(
            {
                "name": e.name, "true_z": truth[e.name], "z": e.z, "u": e.z_u, "u_lacking": e.u_form,
                "u_jackknife": e.u_jackknife, "inside": bool(e.low <= true <= e.high), "profiled": e.profiled,
                "interval": e.interval, "verdict": e.verdict, "fisher": float(np.sqrt(at_best[j, j])),
            }
        )  # fmt: skip
    return {
        "estimates": rows, "converged": fitted.converged, "end": str(fitted.end), "steps": sum(f.steps for f in fits),
        "fits": len(fits), "lacking": measure_lack(fitted), "processor_s": spent_s, "fit_s": fit_s,
        "known": known, "could": could, "cut": len(fitted.bifurcations),
    }  # fmt: skip


def fisher_covariance(problem: Problem, fitted: Fitted, z: Array) -> Array:
    """Covariance (n, n) of the requested parameters by the Fisher information at the truth z, noise as it was made."""
    n, sizes = len(problem.unknowns.asked), fitted.marginal.sizes
    none = [np.full_like(part, LEAST) for part in (sizes.by_family, sizes.own, sizes.common)]
    none[0][:2] = SCATTER / LAW_U  # frictions scatter, nothing else does
    return Marginal(Columns(problem).blocks(z), Sizes(sizes.families, *none)).covariance[:n, :n]


LACKS = {
    "shank": ("shank",),
    "form": [f"{c}.{law}" for c in ("contact02", "contact12") for law in ("stulov", "hysteresis")],
}
LEAST_OFF, MOST_OFF = 0.7, 1.5  # prior standard uncertainties by which a felt that is not freed is off


def planted(cell: str, start: model.Action, free: Unknowns, options: Any, rng: np.random.Generator) -> Any:
    """What the model lacks: a parameter, the action that has it, its true z there, and the specimen made of another."""
    if cell == "felt":
        felts = [p for p in free.held if len(p.paths) > 1 and p.name in acting_laws(tuple(options.kinds))]
        one = felts[int(rng.integers(len(felts)))]
        z = float(rng.choice([-1.0, 1.0]) * rng.uniform(LEAST_OFF, MOST_OFF))
        return one, start, z, lambda specimen: specimen.with_values(one.values(start, z))
    asked = {p.name for p in free.asked}  # a damping that the true law does not have has no true value
    kinds = [k for k in LACKS[cell] if f"{k.partition('.')[0]}.normal.D" not in asked]
    kind, amount = str(rng.choice(kinds)), float(np.exp(0.3 * rng.standard_normal()))
    (source,) = (s for s in list_addable_effects(start) if s.name.startswith(ADDED + kind))
    path, _, power = source.scaled[0]
    one, scene, stated = Parameter(path, (path,), SIZE_U, True, ""), source.scene(start, amount), source.scene(start, 1)
    assert scene is not None and stated is not None
    return one, stated.on(start), power * np.log(amount) / SIZE_U, scene.on


def in_spite(cell: str, k: int, options: Any) -> dict[str, Any]:
    """One experiment with a planted lack as plain data; ``failed`` says why it has no estimates."""
    rng = np.random.default_rng([options.seed, k, sum(map(ord, cell)), options.free])
    start, began = model.load_action(), time.process_time()
    free = freed(start, options, rng)
    truth, specimen = drawn_truth(start, free, options.spread, rng)
    sensors = Sensors(rng)
    one, right, z, lack = planted(cell, start, free, options, rng)
    trials: list[ObservedTrial] = []
    try:
        for i, kind in enumerate(options.kinds):
            trials += observed(kind, i, played(lack(specimen), kind, options.trials, sensors, rng))
        problem = problem_of(start, free, trials)
        budget = Budget(default_budget_s(problem))
        fitted = fit_multistart(problem, 1, None, budget.fraction(FIT_SHARE))[0]
        fit_s = time.process_time() - began
        found = find_supported_estimates(problem, fitted, lambda text: None, budget)
        assert found is not None
        took_s = time.process_time() - began - fit_s
        tried = [m for m in found.let_in if m.parameter is not None and m.parameter.name == one.name]
        best = tried[0] if tried else fit_with_change(problem, fitted, one, right, 0.0)
    except (ModelError, RigError, ValidationError) as error:
        return {"failed": str(error)}
    could = [] if best is None else estimate_all(best.problem, best.fitted, (), lambda text: None)
    true = {p.name: p.physical(start, truth[p.name]) for p in free.asked}
    called = [
        {"name": e.name, "inside": bool(e.low <= true[e.name] <= e.high), "off": (e.z - truth[e.name]) / e.z_u}
        for e in found.estimates
        if e.verdict == IDENTIFIED
    ]
    for c, value, u in found.combinations:
        off = (value - sum(w * truth[name] for name, w in c.weights.items())) / u
        called.append({"name": c.words, "inside": bool(abs(off) < NORMAL), "off": off})
    return {
        "planted": f"{one.name} z {z:.2f}", "let_in": [m.words for m in found.let_in], "settled": fitted.converged,
        "lacking": measure_lack(fitted), "left": measure_lack(found.let_in[0].fitted), "right": bool(tried),
        "called": called, "could": [e.name for e in could if e.verdict == IDENTIFIED], "where": found.where,
        "before": sum(e.verdict == IDENTIFIED for e in estimate_all(problem, fitted, (), lambda text: None)),
        "fit_s": fit_s, "took_s": took_s,
    }  # fmt: skip


def table_in_spite(cell: str, rows: Sequence[dict[str, Any]]) -> bool:
    """Print how often what is called known holds, and how much of what could be known is called so."""
    done = [r for r in rows if "failed" not in r]
    called = [c for r in done for c in r["called"]]
    could = [(r, name) for r in done for name in r["could"]]
    hold, of = sum(c["inside"] for c in called), sum(name in {c["name"] for c in r["called"]} for r, name in could)
    shown = Table(
        f"{cell}:10s", "experiments:d", "right named:d", "alone:d", "called known:d", "hold:d", "share:.3f",
        "99 % low:.3f", "high:.3f", "before:d", "could be known:d", "called so:d", "fit, s:.0f", "more, s:.0f",
    )  # fmt: skip
    alone = sum(r["right"] and len(r["let_in"]) == 1 for r in done)
    times = [np.median([r[name] for r in done]) if done else np.nan for name in ("fit_s", "took_s")]
    shown.row(
        "", len(done), sum(r["right"] for r in done), alone, len(called), hold, hold / max(len(called), 1),
        *interval(hold, len(called), 0.99), sum(r["before"] for r in done), len(could), of, *times,
    )  # fmt: skip
    return may_be(0.95, hold, len(called)) and 3 * of >= len(could)


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
    failed, ends = (
        sum("failed" in r for r in rows),
        Counter(str(r["end"]).partition(":")[0] for r in rows if "end" in r),
    )
    print(f"experiments {len(rows)}, could not be played or fitted {failed}, ended {dict(ends)}")
    print(f"processor time at most {max((r.get('fit_s', 0.0) for r in rows), default=0.0):.0f} s a fit")
    return may_be(0.95, sum(e["inside"] for e in here), len(here))


def main(run: Run) -> bool:
    """Print the table of each cell; whether intervals may hold the truth as often as stated."""
    same = [getattr(run, name) for name in SAME]
    keys = [(cell, k, *same) for k, cell in product(range(run.sessions), run.cells)]
    lacks = (*LACKS, "felt")
    kept = list(run.cases(keys, lambda cell, k, *_: (in_spite if cell in lacks else experiment)(cell, k, run)))
    tables = [
        (table_in_spite if c in lacks else table)(c, [row for key, row in kept if key[0] == c]) for c in run.cells
    ]
    return all(tables)


FRICTIONS = ["contact01.friction", "contact04.friction", "contact07.friction", "contact10.friction"]
DESIGNS: tuple[dict[str, Any], ...] = (
    {"kinds": ["forte", "piano"], "free": 5, "trials": 5},
    {"kinds": ["forte"], "asked": FRICTIONS, "trials": 5},
    {"kinds": ["forte"], "free": 8, "trials": 5},
    {"kinds": ["piano"], "free": 5, "trials": 10},
    {"cell": "shank", "kinds": ["forte"], "asked": ["hammer.joint_friction"], "trials": 5},
    {"kinds": ["double"], "free": 12, "trials": 10},
    {"kinds": ["piano"], "asked": FRICTIONS, "trials": 10},
    {"kinds": ["slow", "mf"], "free": 8, "trials": 5},
    {"cell": "shank", "kinds": ["forte"], "asked": FRICTIONS, "trials": 10},
    {"kinds": ["piano"], "asked": FRICTIONS, "trials": 5, "fixed": ["*"]},
    {"kinds": ["fortissimo"], "free": 5, "trials": 10},
    {"cell": "shank", "kinds": ["piano"], "asked": FRICTIONS[:2], "trials": 5},
)
"""Experiments in turn: many laws, soft strokes, four frictions beside all else, an action that lacks the shank."""
EASY = (0, 2, 5, 7, 10, 3)  # of them, after the first turns: more values
ALLOWED = 1.3  # of u by the Fisher information at the truth


def identify_ends(run: Run) -> bool:
    """How does `identify` end, how near is u to what the Fisher information allows, how often do values hold?

    Right: 20 of the first 24 experiments converge or end at a bifurcation, none takes more than 60 s of processor time.
    """

    def one(k: int, seed: int) -> dict[str, Any]:
        own = DESIGNS[k % len(DESIGNS) if k < run.sessions else EASY[k % len(EASY)]]
        plain = {"cell": "nothing", "free": 0, "asked": [], "fixed": [], "spread": 0.5, "seed": seed}
        options = SimpleNamespace(**{**plain, **own})
        return experiment(options.cell, k, options) | {"cell": options.cell}

    kept = [row for _, row in run.cases([(k, run.seed) for k in range(run.sessions + run.more)], one)]
    kept = [row for row in kept if "failed" not in row]
    first = kept[: run.sessions]
    ends = Counter(str(row["end"]).partition(":")[0] for row in first)
    settled = ends[CONVERGED] + ends[BIFURCATION]
    most = max((row["processor_s"] for row in first), default=0.0)
    table("all", kept)
    right = [row for row in first if row["cell"] == "nothing"]
    worst = [max(e["u"] / e["fisher"] for e in row["estimates"]) for row in right]
    ratios = np.array([e["u"] / e["fisher"] for row in kept if row["cell"] == "nothing" for e in row["estimates"]])
    known = [e for row in kept for e in row["estimates"] if e["verdict"] == IDENTIFIED]
    held, near = sum(abs(e["z"] - e["true_z"]) < 2.0 * e["u"] for e in known), int(np.sum(ratios <= ALLOWED))
    low, high = interval(held, len(known))
    run.figure(
        "identify-ends",
        f"{settled} of {len(first)} converged or at a bifurcation, at most {most:.0f} s of processor time; u at most "
        f"{ALLOWED} x what Fisher information at the truth allows in {sum(w <= ALLOWED for w in worst)} of "
        f"{len(right)} experiments, {near} of {ratios.size} values (median {np.median(ratios):.2f}); "
        f"directions known {sum(r['known'] for r in right)} for {sum(r['could'] for r in right)}; known values within "
        f"2 u: {held} of {len(known)} ({100 * low:.1f} to {100 * high:.1f} %)",
    )
    return most <= 60.0 and 24 * settled >= 20 * len(first)


NEAR = 0.2
SAME_NEXT = ("seed", "first", "next", "numbers", "more")
FREE = (5, 9)
TOLD = 0.9
LEARNINGS = 40
CLASSES = (
    ("all", "predicted", np.inf),
    ("told", "predicted", TOLD),
    ("linear", "fisher", TOLD),
    ("clear", "predicted", TOLD),
)
Part = tuple[Problem, list[Block], list[Array]]


class Experiment:
    """One specimen, its sensors, and its trials with their linear model at the truth."""

    def __init__(self, k: int, options: Run) -> None:
        self.rng = np.random.default_rng([options.seed, k, 163])
        self.start = model.load_action()
        n = int(self.rng.integers(FREE[0], FREE[1] + 1))
        self.free: Unknowns = freed(self.start, SimpleNamespace(free=n, kinds=[options.first]), self.rng)  # type: ignore[arg-type]
        truth, self.specimen = drawn_truth(self.start, self.free, 0.5, self.rng)
        self.sensors = Sensors(self.rng)
        self.z = truth_z(self.free, truth, self.sensors)

    def trials(self, kind: str, session: int, n: int) -> list[ObservedTrial]:
        """Played and observed."""
        return observed(kind, session, played(self.specimen, kind, n, self.sensors, self.rng))

    def part(self, kind: str, session: int, n: int) -> Part:
        """Trials with their linear model and residuals at z = 0 of it."""
        problem = problem_of(self.start, self.free, self.trials(kind, session, n))
        (curves,) = problem.response.curves([self.z])
        if curves is None:
            raise ValidationError("the model cannot run at the true values")
        blocks = Columns(problem).blocks(self.z)
        return problem, blocks, linear_residuals(problem, blocks, curves, self.z)

    def learnt(self, problem: Problem, blocks: list[Block], linear: list[Array], sizes: Sizes | None = None) -> Fitted:
        """Sizes of noise learnt from some trials, from two starts as in a fit; one of them where they were before."""
        first = Sizes.start(problem.families, problem.seen) if sizes is None else sizes
        marginal = select_noise_model(blocks, linear, first, LEARNINGS)
        return Fitted(self.z, [], marginal, linear, 0.0, 0, End(CONVERGED))

    def errors(self, trial: ObservedTrial) -> dict[str, float]:
        """True errors of the sensors, in standard uncertainties."""
        s, names = self.sensors, ("key", "whippen", "hammer")
        out = force_errors(s)
        for e, turn, change in zip(s.config.encoders, s.turn, s.change, strict=True):
            c = names.index(e.name)
            out[f"{e.name} encoder scale"] = turn / trial.u_scale[c]
            out[f"{e.name} encoder zero"] = change / trial.u_steady_rad[c]
        return out

    def better(self, fitted: Fitted, names: Sequence[str], trial: ObservedTrial) -> tuple[list[Block], list[Array]]:
        """The same trials with half the error of a sensor."""
        true, moved = self.errors(trial), [p.name for p in self.free.moved]
        blocks, linear = [], []
        for b, r in zip(fitted.marginal.blocks, fitted.linear, strict=True):
            m, i, left = b.moved.copy(), b.instrument.copy(), r.copy()
            for name in names:
                columns, j = (m, moved.index(name)) if name in moved else (i, INSTRUMENT.index(name))
                left -= (1 - HALF_KNOWN) * true[name] * columns[:, j]
                columns[:, j] *= HALF_KNOWN if name in moved else remaining_u(trial, name)
            blocks.append(replace(b, moved=m, instrument=i))
            linear.append(left)
        return blocks, linear


def experiment_next(k: int, options: Run) -> dict[str, Any]:
    """One experiment_next as plain data; ``failed`` says why it has none."""
    numbers, began = options.numbers, time.process_time()
    try:
        one = Experiment(k, options)
        first = one.part(options.first, 0, max(numbers))
        later = {kind: one.part(kind, 1, options.more) for kind in dict.fromkeys((options.first, options.next))}
        dry = one.trials(options.next, 0, 1)[0]
        better = [x for x in SENSORS if x in options.sensors]
        rows = []
        for n in numbers:
            rows += predicted_and_realised(
                one, n, first, later, Candidate(options.next, dry), better if n == numbers[0] else []
            )
    except (ModelError, ValidationError) as error:
        return {"failed": str(error)}
    return {"rows": rows, "processor_s": time.process_time() - began}


def predicted_and_realised(
    one: Experiment, n: int, first: Part, later: dict[str, Part], dry: Candidate, better: Sequence[str]
) -> list[dict[str, Any]]:
    """A row for each thing that could be done after n trials of the first kind, and each parameter."""
    whole, blocks, linear = first
    problem = replace(whole, trials=whole.trials[:n], held=whole.held[:n])
    before = one.learnt(problem, blocks[:n], linear[:n])
    ranked, refused = prospects(problem, before, [dry], len(next(iter(later.values()))[0].trials))
    if refused:
        raise ValidationError("; ".join(refused))
    by_name = {p.name: p for p in ranked}
    out = []
    for (kind, (new, columns, left)), what in zip(later.items(), ("same", "other"), strict=True):
        told = next(p for name, p in by_name.items() if name == kind or (what == "same" and name.startswith("more of")))
        both = replace(problem, trials=(*problem.trials, *new.trials))
        known = add_trials(before, columns[0], 1).sizes
        after = one.learnt(both, [*blocks[:n], *columns], [*linear[:n], *left], known)
        out += compared(what, n, told, before, after)
    for sensor in better:
        found = one.better(before, SENSORS[sensor], whole.trials[0])
        after = one.learnt(problem, *found, before.marginal.sizes)
        out += compared("sensor", n, by_name[f"{sensor} known twice as well"], before, after)
    return out


def compared(what: str, n: int, told: Prospect, before: Fitted, after: Fitted) -> list[dict[str, Any]]:
    """A row for each parameter."""
    u = [np.sqrt(np.diag(f.covariance)) for f in (before, after)]
    t = [factors(f) for f in (before, after)]
    family = [f.marginal.sizes.scatter for f in (before, after)]
    lack = [float(f.marginal.sizes.discrepancy.max()) for f in (before, after)]
    return [
        {
            "what": what, "n": n, "name": name, "predicted": shrink, "fisher": told.fisher.get(name, shrink),
            "limits": told.range(name), "realised": u[1][j] / u[0][j], "u": u[0][j], "t": [t[0][j], t[1][j]],
            "scatter": [f[j] for f in family], "lacking": lack,
        }
        for j, (name, shrink) in enumerate(told.shrink.items())
    ]  # fmt: skip


def table_next(rows: Sequence[dict[str, Any]]) -> bool:
    """Print what is within a fifth, and inside the limits, by what is done and by the number of first trials.

    Returns whether limits may hold as often as stated.
    """
    good = True
    shown = Table(
        "next:7s", "trials:d", "of:6s", "shrinks:d", "within 20 %:d", "share:.2f", "real/told:.2f", "spread:.2f",
        "limits hold:d", "share:.2f", "99 % low:.2f", "high:.2f", "half as wide:.0%",
    )  # fmt: skip
    whole = [r for kept in rows for r in kept.get("rows", ())]
    for what, n in dict.fromkeys((r["what"], r["n"]) for r in whole):
        for name, by, most in CLASSES:
            here = [r for r in whole if (r["what"], r["n"]) == (what, n) and r["fisher"] < most]
            here = [r for r in here if name != "clear" or r["lacking"][0] <= LACKING]
            if not here or (what == "sensor" and name == "linear"):
                continue
            off = np.log([r["realised"] / r[by] for r in here])
            near = int(np.sum((off <= np.log(1 + NEAR)) & (off >= np.log(1 - NEAR))))
            limits: list[Any] = [None] * 5
            if by == "predicted" and any(r["limits"][0] < r["limits"][1] for r in here):
                hold = sum(r["limits"][0] <= r["realised"] <= r["limits"][1] for r in here)
                good &= may_be(0.95, hold, len(here))
                wide = np.median([np.log(r["limits"][1] / r["limits"][0]) / 2 for r in here])
                limits = [hold, hold / len(here), *interval(hold, len(here), 0.99), np.expm1(wide)]
            shown.row(what, n, name, len(here), near, near / len(here), np.exp(np.median(off)), np.std(off), *limits)
    print(f"experiments {len(rows)}, could not be played {sum('failed' in r for r in rows)}")
    return good


def record_next_sizes(run: Run) -> bool:
    """How often are predicted shrinks realised, and their 95 % limits right? Many experiments, without fits.

    Specimen = model; five to nine laws drawn at random are free, their truth and the errors of force and encoders drawn
    from their priors, all frictions scatter by 2 % from trial to trial (`benchmarks.identification_coverage`). As many
    trials of the first kind as ``--numbers`` say are played; sizes of noise are learnt from them on the linear model at
    the truth; shrinks are predicted as `identify --plan` does: for more trials of the same kind in a session of their
    own, for another kind, and for each sensor known twice as well. Then these trials are played, sizes are learnt
    again, and u after over u before is compared with what was predicted. A sensor known twice as well has half its
    error.

    There is no fit: what it shows is how well sizes of noise are known, not where a fit ends. ``told``: parameters
    whose u is to shrink by more than a tenth; all others are easily right. ``linear``: these by the Fisher information
    alone, without the rehearsal (`validation.infer.further`); ``clear``: those of ``told`` where after the
    first trials the model is not said to lack anything.
    """
    same = [getattr(run, name) for name in SAME_NEXT]
    found = run.cases([(k, *same) for k in range(run.sessions)], lambda k, *_: experiment_next(k, run))
    return table_next([row for _, row in found])
