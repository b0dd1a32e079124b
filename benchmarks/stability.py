"""Does every plausible action run, and does every absurd one give a correct result or a typed error?

    python -m benchmarks stability [--count 10000] [--seed 1] [--set A,B] [--workers 2] [--case N]

Set A (plausible): geometry +-2 mm, everything else +-50 %, v_t 1e-2..1e-5, forces to 120 N with 0.2 ms edges; at
least 99.9 % must finish. Set B (abuse): geometry +-50 %, no damping, no friction, deep penetration at start,
v_t to 1e-6, NaN and infinite force; each must give a correct result or a typed error with advice.
Correct means: the energy balance, computed independently of the compiled equations, closes to 1e-4 of the turnover;
and, for at least one case in twenty, the angles agree with a run at a hundredth of the tolerance.
No case can hang: steps are bounded. A case is plain data generated from (set, seed, number); ``--case`` runs one alone,
against a finer run, and prints all that is known of it.

A case states which parameters differ from the printed action, which force acts, where the motion starts and which
error it must raise if it cannot run. `run_case` never raises: the outcome is in the result.
Angles within `FACTOR` times the tolerance of a run at a hundredth of it count as correct; otherwise the growth of a
disturbance as large as the tolerance, measured with that finer run, must explain the difference.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from benchmarks.runner import Run
from tests.model.verification.energy_audit import Audit, audit

Array = NDArray[np.float64]

LEAST_SHARE = 0.999  # of set A
ONE_IN = {"A": 20, "B": 8}  # cases checked against a finer run if they finish
TOLERANCE = 1e-5  # rad
FACTOR = 10.0  # error allowed, in tolerances
RESIDUAL = 1e-4  # allowed energy residual, in turnovers
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


@dataclass
class Result:
    """Outcome of a case: ``finished``, ``refused`` (typed, explained), or what is wrong with it."""

    set: str
    number: int
    outcome: str
    detail: str = ""
    seconds: float = 0.0
    steps: int = 0
    residual: float = 0.0
    quadrature: float = 0.0
    difference: float | None = None  # rad, from the finer run
    growth: float | None = None  # of a disturbance, where the difference needed an explanation


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
        case.expect = "InputError"
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

    def __init__(self, case: Case) -> None:
        self.action = model.load_action().with_values(case.overrides)
        self.times, self.forces = model.check_force_table(case.time_s, case.force_n)
        self.scene = model.build_scene(self.action)
        angle = model.rest_state(self.action).angle_rad if case.angle_rad is None else np.array(case.angle_rad)
        self.start = model.State(float(self.times[0]), angle, np.array(case.speed_rad_per_s))
        self.steps = 0

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
        self.steps = run.work()["n_steps"] + run.work()["n_rejected"]
        angles, speeds = (np.concatenate(part) for part in zip(*parts, strict=True))
        return angles, speeds

    def growth(self, reference: Array, fine: float, enough: float, together: bool = True) -> float:
        """Largest growth of a disturbance of the tolerance; stops where it is ``enough``.

        ``reference`` (401, 5), rad, is the motion at the tolerance ``fine``; ``together``: growths of all coordinates
        add up, else the largest counts.
        """
        largest = 1.0
        for moment in KICK_S:
            moved = 0.0
            for kick in TOLERANCE * np.eye(5):
                off = self.states(OUTPUT_S, fine, moment, kick, steps=10 * STEPS)[0] - reference
                moved = (moved if together else 0.0) + float(np.max(np.abs(off)))
                largest = max(largest, moved / TOLERANCE)
                if largest >= enough:
                    return largest
        return largest


def check_energy(runner: Runner, tolerance: float) -> Audit:
    """Energy balance of the whole run."""
    end = float(runner.times[-1])
    return audit(
        runner.action, lambda at: runner.states(at, tolerance), (0.0, end), (runner.times, runner.forces),
        goal=0.03 * RESIDUAL, panel_s=1e-3,
    )  # fmt: skip


def check_finer(runner: Runner, result: Result) -> None:
    """Compare with a hundredth of the tolerance; set difference, growth and, if necessary, the outcome."""
    fine = TOLERANCE / 100.0
    coarse = runner.states(OUTPUT_S, TOLERANCE)[0]
    try:
        reference = runner.states(OUTPUT_S, fine, steps=10 * STEPS)[0]
        result.difference = float(np.max(np.abs(coarse - reference)))
        if result.difference <= FACTOR * TOLERANCE:
            return
        result.growth = runner.growth(reference, fine, result.difference / (FACTOR * TOLERANCE))
    except model.IntegrationError as problem:
        result.detail = f"at {fine:g} rad: {problem}"
        return
    if result.difference > FACTOR * TOLERANCE * result.growth:
        result.outcome = "wrong: differs from the finer run"
        result.detail = (
            f"by {result.difference:.2g} rad, a disturbance of {TOLERANCE:g} rad grows {result.growth:.3g}-fold"
        )


def run_case(case: Case, finer: bool = False) -> Result:
    """Run one case and judge it; never raises, except on interruption."""
    result = Result(case.set, case.number, "finished")
    begin = time.perf_counter()
    try:
        runner = Runner(case)
        end = float(runner.times[-1])
        angles, speeds = runner.states(np.linspace(0.0, end, 41), TOLERANCE)
        result.seconds, result.steps = time.perf_counter() - begin, runner.steps
        if not (np.all(np.isfinite(angles)) and np.all(np.isfinite(speeds))):
            result.outcome = "wrong: lost values without a word"
        else:
            balance = check_energy(runner, TOLERANCE)
            share = min(1.0, balance.turnover_j / LEAST_TURNOVER_J)
            result.residual, result.quadrature = share * balance.residual, share * balance.quadrature
            if not result.residual - result.quadrature <= RESIDUAL:
                result.outcome = "wrong: energy balance open"
                result.detail = (
                    f"{result.residual:.2g} of {balance.turnover_j:.2g} J, integration {result.quadrature:.1g}"
                )
            elif finer:
                check_finer(runner, result)
    except model.ModelError as problem:
        result.seconds = time.perf_counter() - begin
        result.outcome, result.detail = f"refused: {type(problem).__name__}", str(problem)
        if "\n" in result.detail or len(result.detail) < 20:
            result.outcome = "wrong: refused without one line of advice"
    except Exception as problem:  # exactly what this benchmark looks for
        result.outcome, result.detail = f"wrong: untyped {type(problem).__name__}", str(problem)
    refused = result.outcome.removeprefix("refused: ") if result.outcome.startswith("refused") else None
    if case.expect is not None and refused != case.expect and not result.outcome.startswith("wrong"):
        result.detail = f"must end in {case.expect}; was {result.outcome}. {result.detail}"
        result.outcome = "wrong: not refused as it must be"
    return result


def save_case(case: Case, result: Result, path: Path) -> None:
    """Write a case and its outcome as JSON (with NaN and Infinity as Python writes them)."""
    path.write_text(json.dumps({"case": asdict(case), "result": asdict(result)}, indent=1), encoding="utf-8")


def load_case(path: Path) -> Case:
    """Read a case written by `save_case`."""
    return Case(**json.loads(path.read_text(encoding="utf-8"))["case"])


def judged(name: str, seed: int, number: int, always: bool = False) -> dict[str, Any]:
    """One case as plain data; ``always`` against a finer run."""
    return asdict(run_case(MAKERS[name](seed, number), finer=always or number % ONE_IN[name] == 0))


def report(name: str, results: list[Result]) -> bool:
    """Print the results of one set; return whether they meet the requirements."""
    count = len(results)
    tally = Counter(r.outcome for r in results)
    finished = [r for r in results if r.outcome == "finished"]
    wrong = sum(n for outcome, n in tally.items() if outcome.startswith("wrong"))
    print(f"\nset {name}: {count} cases")
    for outcome, n in tally.most_common():
        print(f"  {n:6d}  {100 * n / count:7.3f} %  {outcome}")
    if not finished:
        return wrong == 0
    slow, heavy = max(results, key=lambda r: r.seconds), max(finished, key=lambda r: r.steps)
    loose = max(finished, key=lambda r: r.residual)
    print(f"  longest run time         {slow.seconds:.2f} s (case {slow.number}, {slow.outcome})")
    print(f"  most steps of a finished {heavy.steps} (case {heavy.number})")
    print(f"  worst energy residual    {loose.residual:.1e} of the turnover (case {loose.number})")
    checked = [r for r in finished if r.difference is not None]
    if checked:
        plain = [r for r in checked if r.growth is None]
        grown = [r for r in checked if r.growth is not None]
        print(
            f"  checked at {TOLERANCE / 100:g} rad     {len(checked)} cases: {len(plain)} within {FACTOR:g} tolerances"
        )
        print(f"    {len(grown)} more explained by the growth of a disturbance of {TOLERANCE:g} rad:")
        for r in sorted(grown, key=lambda r: r.growth or 0.0)[:20]:
            print(f"    case {r.number}: {r.difference:.1e} rad off, growth {r.growth:.1e}")
    for r in (r for r in results if r.detail and (r.outcome == "finished" or r.outcome.startswith("wrong"))):
        print(f"    case {r.number}: {r.outcome}: {r.detail}")
    if name == "A":
        return wrong == 0 and len(finished) >= LEAST_SHARE * count
    return wrong == 0


def main(run: Run) -> bool:
    """Run the sets asked for; whether all meet the requirements."""
    if run.case >= 0:
        rows = [judged(name, run.seed, run.case, always=True) for name in run.set]
        print("\n".join(f"{key:10} {value}" for row in rows for key, value in row.items()))
        return not any(row["outcome"].startswith("wrong") for row in rows)
    good = True
    for name in run.set:
        keys = [(name, run.seed, number) for number in range(run.count)]
        results = [Result(**row) for _, row in run.cases(keys, judged, run.workers)]
        good &= report(name, results) if results else False
    return good
