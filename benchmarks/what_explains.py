"""Planted changes of the specimen: which part of the model does a report say explains the difference?

    python benchmarks/what_explains.py [--seed 1] [--sessions 20] [--changes 0,1,2,5,bench] [--strokes forte]
                                       [--results FILE] [--minutes M]

Every session has three strokes of the virtual bench (motor arm, sensors with errors, strengths that scatter). Its
specimen is the printed action with so many values changed, drawn anew for each session: frictions, felts, dampings and
joint frictions by a factor of 1.2 to 1.6 or its inverse, masses and inertias by 3 to 10 %; ``bench`` is the bench's own
specimen, ten values and a rail, a shank and an arm away from the model. Prints a line per session and a table:
``named`` a set of nothing but what was changed is among those named (of what was changed some has next to no effect),
``alone`` it is the only one, ``wrong``
sets are named and none is right, ``none`` no part of the model explains it, ``nothing`` nothing need have changed.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.bench_strokes import BENCH
from benchmarks.planted_sweep import stroke_of
from rig.session import Session, SessionInfo
from rig.session.info import FileInfo
from rig.simulated.bench.plant import load_plant
from validation.identification.difference.explain import Explained, explain_difference
from validation.identification.unknowns import single_names
from validation.measurement.session import measure_session
from validation.prediction.model_under_test import ModelUnderTest

TRIALS = 3
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


def explained(kind: str, seed: int, specimen: str, factors: dict[str, float]) -> tuple[Explained, float]:
    """What is said of one session, and processor seconds."""
    action = model.load_action()
    names = single_names(action) if specimen == "printed" else {}
    changed = {path: (f - 1.0) * action[path] for name, f in factors.items() for path in names.get(name, ())}
    with tempfile.TemporaryDirectory() as folder:
        info = SessionInfo(
            simulated=True, name="why", operator="why", rig=FileInfo(name="none"), profile=FileInfo(name=kind)
        )
        session = Session.create(Path(folder) / "session", info)
        for number in range(1, TRIALS + 1):
            played = (("changed", tuple(changed.items())),) if changed else ()
            session.add_trial(stroke_of(kind, seed, number, specimen, played).data)
        tested = ModelUnderTest(action)
        measured = measure_session(session, tested.geometry_at, 6e-5)
        before = time.process_time()
        found = explain_difference(tested, measured.trials)
        return found, time.process_time() - before


def judged(found: Explained, factors: dict[str, float]) -> str:
    """The verdict (see above)."""
    sets: dict[int, dict[str, float]] = {}
    for row in found.changes:
        sets.setdefault(row.set, {})[row.cause] = row.change
    if not sets:
        return "none" if "no part of the model explains" in found.sentence else "nothing"
    if not any(set(one) <= set(factors) for one in sets.values()):
        return "wrong"
    return "alone" if len(sets) == 1 else "named"


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--changes", default="0,1,2,5,bench")
    parser.add_argument("--strokes", default="forte")
    parser.add_argument("--results", type=Path)
    parser.add_argument("--minutes", type=float, default=60.0)
    asked = parser.parse_args(argv)
    known: dict[str, dict[str, object]] = {}
    if asked.results is not None and asked.results.is_file():
        lines = asked.results.read_text(encoding="utf-8").splitlines()
        known = {row["case"]: row for row in map(json.loads, lines)}
    end, table, seconds = time.monotonic() + 60 * asked.minutes, Counter(), []
    for i in range(asked.sessions):
        for kind in asked.strokes.split(","):
            for n in asked.changes.split(","):
                case = f"{kind} {n} {asked.seed + i}"
                if case not in known:
                    if time.monotonic() > end:
                        continue
                    rng = np.random.default_rng([asked.seed + i, 0 if n == "bench" else int(n)])
                    factors = bench_factors() if n == "bench" else drawn(model.load_action(), int(n), rng)
                    found, took = explained(kind, asked.seed + i, "bench" if n == "bench" else "printed", factors)
                    known[case] = {
                        "case": case, "verdict": judged(found, factors), "factors": factors, "said": found.sentence,
                        "changes": [asdict(c) for c in found.changes], "seconds": took,
                    }  # fmt: skip
                    if asked.results is not None:
                        with asked.results.open("a", encoding="utf-8") as file:
                            file.write(json.dumps(known[case]) + "\n")
                row = known[case]
                planted = ", ".join(f"{k} × {v:.2f}" for k, v in row["factors"].items())  # type: ignore[attr-defined]
                print(f"{case}: {row['verdict']}: {planted or '–'} | {row['said']}", flush=True)
                table[n, str(row["verdict"])] += 1
                seconds.append(float(str(row["seconds"])))
    verdicts = ("alone", "named", "none", "nothing", "wrong")
    print(f"{'changed':>10}" + "".join(f"{v:>9}" for v in verdicts))
    for n in asked.changes.split(","):
        print(f"{n:>10}" + "".join(f"{table[n, v]:>9}" for v in verdicts))
    print(f"processor time of a session: median {np.median(seconds):.1f} s, most {np.max(seconds):.1f} s")


if __name__ == "__main__":
    main()
