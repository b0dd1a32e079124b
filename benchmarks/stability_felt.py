"""Do plausible and absurd actions run with felt that remembers, strings, joints that give, and are they right?

    python -m benchmarks stability_felt [--set A|B] [--with stulov|hysteresis|string|joints|all] [--count 10000]
                                        [--seed 1] [--first 0] [--case N]

The cases are those of `stability`; the numbers of laws, string and effects vary by half as well. Felt that softens
as it is pressed, which laws with memory refuse, is given the least b that does not soften. ``all``: a law with memory
on every felt (Stulov's on every third), string, balance rail and shank. ``joints``: each case has bushings of its own,
stiffness 1e4 to 1e7 N/m, damping 0 to critical, loads of up to 5 N. Right means: the energy audit, integrated with
the motion at 1e-9, closes to 1e-6 of what was turned over (input and losses; where microjoules are turned over, at
1e-11), and the angles at the tolerance 1e-5 stay within ten times that of those at 1e-9; a miss counts as said where
the estimated error says so, and as explained where a disturbance of the tolerance grows as much. Prints the outcomes,
with the upper bound of the rate of failures (95 %).
"""

from __future__ import annotations

import json
import warnings
from collections import Counter

import numpy as np

import model
from benchmarks.runner import Run, at_most
from benchmarks.stability import KICK_S, MAKERS, Case
from model.parameters.action import CONTACTS, STRING
from model.parameters.effects import PINS
from model.parameters.quantity import allowed_range
from model.scene.selection import SceneChoice
from model.simulation.statics import solve_rest

TIGHT, FINER, LOOSE, MISS = 1e-9, 1e-11, 1e-5, 10.0
CLOSES = 1e-6
ROUNDING = 2.2e-16  # of the energy stored, every step: a jammed action may hold kilojoules, turn over microjoules
EFFECTS = {"string": ("string",), "all": ("balance_rail", "shank", "string")}
FIXED = ("string.modes", "shank.frequency_hz", "shank.hinge", "shank.near")  # what others must fit to
Row = dict[str, str | int | float]


def bushings(case: Case, action: model.Action) -> dict[str, float]:
    """Numbers of the bushings of a case."""
    random, out = np.random.default_rng([case.seed, case.number]), {}
    for effect, body in PINS.items():
        stiffness = 10.0 ** random.uniform(4.0, 7.0)
        out[f"{effect}.stiffness"] = stiffness
        out[f"{effect}.damping"] = random.uniform(0.0, 2.0) * float(np.sqrt(stiffness * action[f"{body}.mass"]))
        out |= {f"{effect}.load.{axis}": random.uniform(-5.0, 5.0) for axis in "xy"}
    return out


def changed(case: Case, what: str) -> tuple[model.Action, SceneChoice]:
    """The action and the scene with what is under test."""
    action = model.load_action().with_values(case.overrides)
    if what == "joints":
        return action.with_effects(bushings(case, action)), model.load_scene("giving-joints")
    choice = SceneChoice(effects=EFFECTS.get(what, ()))
    felts = () if what == "string" else tuple(c for c in CONTACTS if not (choice.effects and c == STRING))
    of = {c: what if what != "all" else ("stulov" if k % 3 == 1 else "hysteresis") for k, c in enumerate(felts)}
    rises = {}
    for c in felts:
        least = -0.99 * float(np.sqrt(3.0 * abs(action[f"{c}.normal.a"] * action[f"{c}.normal.c"])))
        if action[f"{c}.normal.b"] < least:
            rises[f"{c}.normal.b"] = least
    if "string" in choice.effects:
        rises[f"{STRING}.friction.A"] = 0.0
    action = action.with_values(rises).with_laws(of)
    random = np.random.default_rng([case.seed, ord(case.set), case.number, 21])
    varied = {}
    for path in sorted(action.effects):
        contact, _, rest = path.partition(".")
        used = contact in choice.effects or of.get(contact) == rest.split(".")[0]
        if used and not path.startswith(FIXED) and action[path] != 0.0:
            low, high, _ = allowed_range(path)
            varied[path] = float(np.clip(action[path] * random.uniform(0.5, 1.5), low, high))
    for path in varied:  # a share of 1 would leave nothing of a force that has faded
        if path.endswith("epsilon"):
            varied[path] = min(varied[path], 0.98)
    return action.with_effects(varied), choice


class Runs:
    """One case, ready to be integrated to any tolerance, with or without a disturbance."""

    def __init__(self, case: Case, what: str) -> None:
        self.action, self.choice = changed(case, what)
        self.times, self.forces = model.check_force_table(case.time_s, case.force_n)
        self.scene = model.build_scene(self.choice.on(self.action), self.choice)
        self.initial: model.State | None = None
        if case.angle_rad is not None:
            more = self.scene.size - len(case.angle_rad)
            angle = np.append(case.angle_rad, self.scene.start[len(case.angle_rad) :] if more else [])
            self.initial = model.State(float(self.times[0]), angle, np.append(case.speed_rad_per_s, np.zeros(more)))

    def solve(self, tolerance: float, *, energy: bool = False, estimate: bool = False) -> model.Solution:
        """The motion at 401 times."""
        return model.simulate(
            self.action, self.times, self.forces, scene=self.choice, tolerance=tolerance, initial=self.initial,
            energy=energy, estimate_error=estimate, output_time_s=np.linspace(self.times[0], self.times[-1], 401),
        )  # fmt: skip

    def open_energy(self, tolerance: float) -> tuple[float, model.Solution]:
        """Share of the energy turned over that the audit leaves open, but for rounding, and the run."""
        run = self.solve(tolerance, energy=True)
        assert run.energy is not None
        energy = run.energy
        turned = abs(energy.work_in) + energy.work_in - energy.stored_change - energy.residual
        stored = abs(model.Simulation(self.scene, self.start()).stored_energy())
        return max(0.0, abs(energy.residual) - ROUNDING * stored * run.counters["n_steps"]) / turned, run

    def start(self) -> model.State:
        """The state that the case starts from."""
        if self.initial is not None:
            return self.initial.copy()
        return model.State(float(self.times[0]), solve_rest(self.scene), np.zeros(self.scene.size))

    def growth(self, reference: np.ndarray, enough: float) -> float:
        """How much a disturbance of the tolerance grows; stops where it is ``enough``."""
        at = np.linspace(self.times[0], self.times[-1], 401)
        largest = 1.0
        for moment in KICK_S:
            for kick in LOOSE * np.eye(self.scene.size)[:5]:
                run = model.Simulation(self.scene, self.start(), LOOSE / 100)
                if moment > self.times[0]:
                    run.advance(moment, self.times, self.forces)
                run.state.angle_rad = run.state.angle_rad + kick
                rest = at[at >= run.state.time_s]
                moved, _ = run.advance(float(at[-1]), self.times, self.forces, output_time_s=rest)
                off = float(np.max(np.abs(moved - reference[len(at) - len(rest) :])[:, :5]))
                largest = max(largest, off / LOOSE)
                if largest >= enough:
                    return largest
        return largest


def judged(name: str, what: str, seed: int, number: int) -> Row:
    """Outcome of one case, with its figures."""
    case, row = MAKERS[name](seed, number), Row(number=number)
    try:
        runs = Runs(case, what)
        row["residual"], fine = runs.open_energy(TIGHT)
        coarse = runs.solve(LOOSE)
        row["error_rad"] = error = float(np.max(np.abs(fine.angle_rad - coarse.angle_rad)[:, :5]))
        if not row["residual"] <= CLOSES:
            row["finer_residual"], _ = runs.open_energy(FINER)
            if not row["finer_residual"] <= CLOSES:
                return row | {"outcome": "wrong: energy"}
        if error <= MISS * LOOSE:
            return row | {"outcome": "right"}
        told = runs.solve(LOOSE, estimate=True)
        if told.misses_tolerance:
            return row | {"outcome": "right, a missed tolerance said"}
        row["growth"] = growth = runs.growth(fine.angle_rad, error / LOOSE)
        row["estimated_rad"] = float(told.error_rad or 0.0)
        explained = growth * LOOSE >= error
        return row | {"outcome": "missed silently" + (", growth explains it" if explained else "")}
    except model.ModelError as problem:
        expected = " (expected)" if case.expect == type(problem).__name__ else ""
        return row | {"outcome": type(problem).__name__ + expected, "detail": str(problem)}
    except Exception as problem:  # exactly what this benchmark looks for
        return row | {"outcome": f"wrong: untyped {type(problem).__name__}", "detail": str(problem)}


def report(rows: list[Row]) -> bool:
    """Print outcomes; whether none is wrong."""
    tally = Counter(str(row["outcome"]) for row in rows)
    for outcome, n in tally.most_common():
        print(f"  {n:6d}  {outcome}")
    bad = [row for row in rows if str(row["outcome"]).startswith(("wrong", "missed"))]
    for row in bad:
        print("  " + ", ".join(f"{k} {v:.2e}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()))
    ran = sum("Error" not in str(row["outcome"]) for row in rows)
    if ran:
        top = at_most(len(bad), ran)
        print(f"  {len(bad)} of {ran} that ran are wrong or silent: at most {100 * top:.2g} % (95 %, one-sided)")
        worst = max(float(row.get("residual", 0.0)) for row in rows)
        print(f"  worst energy residual {worst:.1e} of what was turned over")
    return not bad


def main(run: Run) -> bool:
    """Run the cases asked for, then report all that are there; whether none is wrong."""
    warnings.simplefilter("ignore")
    if run.case >= 0:
        print(json.dumps(judged(run.set, getattr(run, "with"), run.seed, run.case)))
        return True
    keys = [(run.set, getattr(run, "with"), run.seed, number) for number in range(run.first, run.first + run.count)]
    rows = [row for _, row in run.cases(keys, judged, run.workers)]
    print(f"set {run.set}, {getattr(run, 'with')}: {len(rows)} of {run.count}")
    return report(rows)
