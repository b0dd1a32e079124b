"""Planted faults of a session and changes of the specimen: which causes does a report say explain the difference?

    python -m benchmarks what_explains [--seed 1] [--sessions 20] [--changes clean,shank:1] [--strokes forte]
                                       [--lots N] [--results FILE] [--minutes M]

Sessions are strokes of the virtual bench (motor arm, sensors with errors, strengths that scatter), three of them, or
six where some trials may differ from the others. What is planted is ``+`` between:

``CAUSE:SIZE[:PROFILE]``
    a change, in % (effects: times what their files state; lengths: mm, delays: ms, levels: N, zeros: mrad), in ``all``
    trials, in ``one`` (the fourth), from that on (``step``), or as a ``trend`` to the last. Causes are errors of
    channels (``force gain``; ``clock rate``), values of the action and felts (``contact02``) by their names, and
    effects that the model lacks (``shank``, ``contact12.stulov``, ``giving`` for all joints).
``own``
    the bench's own specimen, which the model knows.
``clean``
    nothing, in six trials.

With ``--lots`` so many sessions are drawn by lot: of `KINDS` each comes once before any comes twice, with its stroke,
its specimen (printed, ``own``) and its size; every third holds another kind, of single trials beside one of all.
Prints a line per session, and a table of what was planted, part by part (what some trials have, and what all share):
``alone`` a set of nothing but what was planted is the only one named, ``set`` it is among those named, ``wrong`` sets
are named and none is right (also where nothing was planted), ``none`` no cause that was tried explains it, ``silent``
nothing is said of it: it does not show.
"""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import model
from benchmarks.bench_strokes import (
    BENCH,
    Change,
    delayed,
    louder,
    read_late,
    scaled,
    stretched,
    stroke_of,
    wrong_at_rest,
)
from benchmarks.runner import Key, Run, Table, interval, may_be
from rig.session import Session, SessionInfo
from rig.session.info import FileInfo
from rig.simulated.bench.plant import load_plant
from validation.conventions import ENCODER_CHANNELS
from validation.infer.causes.explain import Explained, choose_trials, make_answer
from validation.infer.causes.responses import Point, Responses
from validation.infer.causes.search import Fit, Search, find_causes
from validation.infer.channels import CLOCK, DELAY, ERROR_BY_NAME, FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL, SCALE, ZERO
from validation.infer.hypotheses import ADDED, ALL, ONE, STEP, TREND, list_addable_effects, sources
from validation.infer.observations import ObservedTrial, observe
from validation.infer.unknowns import lead_of, single_names
from validation.measurement.measure_session import measure_session
from validation.prediction.model_under_test import ModelUnderTest

TRIALS, MORE = 3, 6
FAULTY = 4  # the trial that has a fault, or from which on
SHOWS = 25.0  # twice the log posterior ratio of the truth; the threshold of loud strokes is 17 to 24
VERDICTS = ("alone", "set", "none", "silent", "wrong")
APART = {
    FORCE_GAIN: ("5/7/10", (ONE, TREND, STEP)),
    FORCE_LEVEL: ("0.1/0.2/0.4", (ONE, TREND, STEP)),
    FORCE_DELAY: ("1/2/3", (ONE, TREND, STEP)),
    **{f"{name} {SCALE}": ("4/6/9", (ONE, STEP)) for name in ENCODER_CHANNELS},
    **{f"{name} {DELAY}": ("1/2/3", (ONE, TREND, STEP)) for name in ENCODER_CHANNELS},
    **{f"{name} {ZERO}": ("0.5/1/2", (ONE, STEP)) for name in ENCODER_CHANNELS},
    "key.joint_friction.A": ("30/50/80", (TREND, STEP)),
    "contact07.friction.A": ("30/50/80", (TREND, STEP)),
    "contact02": ("40/60/100", (STEP,)),
    "repetition_spring.stiffness": ("30/50/80", (STEP,)),
    "contact08.second.y": ("0.7/1/1.5", (STEP,)),
    "drive.point.x": ("3/5/8", (STEP,)),
}
SHARED = {
    FORCE_GAIN: "5/8/12",
    FORCE_LEVEL: "0.1/0.2/0.4",
    FORCE_DELAY: "1/2/3",
    CLOCK: "1/2/3",
    **{f"{name} {SCALE}": "3/5/8" for name in ENCODER_CHANNELS},
    **{f"{name} {DELAY}": "1/2/3" for name in ENCODER_CHANNELS},
    **{f"{name} {ZERO}": "0.5/1/2" for name in ENCODER_CHANNELS},
    **{f"{body}.joint_friction.A": "30/50/80" for body in ("key", "whippen", "jack", "repetition", "hammer")},
    **{f"contact{n}.friction.A": "20/40/60" for n in ("01", "04", "07", "10")},
    **{f"contact{n}": "30/50/80" for n in ("01", "02", "03", "12")},
    **{f"contact{n}.normal.D": "30/50/80" for n in ("01", "02", "12")},
    "jack_spring.torque": "20/40/60",
    "repetition_spring.stiffness": "20/40/60",
    **{f"{body}.mass": "5/10/15" for body in ("key", "whippen", "hammer")},
    **{f"{body}.inertia": "5/10/15" for body in ("key", "hammer")},
    "contact08.second.y": "0.5/1/1.5",
    "contact01.first.x": "1/2/3",
    "hammer.center_of_mass.x": "1/2/3",
    "drive.point.x": "3/5/8",
    **dict.fromkeys(("shank", "string", "balance_rail", "hammer_pin", "giving"), "1/1.5/2"),
    **dict.fromkeys(("contact12.stulov", "contact02.stulov", "contact02.hysteresis"), "1/1.5/2"),
}
"""Kinds with three sizes: of some trials with their profiles, and of all."""
KINDS = [
    *(f"{cause}:{sizes}:{profile}" for cause, (sizes, profiles) in APART.items() for profile in profiles),
    *(f"{cause}:{sizes}:{ALL}" for cause, sizes in SHARED.items()),
]


class Planted(NamedTuple):
    """A cause (named as a search would), its size as it is written, and the trials that have it."""

    cause: str
    size: float
    profile: str
    unit: str

    def amount(self, number: int) -> float:
        """How much of its size a trial has, SI; what is relative as a factor less 1."""
        share = {ALL: 1.0, TREND: (number - 1) / (MORE - 1), ONE: number == FAULTY, STEP: number >= FAULTY}
        return (
            self.size * float(share[self.profile]) * {"1": 1e-2, "m": 1e-3, "s": 1e-3, "rad": 1e-3}.get(self.unit, 1.0)
        )

    def misread(self, number: int) -> Change:
        """What is wrong with the record of a trial, of an error of its channels."""
        by = self.amount(number)
        if self.cause == FORCE_LEVEL:
            return lambda data, _: replace(
                data, force_info=replace(data.force_info, preload_n=data.force_info.preload_n + by)
            )
        error = ERROR_BY_NAME[self.cause]
        if error.kind == SCALE:
            return scaled(error.encoder, 1.0 + by)
        if error.kind:
            return (read_late if error.kind == DELAY else wrong_at_rest)(error.encoder, by)
        return {FORCE_GAIN: louder(1.0 + by), FORCE_DELAY: delayed(by), CLOCK: stretched(1.0 + by)}[self.cause]


def planted(token: str, action: model.Action) -> Planted:
    """What a word ``CAUSE:SIZE[:PROFILE]`` plants."""
    cause, size, profile = [*token.split(":"), ALL][:3]
    units = {name: error.unit for name, error in ERROR_BY_NAME.items()}
    names = single_names(action)
    if cause in names:
        unit = lead_of(model.quantities_of(action), names[cause]).unit
        units[cause] = unit if unit == "m" else "1"
    if cause not in units:
        cause = next(source.name for source in list_addable_effects(action) if source.name.startswith(ADDED + cause))
    return Planted(cause, float(size), profile, units.get(cause, ADDED))


def bench_changes() -> list[Planted]:
    """How the bench's own specimen differs."""
    printed, own = model.load_action(), load_plant(BENCH, 1, 5000.0).action
    names = single_names(printed).items()
    return [
        Planted(n, 100.0 * (own[p[0]] / printed[p[0]] - 1.0), ALL, "1") for n, p in names if own[p[0]] != printed[p[0]]
    ]


def observed(
    kind: str, seed: int, specimen: str, action: model.Action, these: list[Planted], trials: int
) -> list[ObservedTrial]:
    """Trials of one session of a specimen that differs from the action by these, as a search compares them."""
    names, effects = single_names(action), {source.name: source for source in list_addable_effects(action)}
    scene = next((effects[p.cause].scene(action, p.size) for p in these if p.cause in effects), None)
    with tempfile.TemporaryDirectory() as folder:
        info = SessionInfo(
            simulated=True, name="why", operator="why", rig=FileInfo(name="none"), profile=FileInfo(name=kind)
        )
        session = Session.create(Path(folder) / "session", info)
        for number in range(1, trials + 1):
            changed = {
                path: p.amount(number) * (1.0 if p.unit == "m" else action[path])
                for p in these
                for path in names.get(p.cause, ())
            }
            played = {"changed": tuple((k, v) for k, v in changed.items() if v), "scene": scene}
            stroke = stroke_of(kind, seed, number, specimen, tuple((k, v) for k, v in played.items() if v))
            data = stroke.data
            for p in these:
                if p.cause in ERROR_BY_NAME and p.amount(number):
                    data = p.misread(number)(data, stroke)
            session.add_trial(data)
        tested = ModelUnderTest(action)
        measured = measure_session(session, tested.geometry_at, 6e-5)
        return observe("validate", 0, choose_trials(measured.trials))


def truths(responses: Responses, search: Search, these: list[Planted]) -> list[tuple[float, float]]:
    """Of each planted part, what a reader is told of its size, and how it shows.

    That is twice the log posterior ratio of the truth with and without the part, in the noise around the truth.
    """
    members: dict[int, float] = {}
    told = []
    for p in these:
        i, source = next(
            (i, responses.listed[c.source])
            for i, c in enumerate(responses.candidates)
            if (responses.listed[c.source].name, c.profile) == (p.cause, p.profile)
            and (p.profile not in (ONE, STEP) or c.first == FAULTY)
        )
        size = p.amount(FAULTY if p.profile == ONE else MORE)
        members[i] = p.size if source.added else (np.log1p(size) if source.unit == "1" else size) / source.wrong
        told.append(source.size(members[i], 0.0)[0])

    def start(kept: dict[int, float]) -> Fit:
        at = tuple(sorted(kept))
        z = np.array([kept[i] for i in at])
        (each,) = responses.exact_differences([Point(tuple(zip(at, map(float, z), strict=True)))])
        assert each is not None
        return Fit(at, z, each, np.zeros((*each.shape, len(at))))

    def refit(kept: dict[int, float]) -> float:
        fit = start(kept)
        fit = replace(fit, log_posterior=around.log_posterior(fit.each, fit.z)[0])
        if not kept:
            return fit.log_posterior
        found = around.refit([replace(fit, columns=around.columns_at([fit])[0])])
        return found[0].log_posterior if found else fit.log_posterior

    if any(responses.listed[responses.candidates[i].source].added for i in members) and not search.effects:
        search = search.with_effects()
    around = Search(responses, start(members), search.effects, search)
    whole = refit(members)
    without = [refit({j: z for j, z in members.items() if j != i}) for i in members]
    return [(size, 2.0 * (whole - part)) for size, part in zip(told, without, strict=True)]


def judged(found: Explained, these: list[Planted], shared: bool) -> str:
    """The verdict (see above) on what all trials share, or on what some differ by."""
    sets: dict[int, set[tuple[str, str]]] = {}
    for row in found.changes:
        if (row.profile == ALL) == shared:
            sets.setdefault(row.set, set()).add((row.cause, row.profile))
    right = {(p.cause, p.profile) for p in these if (p.profile == ALL) == shared}
    if shared:  # what some trials have shifts the mean of all, where it is not told apart
        apart = {row.cause for row in found.changes if row.profile != ALL}
        right |= {(p.cause, ALL) for p in these if p.cause not in apart}
    if not sets:
        return "none" if "none of the causes" in found.sentence and (right or shared) else "silent"
    if not any(one <= right for one in sets.values()):
        return "wrong"
    return "alone" if len(sets) == 1 else "set"


def case(kind: str, words: str, seed: int) -> dict[str, Any]:
    """One session as plain data."""
    tokens = words.split("+")
    own = "own" in tokens
    action = model.load_action()
    if own:
        action = action.with_values(
            {p: (1.0 + c.amount(1)) * action[p] for c in bench_changes() for p in single_names(action)[c.cause]}
        )
    these = [planted(token, action) for token in tokens if ":" in token]
    specimen = "bench" if own else "printed"
    more = "clean" in tokens or any(p.profile != ALL for p in these)
    trials = observed(kind, seed, specimen, action, these, MORE if more else TRIALS)
    before = time.process_time()
    responses = Responses(ModelUnderTest(action), trials, sources(action, trials[0]))
    search = find_causes(responses)
    found = make_answer(search, [t.number for t in trials])
    seconds = time.process_time() - before
    return {
        "apart": judged(found, these, shared=False) if more else "", "shared": judged(found, these, shared=True),
        "planted": [p._asdict() for p in these],
        "said": "; ".join([*(f.text.split(": this")[0] for f in found.findings), found.sentence]),
        "changes": [asdict(c) for c in found.changes], "seconds": seconds,
        "truths": truths(responses, search.search, these) if search.search else [],
    }  # fmt: skip


def lots(run: Run) -> Iterator[Key]:
    """Sessions drawn by lot."""
    rng = np.random.default_rng(run.seed)
    order = np.concatenate([rng.permutation(len(KINDS)) for _ in range(1 + 2 * run.lots // len(KINDS))])
    kinds = iter([KINDS[k] for k in order])
    for n in range(run.lots):
        words = [next(kinds)]
        if n % 3 == 2:
            other = [k for k in KINDS if k.endswith(ALL) != words[0].endswith(ALL)]
            words.append(other[rng.integers(len(other))])
        sized = []
        for word in words:
            cause, sizes, profile = word.split(":")
            sized.append(f"{cause}:{rng.choice(sizes.split('/'))}:{profile}")
        if rng.random() < 0.5:
            sized.append("own")
        yield str(rng.choice(run.strokes)), "+".join(sized), run.seed + n


def deviations(row: dict[str, Any], p: Planted, size: float) -> Iterator[float]:
    """How far the size named for a planted part is from what was planted, in its standard uncertainty, in each set; of
    sets with the same causes, which say that either of two sizes fits, the nearer one."""
    sets: dict[int, list[str]] = {}
    for c in row["changes"]:
        sets.setdefault(c["set"], []).append(c["cause"])
    off: dict[tuple[str, ...], list[float]] = {}
    for c in row["changes"]:
        if (c["cause"], c["profile"]) == (p.cause, p.profile):
            by = np.log(c["change"] / size) if c["unit"] == "1" else c["change"] - size
            off.setdefault(tuple(sets[c["set"]]), []).append(float(by / c["u"]))
    yield from (min(each, key=abs) for each in off.values())


def main(run: Run) -> bool:
    """Run the study; whether 95 % of what is said of all or of some trials may name nothing wrong."""
    keys = [(kind, n, run.seed + i) for i, kind, n in product(range(run.sessions), run.strokes, run.changes)]
    verdicts: dict[str, Counter[str]] = {}
    shown: Counter[str] = Counter()
    seconds, sets, off = [], [], []
    for (kind, words, seed), row in run.cases(lots(run) if run.lots else keys, case):
        print(f"{kind} {words} {seed}: {row['apart'] or '–'}, {row['shared']} | {row['said']}", flush=True)
        these = [Planted(**p) for p in row["planted"]]
        for part, of in (
            ("apart", [p for p in these if p.profile != ALL]),
            ("shared", [p for p in these if p.profile == ALL]),
        ):
            if row[part]:
                name = f"{of[0].cause}, {of[0].profile}" if len(of) == 1 else f"{len(of) or 'nothing'}, {part}"
                verdicts.setdefault(name, Counter())[row[part]] += 1
        for p, (size, ratio) in zip(these, row["truths"], strict=bool(row["truths"])):
            verdict = row["shared" if p.profile == ALL else "apart"]
            if ratio > SHOWS:
                shown[verdict] += 1
                if verdict in ("alone", "set"):
                    sets.append(len({c["set"] for c in row["changes"]}))
                    off += list(deviations(row, p, size))[:1]
        seconds.append(row["seconds"])
    table = Table("planted:<40s", *(f"{verdict}:6d" for verdict in VERDICTS))
    for name in sorted(verdicts):
        table.row(name, *(verdicts[name][verdict] for verdict in VERDICTS))
    total = sum(verdicts.values(), Counter())
    table.row("all", *(total[verdict] for verdict in VERDICTS))
    table.row("parts that show", *(shown[verdict] for verdict in VERDICTS))
    print(f"processor time of a session: median {np.median(seconds):.1f} s, most {np.max(seconds):.1f} s")
    named, wrong = shown["alone"] + shown["set"], total["wrong"]
    if named:
        low, high = interval(named, shown.total())
        least, most = interval(wrong, wrong + total["alone"] + total["set"])
        near = sum(abs(d) < 2.0 for d in off)
        run.figure(
            "explains",
            f"named {named} of {shown.total()} ({low:.0%} to {high:.0%}), median set {np.median(sets):.0f}; wrong "
            f"{wrong} of {wrong + total['alone'] + total['set']} ({least:.1%} to {most:.1%}); sizes within 2 u "
            f"{near} of {len(off)}",
        )
    return may_be(0.95, total.total() - total["wrong"], total.total())
