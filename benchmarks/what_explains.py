"""Planted faults of a session and changes of the specimen: which causes does a report say explain the difference?

    python -m benchmarks what_explains [--seed 1] [--sessions 20] [--changes 0,1,2,5,bench] [--strokes forte]
                                       [--results FILE] [--minutes M]

Every session has three strokes of the virtual bench (motor arm, sensors with errors, strengths that scatter). Its
specimen is the printed action with so many values changed, drawn anew for each session: frictions, felts, dampings and
joint frictions by a factor of 1.2 to 1.6 or its inverse, masses and inertias by 3 to 10 %; ``bench`` is the bench's own
specimen, ten values and a rail, a shank and an arm away from the model. ``drift:4`` is a session of six strokes whose
force gain drifts, to 4 % in the last one; ``one:4`` has 4 % in its fourth, ``step:4`` from the fourth on, ``late:0.8``
reads the force of the fourth 0.8 ms late, ``law:40`` has 40 % more friction in the key's joint from the fourth on, and
``clean`` nothing. ``with:shank:0.3`` is a session of a specimen that has an effect which the model lacks, 0.3 of what
its file states (`responses.SIZES`); ``with:contact12.stulov`` has felt that remembers, ``with:giving`` joints that all
give: the added effect is what must be named. ``drift:4+1``, ``drift:4+bench`` and ``drift:4+with:shank:0.3`` have both.
Prints a line per session, the smallest size of each effect from which on it is named, and a table: ``named`` a set of
nothing but what was planted is among those named (of what was changed some has next to no effect), ``alone`` it is the
only one, ``wrong`` sets are named and none is right, ``none`` no cause that was tried explains it, ``nothing`` nothing
need be sought. Of a session with a fault this is said of what its trials differ by.
"""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import model
from benchmarks.bench_strokes import BENCH
from benchmarks.planted_sweep import delayed, louder, stroke_of
from benchmarks.runner import Run, Table, may_be
from rig.session import Session, SessionInfo
from rig.session.info import FileInfo
from rig.simulated.bench.plant import load_plant
from validation.identification.difference.explain import Explained, explain_difference
from validation.identification.difference.responses import ADDED, addable
from validation.identification.unknowns import FORCE_DELAY, FORCE_GAIN, single_names
from validation.measurement.measure_session import measure_session
from validation.prediction.model_under_test import ModelUnderTest

TRIALS, MORE = 3, 6
FAULTY = 4  # the trial that has a fault, or from which on
LAW = "key.joint_friction.A"
# cause, and in which trials
FAULTS = {
    "drift": (FORCE_GAIN, "trend"),
    "one": (FORCE_GAIN, "one"),
    "step": (FORCE_GAIN, "step"),
    "late": (FORCE_DELAY, "one"),
    "law": (LAW, "step"),
}
VERDICTS = ("alone", "named", "none", "nothing", "wrong")
LAWS, MASSES = (".friction.A", ".joint_friction.A", ".normal.D", ".torque", ".stiffness"), (".mass", ".inertia")
FACTORS, MASS_FACTORS = (1.2, 1.6), (1.03, 1.10)


def drawn(action: model.Action, n: int, rng: np.random.Generator) -> dict[str, float]:
    """Names of so many things that change, and their factors."""
    names = single_names(action)
    pool = [k for k, paths in sorted(names.items()) if len(paths) > 1 or k.endswith((*LAWS, *MASSES))]
    out = {}
    for name in rng.choice(pool, n, replace=False):
        low, high = MASS_FACTORS if name.endswith(MASSES) else FACTORS
        factor = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        out[str(name)] = factor if rng.random() < 0.5 else 1.0 / factor
    return out


def bench_factors() -> dict[str, float]:
    """How the bench's own specimen differs."""
    printed, own = model.load_action(), load_plant(BENCH, 1, 5000.0).action
    names = single_names(printed).items()
    return {n: own[p[0]] / printed[p[0]] for n, p in names if own[p[0]] != printed[p[0]]}


def amount(fault: str, size: float, number: int) -> float:
    """How much of a fault a trial has."""
    profile = FAULTS[fault][1]
    share = {"trend": (number - 1) / (MORE - 1), "one": float(number == FAULTY), "step": float(number >= FAULTY)}
    return size * share[profile]


def explained(
    kind: str,
    seed: int,
    specimen: str,
    factors: dict[str, float],
    fault: str = "",
    size: float = 0.0,
    scene: model.SceneChoice | None = None,
) -> tuple[Explained, float]:
    """What is said of one session, and processor seconds."""
    action = model.load_action()
    names = single_names(action) if specimen == "printed" else {}
    changed = {path: (f - 1.0) * action[path] for name, f in factors.items() for path in names.get(name, ())}
    with tempfile.TemporaryDirectory() as folder:
        info = SessionInfo(
            simulated=True, name="why", operator="why", rig=FileInfo(name="none"), profile=FileInfo(name=kind)
        )
        session = Session.create(Path(folder) / "session", info)
        for number in range(1, (MORE if fault else TRIALS) + 1):
            planted, by = dict(changed), amount(fault, size, number) if fault in FAULTS else 0.0
            if fault == "law" and by:
                planted[LAW] = planted.get(LAW, 0.0) + 0.01 * by * action[LAW]
            played = {"changed": tuple(planted.items()), "scene": scene}
            stroke = stroke_of(kind, seed, number, specimen, tuple((k, v) for k, v in played.items() if v))
            data = stroke.data
            if by and fault != "law":
                data = (delayed(1e-3 * by) if fault == "late" else louder(1.0 + 0.01 * by))(data, stroke)
            session.add_trial(data)
        tested = ModelUnderTest(action)
        measured = measure_session(session, tested.geometry_at, 6e-5)
        before = time.process_time()
        found = explain_difference(tested, measured.trials)
        return found, time.process_time() - before


def judged(found: Explained, factors: dict[str, float], fault: str = "") -> str:
    """The verdict (see above)."""
    sets: dict[int, set[tuple[str, str]]] = {}
    for row in found.changes:
        if (row.profile != "all") == bool(fault):
            sets.setdefault(row.set, set()).add((row.cause, row.profile))
    if not sets:
        return "none" if not fault and "none of the causes" in found.sentence else "nothing"
    right = {FAULTS[fault]} if fault in FAULTS else {(name, "all") for name in factors} if not fault else set()
    if not any(one <= right for one in sets.values()):
        return "wrong"
    return "alone" if len(sets) == 1 else "named"


def case(kind: str, n: str, seed: int) -> dict[str, Any]:
    """One session as plain data."""
    parts = n.split("+")
    name, _, size = parts.pop(0).partition(":") if parts[0].partition(":")[0] in (*FAULTS, "clean") else ("", "", "")
    effects = [part.removeprefix("with:") for part in parts if part.startswith("with:")]
    changes, scene = "".join(part for part in parts if not part.startswith("with:")) or "0", None
    rng = np.random.default_rng([seed, 0 if changes == "bench" else int(changes)])
    factors = bench_factors() if changes == "bench" else drawn(model.load_action(), int(changes), rng)
    specimen = "bench" if changes == "bench" else "printed"
    for effect, _, much in (part.partition(":") for part in effects):
        action = model.load_action()
        (added,) = (source for source in addable(action) if source.name.startswith(ADDED + effect))
        factors[added.name], scene = float(much or 1.0), added.scene(action, float(much or 1.0))
    found, took = explained(kind, seed, specimen, factors, name, float(size or 0.0), scene)
    return {
        "verdict": judged(found, factors, name), "shared": judged(found, factors), "factors": factors,
        "said": "; ".join([*(f.text.split(": this")[0] for f in found.findings), found.sentence]),
        "changes": [asdict(c) for c in found.changes], "seconds": took,
    }  # fmt: skip


def detectable(verdicts: Mapping[tuple[str, str], Sequence[str]]) -> None:
    """Print the smallest size of each effect from which on it was named, in each kind of stroke."""
    sizes: dict[str, dict[str, list[tuple[float, bool]]]] = {}
    for (kind, n), found in verdicts.items():
        if n.startswith("with:") and "+" not in n:
            effect, _, much = n.removeprefix("with:").partition(":")
            tried = sizes.setdefault(effect, {}).setdefault(kind, [])
            tried.append((float(much or 1.0), {"alone", "named"}.issuperset(found)))
    if not sizes:
        return
    kinds = list(dict.fromkeys(kind for kind, _ in verdicts))
    shown = Table("named from:<20s", *(f"{kind}:>10s" for kind in kinds))
    for effect, of in sizes.items():
        cells = []
        for kind in kinds:
            missed = max((size for size, named in of.get(kind, []) if not named), default=0.0)
            above = [size for size, named in of.get(kind, []) if named and size > missed]
            cells.append(f"{min(above):g}" if above else f"> {missed:g}" if missed else "")
        shown.row(effect, *cells)


def main(run: Run) -> bool:
    """Run the study; whether 95 % of sessions may name nothing wrong."""
    table: Counter[tuple[str, str]] = Counter()
    verdicts: dict[tuple[str, str], list[str]] = {}
    seconds = []
    keys = [(kind, n, run.seed + i) for i, kind, n in product(range(run.sessions), run.strokes, run.changes)]
    for (kind, n, seed), row in run.cases(keys, case):
        planted = ", ".join(f"{k} × {v:.2f}" for k, v in row["factors"].items())
        print(f"{kind} {n} {seed}: {row['verdict']}: {planted or '–'} | {row['said']}", flush=True)
        table[n, row["verdict"]] += 1
        verdicts.setdefault((kind, n), []).append(row["verdict"])
        seconds.append(row["seconds"])
    detectable(verdicts)
    shown = Table("changed:>24s", *(f"{verdict}:8d" for verdict in VERDICTS))
    for n in run.changes:
        shown.row(n, *(table[n, verdict] for verdict in VERDICTS))
    print(f"processor time of a session: median {np.median(seconds):.1f} s, most {np.max(seconds):.1f} s")
    wrong = sum(table[n, "wrong"] for n in run.changes)
    return may_be(0.95, len(seconds) - wrong, len(seconds))
