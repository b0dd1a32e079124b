"""Every sentence of a session's report beside what was planted in the session, to be read one by one.

    python -m benchmarks what_is_said [--only WORD,…] [--seed 1] [--explain] [--budget]

Eighty sessions of the virtual bench, twenty of each kind: effects that the model lacks, glitches of one channel, odd
sessions, and clean ones; sizes, times, trials and strokes are drawn by the seed. Each case names itself, what is true
of it, and words that no sentence may hold; the answer is right where none of them is said. The rest must be read.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import model
from benchmarks.bench_strokes import (
    BEFORE_S,
    CHANNELS,
    FILMED,
    Change,
    Stroke,
    film,
    force,
    louder,
    recount,
    stroke_of,
    swapped,
)
from benchmarks.runner import Run
from rig.session import Session, SessionInfo, TrialData
from rig.session.info import FileInfo
from validation import compare as compare_session
from validation.prediction.input_sampling import parameter_draws

CAUSES = (
    "not regulated", "let-off button", "drop screw", "its scale is wrong", "scale of one of them", "lifts off",
    "frame times are", "is faulty", "was disturbed", "may have changed", "clocks differ", "counts were lost",
    "zero drifts", "is wired", "its friction is not",
)  # fmt: skip
"""Words of a cause: no finding says why."""
FORCE = len(CHANNELS)  # number of the force among the channels


def no_change(data: TrialData, _: Stroke) -> TrialData:
    return data


@dataclass(frozen=True)
class Case:
    """A session: what is true of it, and how a trial is played and misread."""

    kind: str  # effect, glitch, odd or clean
    truth: str  # what was planted, for the reader
    strokes: Sequence[str]  # kind of stroke of each trial
    play: Callable[[int], dict[str, Any]] = lambda number: {}  # trial number → `bench_strokes.StrokeOptions`
    misread: Callable[[int], Change] = lambda number: no_change  # trial number → what is wrong with its record
    filmed: bool = False
    specimen: str = "printed"
    named: dict[str, float] = field(default_factory=dict)  # what the compared model has beside the printed action
    never: tuple[str, ...] = ()  # words that no sentence may hold, beside `CAUSES`


def in_trials(numbers: Sequence[int], change: Change) -> Callable[[int], Change]:
    return lambda number: change if number in numbers else no_change


def remade(i: int, made: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Change:
    """Another reading of a channel, of that (rad or N) and the time."""
    if i == FORCE:
        return force(made)

    def change(data: TrialData, _: Stroke) -> TrialData:
        unit = data.encoders[i].rad_per_count
        other = np.arange(FORCE) != i
        return recount(data, lambda c: np.where(other, c, np.rint(made(c[:, i] * unit, data.time_s) / unit)[:, None])
                       .astype(np.int64))  # fmt: skip

    return change


def frozen(i: int, at_s: float, length_s: float) -> Change:
    """A reading that stays the same."""
    return remade(
        i, lambda x, t: np.where((t >= at_s) & (t < at_s + length_s), x[min(np.searchsorted(t, at_s), x.size - 1)], x)
    )


def spiked(i: int, at_s: float, length_s: float, by: float) -> Change:
    """A reading that leaps and comes back."""
    return remade(i, lambda x, t: x + by * ((t >= at_s) & (t < at_s + length_s)))


def part_of_record(start_s: float, end_s: float) -> Change:
    """A record of a part of the stroke, times from zero."""

    def change(data: TrialData, _: Stroke) -> TrialData:
        keep = (data.time_s >= start_s) & (data.time_s < end_s)
        parts = {name: getattr(data, name)[keep] for name in ("raw_force_n", "force_raw", "motor_command_v")}
        time, count = data.time_s[keep], data.encoder_count[keep]
        begins_s = max(data.blow_start_s - start_s, 0.0)
        return replace(data, time_s=time - time[0], encoder_count=count - count[0], blow_start_s=begins_s, **parts)

    return change


def changed(by: dict[str, float], numbers: Sequence[int] | None = None) -> Callable[[int], dict[str, Any]]:
    """Parameters of the specimen with what is added, in all trials or in some."""
    return lambda number: {"changed": tuple(by.items())} if numbers is None or number in numbers else {}


LET_OFF, CHECK, STRING = "contact08.second.y", "contact04.second.x", "contact12.second.y"
MOVED_M = {LET_OFF: 1e-3, CHECK: 3e-3, "contact11.first.y": 1e-3, STRING: 3e-3, "contact02.second.y": 0.8e-3}
SCALED = {"key.joint_friction.A": 1.0, "contact07.friction.A": 0.6, "contact10.friction.A": 0.5, "hammer.mass": 0.08,
          "repetition_spring.stiffness": 0.2}  # fmt: skip  # largest change: m above, here a share of the value
LACKING = ("shank", "string", "balance_rail", "key_pin", "whippen_pin", "jack_pin", "repetition_pin", "hammer_pin",
           "shank string", "balance_rail hammer_pin")  # fmt: skip
LOUD = ("mf", "rebound", "ff2", "forte", "double", "staccato", "fortissimo")
SOFT = ("piano", "slow")


def lacking(rng: np.random.Generator) -> dict[str, Case]:
    """Effects that the model lacks, and values of the action that differ."""
    out = {}
    for name in LACKING:
        truth = f"the specimen has {name}; all encoders and the force are sound"
        given = {"effects": tuple(name.split())}
        out[name] = Case("effect", truth, 6 * [rng.choice(LOUD)], lambda n, given=given: given)
    printed = model.load_action()
    for path, most in (MOVED_M | SCALED).items():
        by = most * rng.uniform(0.3, 1.0) * (1.0 if path in SCALED else rng.choice([-1.0, 1.0]))
        truth = f"{path} " + (f"× {1 + by:.3f}" if path in SCALED else f"{1e3 * by:+.2f} mm")
        play = changed({path: by * (printed[path] if path in SCALED else 1.0)})
        out[path] = Case("effect", truth, 6 * [rng.choice(LOUD)], play)
    return out


def glitches(rng: np.random.Generator) -> dict[str, Case]:
    """Freezes, spikes, slips, drifts and swaps of a channel, in one trial or from one on."""
    out = {}
    for name in ("freeze", "spike", "slip", "drift"):
        for i, channel in enumerate((*CHANNELS, "force")):
            k, at_s, length_s = int(rng.integers(1, 7)), rng.uniform(0.26, 0.5), 1e-3 * rng.uniform(5.0, 50.0)
            numbers = range(k, 7) if rng.random() < 0.5 else [k]
            by = rng.choice([-1.0, 1.0]) * (rng.uniform(1.0, 6.0) if i == FORCE else 1e-3 * rng.uniform(2.0, 20.0))
            size = f"{by:+.1f} N" if i == FORCE else f"{1e3 * by:+.1f} mrad"
            change, words = {
                "freeze": (frozen(i, at_s, length_s), f"constant for {1e3 * length_s:.0f} ms from {at_s:.3f} s"),
                "spike": (spiked(i, at_s, length_s, by), f"{size} for {1e3 * length_s:.0f} ms from {at_s:.3f} s"),
                "slip": (spiked(i, at_s, np.inf, by), f"{size} from {at_s:.3f} s on"),
                "drift": (remade(i, lambda x, t, by=by: x + by * t / t[-1]), f"{size} linearly over the record"),
            }[name]
            truth = f"{channel} {words} in trials {list(numbers)} of 6"
            misread, never = in_trials(numbers, change), ("rail",) if name == "freeze" else ()
            out[f"{name} {channel}"] = Case("glitch", truth, 6 * [rng.choice(LOUD)], misread=misread, never=never)
    for i, j in ((0, 1), (1, 2), (0, 2)):
        k, both = int(rng.integers(2, 6)), f"{CHANNELS[i]} {CHANNELS[j]}"
        truth, misread = f"encoders {both} swapped from trial {k} of 6 on", in_trials(range(k, 7), swapped(i, j))
        out[f"swap {both}"] = Case("glitch", truth, 6 * [rng.choice(LOUD)], misread=misread)
    at_s = rng.uniform(0.26, 0.33)
    truth, misread = f"whippen constant for 30 ms from {at_s:.3f} s in the filmed trial {FILMED}", frozen(1, at_s, 0.03)
    out["freeze whippen filmed"] = Case(
        "glitch", truth, 6 * ["mf"], misread=in_trials([FILMED], misread), filmed=True, never=("early", "late")
    )
    return out


def odd(rng: np.random.Generator) -> dict[str, Case]:
    """Odd sessions."""
    one, other = rng.choice(["mf", "ff2", "forte"], 2, replace=False)
    k, few = int(rng.integers(2, 6)), int(rng.integers(2, 4))
    late, mm = range(k, 7), 1e-3 * rng.uniform(0.5, 1.0)
    in_k, six = f"in trial {k} of 6", 6 * [one]
    down_s, end_s = rng.uniform(0.38, 0.42), BEFORE_S + rng.uniform(0.12, 0.2)
    return {
        "two kinds": Case("odd", f"three {one}, three {other}", 3 * [one] + 3 * [other]),
        "one of another kind": Case("odd", f"piano {in_k}, else {one}", [*(k - 1) * [one], "piano", *(6 - k) * [one]]),
        "four kinds": Case("odd", "four kinds, twice each", [*2 * ["forte"], *2 * ["piano"], *2 * ["double"],
                                                             *2 * ["staccato"]]),
        "each its own": Case("odd", "forte, piano, double, once each", ["forte", "piano", "double"]),
        "one trial": Case("odd", "nothing; one trial", [one]),
        "few trials": Case("odd", f"nothing; {few} trials", few * [one]),
        "soft, no let-off": Case("odd", "strokes so soft that they do not let off", 5 * ["piano"],
                                 lambda n: {"strength": 0.6}),
        "double strikes": Case("odd", "nothing; each trial strikes twice", 5 * ["double"]),
        "let-off from k": Case("odd", f"{LET_OFF} {1e3 * mm:+.2f} mm from trial {k} of 6 on", six,
                               changed({LET_OFF: mm}, late)),
        "check from k": Case("odd", f"{CHECK} -3 mm from trial {k} of 6 on", six, changed({CHECK: -3e-3}, late)),
        "ends before release": Case("odd", f"all trials end at {end_s:.3f} s, before the release", six,
                                    misread=lambda n: part_of_record(0.0, end_s)),
        "ends before let-off": Case("odd", "all trials end 35 ms after the onset", six,
                                    misread=lambda n: part_of_record(0.0, BEFORE_S + 0.035)),
        "one cut short": Case("odd", f"ends at {end_s:.3f} s {in_k}", six,
                              misread=in_trials([k], part_of_record(0.0, end_s))),
        "key down in one": Case("odd", f"begins at {down_s:.3f} s, key down, {in_k}", six,
                                misread=in_trials([k], part_of_record(down_s, np.inf))),
        "another action named": Case("odd", "the model's string hangs 8 mm lower, its hammer weighs 1.2 of the true",
                                     six, named={STRING: -8e-3, "hammer.mass": 2.3e-3}),
        "weak one": Case("odd", f"strength × 0.7 {in_k}", six, lambda n: {"strength": 0.7} if n == k else {}),
        "late one": Case("odd", f"played 20 ms later {in_k}", six, lambda n: {"late_s": 0.02} if n == k else {}),
        "louder each time": Case("odd", "strength grows from 0.9 to 1.15", six,
                                 lambda n: {"strength": 0.85 + 0.05 * n}),
        "force reversed": Case("odd", "the force's sign is wrong in all", six, misread=lambda n: louder(-1.0)),
        "another rate": Case("odd", f"sampled at 4 kHz {in_k}", six, lambda n: {"rate_hz": 4000.0} if n == k else {}),
    }  # fmt: skip


def clean(rng: np.random.Generator) -> dict[str, Case]:
    """Sessions without a fault: the printed specimen, the bench's own, and specimens drawn from their priors."""
    strokes = rng.permutation([*LOUD, *SOFT, *LOUD, *SOFT, "mf", "piano"])
    trials = rng.permutation([*range(1, 13), *range(3, 11)])
    printed, out = model.load_action(), {}
    for j, (stroke, n) in enumerate(zip(strokes, trials, strict=True)):
        by = {p: x - printed[p] for p, x in parameter_draws(printed, 1, rng)[0].items()} if j % 2 else {}
        specimen, words = ("bench", "the bench's own") if j % 10 == 0 else ("printed", "the printed")
        truth = f"nothing; {'a drawn' if by else words} specimen, {n} × {stroke}"
        out[f"clean {j + 1}"] = Case("clean", truth, n * [str(stroke)], changed(by), specimen=specimen)
    return out


@cache
def cases(seed: int) -> dict[str, Case]:
    """The eighty cases of a seed by name."""
    made = [make(np.random.default_rng([seed, i])) for i, make in enumerate((lacking, glitches, odd, clean))]
    return {name: case for group in made for name, case in group.items()}


def make_session(case: Case, seed: int, folder: Path) -> Session:
    """A session of a case."""
    rng = np.random.default_rng(seed)
    info = SessionInfo(simulated=True, name="planted", operator="bench", rig=FileInfo(name="none"),
                       profile=FileInfo(name=case.strokes[0]))  # fmt: skip
    session = Session.create(folder / "session", info)
    for number, kind in enumerate(case.strokes, 1):
        stroke = stroke_of(str(kind), seed, number, case.specimen, tuple(sorted(case.play(number).items())))
        data, table = case.misread(number)(stroke.data, stroke), None
        if case.filmed and number == FILMED:
            camera, table = film(stroke, 0.0, rng)
            data = replace(data, camera=camera)
        session.add_trial(data)
        if table is not None:
            session.write_derived("angles", number, table)
    return session


def sentences(name: str, seed: int, explain: bool, budget: bool) -> dict[str, list[str]]:
    """All that the report of a case says."""
    case, printed = cases(seed)[name], model.load_action()
    with tempfile.TemporaryDirectory() as folder:
        session = make_session(case, seed, Path(folder))
        action = printed.with_values({path: printed[path] + by for path, by in case.named.items()})
        result = compare_session(session, action, keep_predictions=False, budget=budget, explain=explain)
    return {
        "finding": list(result.findings["text"]),
        "warning": [text for text in result.warnings if text not in set(result.findings["text"])],
        "verdict": list(result.verdict_lines),
        "marked": [f"trial {row.trial}: {row.reason}" for row in result.marked.itertuples()],
    }


def main(run: Run) -> bool:
    """Print every sentence beside what was planted; whether no word was said that may not be said."""
    asked = {
        name: case for name, case in cases(run.seed).items()
        if not run.only or any(word in f"{case.kind} {name}" for word in run.only)
    }  # fmt: skip
    right = True
    for (name, *_), said in run.cases([(name, run.seed, run.explain, run.budget) for name in asked], sentences):
        case = asked[name]
        print(f"\n=== {case.kind:6} | {name} ({case.strokes[0]}, seed {run.seed}) | planted: {case.truth}", flush=True)
        for where, lines in said.items():
            for line in lines:
                wrong = [word for word in (*CAUSES, *case.never) if word in line]
                print(f"  {where}: {line}" + (f"  <<< {', '.join(wrong)}" if wrong else ""))
                right &= not wrong
    return right
