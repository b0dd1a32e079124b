"""Every sentence of a session's report beside what was planted in the session, to be read one by one.

    python -m benchmarks what_is_said [--only WORD,…] [--seed 1] [--strokes mf,rebound] [--suspect]

Sessions are strokes of the virtual bench: effects that the model lacks, glitches of one channel, odd sessions, and
clean ones. Each case names itself, what is true of it, and words that no sentence may hold; the benchmark's answer is
right where none of them is said. The rest must be read.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
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

CAUSES = (
    "not regulated", "let-off button", "drop screw", "its scale is wrong", "scale of one of them", "lifts off",
    "frame times are", "is faulty", "was disturbed", "may have changed", "clocks differ", "counts were lost",
    "zero drifts", "is wired", "its friction is not",
)  # fmt: skip
"""Words of a cause: no finding says why."""


def no_change(data: TrialData, _: Stroke) -> TrialData:
    return data


@dataclass(frozen=True)
class Case:
    """A session: what is true of it, and how a trial is played and misread.

    Attributes
    ----------
    truth : what was planted, for the reader
    play : trial number → options of the stroke (`bench_strokes.StrokeOptions`)
    misread : trial number → what is wrong with its record
    kind : trial number → kind of stroke, empty for the one that is asked for
    trials : how many
    never : words that no sentence may hold, beside `CAUSES`
    """

    truth: str
    play: Callable[[int], dict[str, Any]] = lambda number: {}
    misread: Callable[[int], Change] = lambda number: no_change
    kind: Callable[[int], str] = lambda number: ""
    trials: int = 6
    filmed: bool = False
    never: tuple[str, ...] = ()
    stroke: str = ""
    options: dict[str, Any] = field(default_factory=dict)


def only(numbers: Sequence[int], change: Change) -> Callable[[int], Change]:
    return lambda number: change if number in numbers else no_change


def since(first: int, change: Change) -> Callable[[int], Change]:
    return lambda number: change if number >= first else no_change


def frozen(i: int, start_s: float, length_s: float) -> Change:
    """An encoder that holds its count."""

    def change(data: TrialData, _: Stroke) -> TrialData:
        inside = (data.time_s >= start_s) & (data.time_s < start_s + length_s)

        def columns(c: np.ndarray) -> np.ndarray:
            c[inside, i] = c[np.flatnonzero(inside)[0], i]
            return c

        return recount(data, columns)

    return change


def spiked(i: int, at_s: float, length_s: float, rad: float) -> Change:
    """A reading that leaps and comes back."""

    def change(data: TrialData, _: Stroke) -> TrialData:
        inside = (data.time_s >= at_s) & (data.time_s < at_s + length_s)
        by = round(rad / abs(data.encoders[i].rad_per_count))
        return recount(data, lambda c: c + by * np.outer(inside, np.arange(3) == i).astype(np.int64))

    return change


def slipped_at(i: int, at_s: float, rad: float) -> Change:
    """A reading that leaps and stays."""
    return spiked(i, at_s, 100.0, rad)


def drifting_encoder(i: int, rad: float) -> Change:
    """A reading that drifts linearly over the record."""

    def change(data: TrialData, _: Stroke) -> TrialData:
        by = rad / abs(data.encoders[i].rad_per_count) * data.time_s / data.time_s[-1]
        return recount(data, lambda c: c + np.outer(np.round(by), np.arange(3) == i).astype(np.int64))

    return change


def force_held(start_s: float, length_s: float) -> Change:
    return force(lambda f, t: np.where((t >= start_s) & (t < start_s + length_s), f[np.searchsorted(t, start_s)], f))


def force_spike(at_s: float, newton: float, length_s: float) -> Change:
    return force(lambda f, t: f + newton * ((t >= at_s) & (t < at_s + length_s)))


def key_down_from(start_s: float) -> Change:
    """A record that begins in mid-stroke, times from zero."""

    def change(data: TrialData, _: Stroke) -> TrialData:
        keep = data.time_s >= start_s
        count = data.encoder_count[keep]
        parts = {name: getattr(data, name)[keep] for name in ("force_n", "force_raw", "motor_command_v")}
        time = data.time_s[keep]
        return replace(data, time_s=time - time[0], encoder_count=count - count[0], blow_start_s=0.0, **parts)

    return change


def ends_at(end_s: float) -> Change:
    def change(data: TrialData, _: Stroke) -> TrialData:
        keep = data.time_s < end_s
        parts = ("time_s", "force_n", "force_raw", "motor_command_v", "encoder_count")
        return replace(data, **{name: getattr(data, name)[keep] for name in parts})

    return change


def effect(*names: str) -> Callable[[int], dict[str, Any]]:
    return lambda number: {"effects": names}


def changed(**by: float) -> Callable[[int], dict[str, Any]]:
    return lambda number: {"changed": tuple((path.replace("__", "."), value) for path, value in by.items())}


LET_OFF, CHECK = "contact08.second.y", "contact04.second.x"


def lacking() -> dict[str, Case]:
    """Effects that the model lacks, and values of the action that differ."""
    out = {}
    for name in ("shank", "string", "balance_rail", "hammer_pin"):
        out[f"effect {name}"] = Case(f"the specimen has {name}; all encoders and the force are sound", effect(name))
    for path, by in ((LET_OFF, 0.9e-3), (LET_OFF, -0.6e-3), (CHECK, 1e-3), (CHECK, 3e-3)):
        words = f"{path} {1e3 * by:+g} mm"
        out[f"changed {words}"] = Case(words, changed(**{path.replace(".", "__"): by}))
    for path, factor in (("key.joint_friction.A", 2.0), ("contact07.friction.A", 1.6), ("hammer.mass", 1.06)):
        words = f"{path} × {factor}"
        out[f"changed {words}"] = Case(words, lambda n, f=(path, factor): {"friction": f})
    return out


def glitches() -> dict[str, Case]:
    """Freezes, spikes, slips, drifts and swaps of one channel, in one trial or from one on."""
    out = {}
    for i, c in enumerate(CHANNELS):
        for ms, at in ((5, 0.30), (15, 0.32), (50, 0.28)):
            truth, misread = f"constant for {ms} ms from {at} s in trial 3", only([3], frozen(i, at, 1e-3 * ms))
            never = "rail", "force comes"
            out[f"freeze {c} {ms} ms"] = Case(f"encoder {c} {truth}", misread=misread, filmed=i == 1, never=never)
        for name, truth, misread in (
            ("spike {}", "leaps by 20 mrad for 6 ms at 0.30 s in trial 2", only([2], spiked(i, 0.30, 6e-3, 0.02))),
            ("slip {} from 4", "slips by 8 mrad at 0.31 s in trials 4 to 6", since(4, slipped_at(i, 0.31, 8e-3))),
            ("slip {} 2 mrad", "slips by 2 mrad at 0.33 s in trial 5", only([5], slipped_at(i, 0.33, 2e-3))),
            ("drift {} from 3", "drifts by 10 mrad in trials 3 to 6", since(3, drifting_encoder(i, 10e-3))),
        ):
            out[name.format(c)] = Case(f"encoder {c} {truth}", misread=misread)
    for i, j in ((0, 1), (1, 2)):
        both = f"{CHANNELS[i]} {CHANNELS[j]}"
        out[f"swap {both} from 4"] = Case(f"encoders {both} swapped in trials 4 to 6", misread=since(4, swapped(i, j)))
    held, spike = only([2], force_held(0.3, 0.02)), only([4], force_spike(0.33, 6.0, 1e-3))
    out["force held 20 ms"] = Case("force constant for 20 ms from 0.30 s in trial 2", misread=held)
    out["force spike"] = Case("force + 6 N for 1 ms at 0.33 s in trial 4", misread=spike)
    return out


def kinds(*names: str) -> Callable[[int], str]:
    return lambda number: names[number - 1]


def odd() -> dict[str, Case]:
    """Odd sessions."""
    four = ("forte", "forte", "piano", "piano", "double", "double", "staccato", "staccato")
    return {
        "two kinds": Case("three mf, three ff2", kind=kinds(*3 * ["mf"], *3 * ["ff2"])),
        "one of another kind": Case("five mf, trial 4 piano", kind=kinds("mf", "mf", "mf", "piano", "mf", "mf")),
        "four kinds": Case("forte, piano, double, staccato twice each", trials=8, kind=kinds(*four)),
        "each its own": Case("forte, piano, double, once each", trials=3, kind=kinds(*four[::2])),
        "two trials": Case("nothing; two trials", trials=2),
        "one trial": Case("nothing; one trial", trials=1),
        "one cut short": Case("trial 5 ends 0.1 s after the onset", misread=only([5], ends_at(BEFORE_S + 0.1))),
        "key down in one": Case("trial 3 begins at 0.40 s, key down", misread=only([3], key_down_from(0.40))),
        "weak one": Case("trial 2 × 0.7", lambda n: {"strength": 0.7} if n == 2 else {}),
        "late one": Case("trial 6 is played 20 ms later", lambda n: {"late_s": 0.02} if n == 6 else {}),
        "louder each time": Case("strength grows from 0.9 to 1.15", lambda n: {"strength": 0.85 + 0.05 * n}),
        "key and hammer swapped": Case("encoders key and hammer swapped in all", misread=lambda n: swapped(0, 2)),
        "force reversed": Case("the force's sign is wrong in all", misread=lambda n: louder(-1.0)),
        "rate": Case("trial 2 sampled at 4 kHz", lambda n: {"rate_hz": 4000.0} if n == 2 else {}),
    }


def cases() -> dict[str, Case]:
    """All cases by name."""
    strokes = "mf", "rebound", "ff2", "forte", "piano", "double", "staccato", "slow"
    clean = {f"clean {kind}": Case("nothing", stroke=kind) for kind in strokes}
    own, options = "the bench's own specimen: ten values differ", {"specimen": "bench"}
    bench = {f"bench {kind}": Case(own, stroke=kind, options=options) for kind in ("mf", "ff2", "piano")}
    return lacking() | glitches() | odd() | clean | bench


def make_session(case: Case, kind: str, seed: int, folder: Path) -> Session:
    """A session of a case."""
    rng = np.random.default_rng(seed)
    info = SessionInfo(simulated=True, name="planted", operator="bench", rig=FileInfo(name="none"),
                       profile=FileInfo(name=kind))  # fmt: skip
    session = Session.create(folder / "session", info)
    specimen = case.options.get("specimen", "printed")
    for number in range(1, case.trials + 1):
        played = tuple(sorted(case.play(number).items()))
        stroke = stroke_of(case.kind(number) or kind, seed, number, specimen, played)
        data, table = case.misread(number)(stroke.data, stroke), None
        if case.filmed and number == FILMED:
            camera, table = film(stroke, 0.0, rng)
            data = replace(data, camera=camera)
        session.add_trial(data)
        if table is not None:
            session.write_derived("angles", number, table)
    return session


def sentences(name: str, kind: str, seed: int, suspect: bool, budget: bool) -> dict[str, list[str]]:
    """All that the report of a case says."""
    with tempfile.TemporaryDirectory() as folder:
        session = make_session(cases()[name], kind, seed, Path(folder))
        result = compare_session(
            session, model.load_action(), keep_predictions=False, budget=budget, suspect="parts" if suspect else False
        )
    return {
        "finding": list(result.findings["text"]),
        "warning": [text for text in result.warnings if text not in set(result.findings["text"])],
        "verdict": list(result.verdict_lines),
        "marked": [f"trial {row.trial}: {row.reason}" for row in result.marked.itertuples()],
    }


def main(run: Run) -> bool:
    """Print every sentence beside what was planted; whether no word was said that may not be said."""
    asked = [(name, case) for name, case in cases().items() if not run.only or any(word in name for word in run.only)]
    keys = []
    for (name, case), kind in product(asked, run.strokes):
        key = (name, case.stroke or kind, run.seed, run.suspect, run.budget)
        keys += [key] if key not in keys else []
    right = True
    for (name, kind, seed, *_), said in run.cases(keys, sentences):
        case = cases()[name]
        print(f"\n=== {name} ({kind}, seed {seed})\n    planted: {case.truth}", flush=True)
        for where, lines in said.items():
            for line in lines:
                wrong = [word for word in (*CAUSES, *case.never) if word in line]
                print(f"  {where}: {line}" + (f"  <<< {', '.join(wrong)}" if wrong else ""))
                right &= not wrong
    return right
