"""Does every plausible action run, and does every absurd one give a right result or an error in one line?

    python -m benchmarks stability [--set A,B] [--with none,string,hysteresis,stulov,joints,all] [--count 10000]
                                   [--seed 1] [--workers 2]

Set A (plausible): geometry +-2 mm, everything else +-50 %, v_t 1e-2..1e-5, forces to 120 N with 0.2 ms edges; at
least 99.9 % must finish. Set B (abuse): geometry +-50 %, no damping, no friction, deep penetration at start,
v_t to 1e-6, NaN and infinite force; each must give a right result or a typed error with advice.
``--with``: the same with felt that remembers, a string, joints that give; the numbers of laws, string and effects vary
by half as well. Felt that softens as it is pressed, which laws with memory refuse, is given the least b that does not
soften. ``all``: a law with memory on every felt (Stulov's on every third), string, balance rail and shank. ``joints``:
each case has bushings of its own, stiffness 1e4 to 1e7 N/m, damping 0 to critical, loads of up to 5 N.

Right means: the energy closes and the angles stay within ten times the tolerance of those at 1e-9. A miss counts as
said where the estimated error says so, and as explained where a disturbance as large as the tolerance grows as much.
The energy balance integrated with the motion at 1e-9 closes to 1e-4 of what was turned over (input and losses; at least
1 mJ), with laws and effects to 1e-6 (where microjoules are turned over, at 1e-11). No case can hang: steps are bounded.
A case is plain data generated from (set, seed, number): it states which parameters differ from the printed action,
which force acts, where the motion starts and which error it must raise if it cannot run. Prints the outcomes, with the
upper bound of the rate of failures (95 %).
"""

from __future__ import annotations

import warnings
from collections import Counter
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from benchmarks.runner import Run, at_most
from model.parameters.action import CONTACTS, STRING
from model.parameters.effects import PINS
from model.parameters.quantity import allowed_range
from model.scene.selection import SceneChoice
from model.simulation.statics import solve_rest

Array = NDArray[np.float64]
Row = dict[str, Any]

LEAST_SHARE = 0.999  # of set A
NONE = "none"
TOLERANCE, TIGHT, FINER = 1e-5, 1e-9, 1e-11  # rad
FACTOR = 10.0  # error allowed, in tolerances
RESIDUAL = 1e-4  # allowed energy residual, in turnovers
CLOSES = 1e-6  # the same of the audit integrated with a tight run
ROUNDING = 2.2e-16  # of the energy stored, every step: a jammed action may hold kilojoules, turn over microjoules
LEAST_TURNOVER_J = 1e-3  # a forte has 100 times this turnover; below it the tolerance itself corresponds to more energy
END_S = 0.4
STEPS = 100_000  # for one run; finer runs may take ten times as many
KICK_S = (0.0, 0.08, 0.16, 0.24, 0.32)
OUTPUT_S = np.linspace(0.0, END_S, 401)


@dataclass
class Case:
    """One case as plain data; ``expect`` is the name of the error it must raise, if any."""

    set: str
    seed: int
    number: int
    overrides: dict[str, float]
    time_s: list[float]
    force_n: list[float]
    angle_rad: list[float] | None = None  # None: at rest
    speed_rad_per_s: list[float] = field(default_factory=lambda: [0.0] * 5)
    expect: str | None = None


def edges(random: np.random.Generator, highest: float) -> tuple[list[float], list[float]]:
    """A force table of 2 to 8 levels up to ``highest``, joined by 0.2 ms edges; at the end the key is released."""
    count = int(random.integers(2, 9))
    starts = np.sort(random.uniform(0.01, 0.3, count))
    starts = starts[np.append(True, np.diff(starts) > 3e-4)]
    levels = random.uniform(0.0, highest, len(starts)) * random.choice([0.1, 1.0], len(starts))
    if random.random() < 0.8:
        levels[-1] = 0.0
    before = np.append(0.0, levels[:-1])
    times = np.column_stack([starts, starts + 2e-4]).ravel()
    return [0.0, *times.tolist(), END_S], [0.0, *np.column_stack([before, levels]).ravel().tolist(), float(levels[-1])]


def varied(random: np.random.Generator, length_m: float, share: float, turn: float) -> dict[str, float]:
    """Change all parameters of the printed action: lengths by ``length_m`` (if 0: by 50 %), angles by ``turn``."""
    base = model.load_action()
    out: dict[str, float] = {}
    for path, quantity in base.quantities.items():
        value, last = quantity.value, path.split(".")[-1]
        if path.endswith("normal.y"):
            continue
        if path.endswith("normal.x"):
            angle = np.arctan2(base[path[:-1] + "y"], value) + random.uniform(-turn, turn)
            out[path], out[path[:-1] + "y"] = float(np.cos(angle)), float(np.sin(angle))
        elif last in ("arc_start", "arc_end"):
            out[path] = value + random.uniform(-turn, turn)
        elif quantity.unit == "m" and length_m > 0.0:
            reach = min(length_m, 0.5 * value) if last == "radius" else length_m
            out[path] = value + random.uniform(-reach, reach)
        else:
            out[path] = value * (1.0 + random.uniform(-share, share))
    return out


def plausible(seed: int, number: int) -> Case:
    """Geometry +-2 mm (directions +-0.04 rad), everything else +-50 %, v_t 1e-2..1e-5, forces to 120 N."""
    random = np.random.default_rng([seed, ord("A"), number])
    overrides = varied(random, 2e-3, 0.5, 0.04)
    overrides["friction_threshold.v_t"] = 10 ** random.uniform(-5, -2)
    times, forces = edges(random, random.choice([20.0, 120.0]))
    return Case("A", seed, number, overrides, times, forces)


def abused(seed: int, number: int) -> Case:
    """Geometry +-50 %, no damping, no friction, deep penetration at start, v_t to 1e-6, invalid forces."""
    random = np.random.default_rng([seed, ord("B"), number])
    overrides = varied(random, 0.0 if random.random() < 0.7 else 2e-3, 0.5, 0.5 if random.random() < 0.3 else 0.04)
    overrides["friction_threshold.v_t"] = 10 ** random.uniform(-6, -2)
    overrides["friction_threshold.omega_t"] = 10 ** random.uniform(-5, -1)
    if random.random() < 0.4:
        overrides |= {path: 0.0 for path in overrides if path.endswith("normal.D")}
    if random.random() < 0.4:
        overrides |= {path: 0.0 for path in overrides if path.endswith("friction.A")}
    times, forces = edges(random, 10 ** random.uniform(0, 2.9))
    case = Case("B", seed, number, overrides, times, forces)
    if random.random() < 0.5:
        printed = np.array([0.0286, 0.0251, 0.3198, 0.3523, 0.2951])
        case.angle_rad = (printed + random.uniform(-1, 1, 5) * 10 ** random.uniform(-3, -1)).tolist()
        case.speed_rad_per_s = (random.normal(size=5) * 10 ** random.uniform(-2, 2)).tolist()
    poison = random.random()
    if poison < 0.12:
        bad = [float("nan"), float("inf"), -float("inf"), 1e5][int(random.integers(4))]
        case.expect = "ModelInputError"
        if poison < 0.06:
            case.force_n[int(random.integers(len(forces)))] = bad
        elif poison < 0.08:
            row = int(random.integers(len(times)))
            case.time_s[row] = bad if not np.isfinite(bad) else -bad
            if row == 0 and bad == 1e5:
                case.expect = None  # a table may start this early: the action is at rest until then
        elif poison < 0.10:
            case.angle_rad = [bad] * 5
        else:
            case.overrides[list(overrides)[int(random.integers(len(overrides)))]] = (
                bad if not np.isfinite(bad) else 1e20
            )
    return case


MAKERS = {"A": plausible, "B": abused}


class Runner:
    """A prepared case: gives its states at any times, at any tolerance, with or without a disturbance."""

    def __init__(self, case: Case, what: str = NONE) -> None:
        self.action, choice = changed(case, model.load_action().with_values(case.overrides), what)
        self.times, self.forces = model.check_force_table(case.time_s, case.force_n)
        self.scene = model.build_scene(choice.apply_to(self.action), choice)
        self.at_rest, self.choice, self.what = case.angle_rad is None, choice, what
        n = len(case.speed_rad_per_s)
        angle = solve_rest(self.scene) if case.angle_rad is None else np.append(case.angle_rad, self.scene.start[n:])
        speed = np.append(case.speed_rad_per_s, np.zeros(self.scene.size - n))
        self.start = model.State(float(self.times[0]), angle, speed)

    def solve(self, tolerance: float, *, energy: bool = False, estimate: bool = False) -> model.Solution:
        """The motion at the output times."""
        return model.simulate(
            self.action, self.times, self.forces, scene=self.choice, tolerance=tolerance,
            initial=None if self.at_rest else self.start.copy(), energy=energy, estimate_error=estimate,
            output_time_s=OUTPUT_S,
        )  # fmt: skip

    def states(
        self, at: Array, tolerance: float, kick_s: float | None = None, kick: Array | None = None, steps: int = STEPS
    ) -> tuple[Array, Array]:
        """Angles and speeds at times ``at``; at ``kick_s`` the angles jump by ``kick``."""
        run = model.Simulation(self.scene, self.start.copy(), tolerance=tolerance, max_steps=steps)
        before = at[at < kick_s] if kick_s is not None else at[:0]
        parts = []
        if kick_s is not None and kick is not None:
            parts.append(run.advance(kick_s, self.times, self.forces, output_time_s=before))
            run.state.angle_rad = run.state.angle_rad + kick
        parts.append(run.advance(float(at[-1]), self.times, self.forces, output_time_s=at[len(before) :]))
        angles, speeds = (np.concatenate(part) for part in zip(*parts, strict=True))
        return angles, speeds

    def open_energy(self, tolerance: float) -> tuple[float, model.Solution]:
        """Share of the energy turned over that the audit leaves open, but for rounding, and the run."""
        run = self.solve(tolerance, energy=True)
        assert run.energy is not None
        energy = run.energy
        turned = abs(energy.work_in) + energy.work_in - energy.stored_change - energy.residual
        turned = max(turned, LEAST_TURNOVER_J) if self.what == NONE else turned
        stored = abs(model.Simulation(self.scene, self.start.copy()).stored_energy())
        return max(0.0, abs(energy.residual) - ROUNDING * stored * run.counters["n_steps"]) / turned, run

    def growth(self, enough: float) -> float:
        """Largest growth of a disturbance of the tolerance, of any coordinate; stops where it is ``enough``."""
        largest, fine = 1.0, TOLERANCE / 100.0
        reference = self.states(OUTPUT_S, fine, steps=10 * STEPS)[0]
        for moment, kick in product(KICK_S, TOLERANCE * np.eye(self.scene.size)[:5]):
            off = self.states(OUTPUT_S, fine, moment, kick, steps=10 * STEPS)[0] - reference
            largest = max(largest, float(np.max(np.abs(off[:, :5]))) / TOLERANCE)
            if largest >= enough:
                break
        return largest


EFFECTS = {"string": ("string",), "all": ("balance_rail", "shank", "string")}
FIXED = ("string.modes", "shank.frequency_hz", "shank.hinge", "shank.near")  # what others must fit to


def bushings(case: Case, action: model.Action) -> dict[str, float]:
    """Numbers of the bushings of a case."""
    random, out = np.random.default_rng([case.seed, case.number]), {}
    for effect, body in PINS.items():
        stiffness = 10.0 ** random.uniform(4.0, 7.0)
        out[f"{effect}.stiffness"] = stiffness
        out[f"{effect}.damping"] = random.uniform(0.0, 2.0) * float(np.sqrt(stiffness * action[f"{body}.mass"]))
        out |= {f"{effect}.load.{axis}": random.uniform(-5.0, 5.0) for axis in "xy"}
    return out


def changed(case: Case, action: model.Action, what: str) -> tuple[model.Action, SceneChoice]:
    """The case's action and its scene with what is under test."""
    if what == NONE:
        return action, model.choice_of(action)
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
            if path.endswith("epsilon"):
                high = min(high, 0.98)  # a share of 1 would leave nothing of a force that has faded
            varied[path] = float(np.clip(action[path] * random.uniform(0.5, 1.5), low, high))
    return action.with_effects(varied), choice


def compared(runs: Runner, what: str) -> Row:
    """Outcome beside a tight run, whose energy balance closes."""
    row, coarse, closes = Row(), runs.solve(TOLERANCE), RESIDUAL if what == NONE else CLOSES
    if not np.all(np.isfinite(coarse.angle_rad)):
        return {"outcome": "wrong: lost values without a word"}
    try:
        row["residual"], fine = runs.open_energy(TIGHT)
        if not row["residual"] <= closes:
            row["finer_residual"], _ = runs.open_energy(FINER)
            if not row["finer_residual"] <= closes:
                return row | {"outcome": "wrong: energy"}
        row["error_rad"] = error = float(np.max(np.abs(fine.angle_rad - coarse.angle_rad)[:, :5]))
        if error <= FACTOR * TOLERANCE:
            return row | {"outcome": "right"}
        if runs.solve(TOLERANCE, estimate=True).misses_tolerance:
            return row | {"outcome": "right, a missed tolerance said"}
        row["growth"] = runs.growth(error / TOLERANCE)
        explained = row["growth"] * TOLERANCE >= error
        return row | {"outcome": "missed, growth explains it" if explained else "wrong: missed silently"}
    except model.IntegrationError as problem:
        return row | {"outcome": "finished, but not where it is computed more finely", "detail": str(problem)}


def judge(case: Case, what: str = NONE) -> Row:
    """Outcome of one case, with its figures; never raises, except on interruption."""
    row, refused = Row(number=case.number, outcome="finished"), None
    try:
        row |= compared(Runner(case, what), what)
    except model.ModelError as problem:
        refused, detail = type(problem).__name__, str(problem)
        one_line = "\n" not in detail and len(detail) >= 20
        row |= {"outcome": f"refused: {refused}" if one_line else "wrong: refused without one line of advice"}
        row["detail"] = detail
    except Exception as problem:  # exactly what this benchmark looks for
        row |= {"outcome": f"wrong: untyped {type(problem).__name__}", "detail": str(problem)}
    if case.expect not in (None, refused) and not row["outcome"].startswith("wrong"):
        row["detail"] = f"must end in {case.expect}; was {row['outcome']}"
        row["outcome"] = "wrong: not refused as it must be"
    return row


def judged(name: str, what: str, seed: int, number: int) -> Row:
    """One case as plain data."""
    warnings.simplefilter("ignore")
    return judge(MAKERS[name](seed, number), what)


def report(name: str, what: str, rows: list[Row]) -> bool:
    """Print the outcomes of one set; whether they meet the requirements."""
    tally = Counter(row["outcome"] for row in rows)
    print(f"\nset {name}, {what}: {len(rows)} cases")
    for outcome, n in tally.most_common():
        print(f"  {n:6d}  {100 * n / len(rows):7.3f} %  {outcome}")
    for row in rows:
        if row["outcome"].startswith(("wrong", "missed", "finished,")):
            print("  " + ", ".join(f"{k} {v:.2e}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()))
    wrong, refused = (sum(n for outcome, n in tally.items() if outcome.startswith(w)) for w in ("wrong", "refused"))
    if ran := len(rows) - refused:
        top, worst = at_most(wrong, ran), max(float(row.get("residual", 0.0)) for row in rows)
        print(f"  {wrong} of {ran} that ran are wrong: at most {100 * top:.2g} % (95 %, one-sided)")
        print(f"  worst energy residual {worst:.1e} of what was turned over")
    return not wrong and (name != "A" or what != NONE or ran >= LEAST_SHARE * len(rows))


def main(run: Run) -> bool:
    """Run the sets asked for; whether all meet the requirements."""
    good = True
    for name, what in product(run.set, getattr(run, "with")):
        keys = [(name, what, run.seed, number) for number in range(run.count)]
        rows = [row for _, row in run.cases(keys, judged, run.workers)]
        good &= bool(rows) and report(name, what, rows)
    return good
