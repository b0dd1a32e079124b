"""Held-out planted faults: what does a report name, and does it name anything in sessions without faults?

    python benchmarks/planted_sweep.py [--only sign,swap] [--seed 800] [--strokes forte,piano] [--specimen bench]
    python benchmarks/planted_sweep.py --clean 17 --seed 9100 --strokes forte,piano,double,staccato,slow,fortissimo

Every session has six strokes of the virtual bench, one of them filmed; one trial, or all of them, or the specimen has
one fault of `benchmarks/planted_kinds.py`. Prints a line per session that is not as expected, and a confusion table:
kinds planted against what was found. ``named``: the fault, or the set of causes it belongs to; ``flagged``: a symptom,
in the right trial; ``wrong``: any finding else. ``--largest`` plants the largest size of each kind only. ``--results``
keeps a line per session: what it holds is not computed again, so that a long run can be stopped (``--minutes``) and go
on.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.bench_strokes import BENCH, KINDS, Stroke, play
from benchmarks.planted_faults import FROM, Fault
from benchmarks.planted_kinds import FILMED, faults
from rig.session import CameraInfo, Session, SessionInfo
from rig.session.info import FileInfo
from rig.simulated.bench.plant import load_plant
from validation import compare_session

TRIALS = 6
QUICK = {"keep_predictions": False, "rivals": (), "budget": False, "suspect": False}
VERDICTS = ("named", "flagged", "silent", "wrong")
SPECIMENS = ("printed", "bench")


def specimen_change(which: str, friction: tuple[str, float] | None) -> dict[str, float]:
    """Changes to the bench's specimen that give the requested one."""
    bench = load_plant(BENCH, 1, 5000.0).action
    printed = model.load_action()
    moved = {}
    if which == "printed":
        moved = {
            p: printed[p] - bench[p] for p in printed.quantities if p in bench.quantities and printed[p] != bench[p]
        }
    if friction is not None:
        path, factor = friction
        base = printed[path] if which == "printed" else bench[path]
        moved[path] = factor * base - bench[path]
    return moved


@lru_cache(maxsize=64)
def stroke_of(kind: str, seed: int, number: int, specimen: str, options: tuple[tuple[str, object], ...]) -> Stroke:
    """One stroke; strokes without faults are played once."""
    given = dict(options)
    changed = specimen_change(specimen, given.pop("friction", None))  # type: ignore[arg-type]
    for path, by in dict(given.pop("changed", ())).items():  # type: ignore[call-overload]
        changed[path] = changed.get(path, 0.0) + by
    return play(kind, seed, number=number, changed=changed, alike=True, **given)


def film(stroke: Stroke, late_s: float, rng: np.random.Generator) -> tuple[CameraInfo, pd.DataFrame]:
    """Tracker output for one stroke."""
    camera = CameraInfo(2000.0, 0.0301, 1e-4, int((stroke.truth.time_s[-1] - 0.05) * 2000), 2e-6)
    stamped = camera.frame_time_s
    angle = stroke.truth.angles_at(np.maximum(stamped - late_s, 0.0)) - stroke.truth.angle_rad[0]
    columns = {"time_s": stamped, "frame": np.arange(stamped.size)}
    for name, i in (("whippen", 1), ("jack_relative", 2), ("repetition_relative", 3)):
        columns[f"{name}_rad"] = angle[:, i] + rng.normal(0, 4e-4, stamped.size)
        columns[f"{name}_u_rad"] = np.full(stamped.size, 4e-4)
    return camera, pd.DataFrame(columns)


def findings(fault: Fault | None, seed: int, kind: str, specimen: str) -> pd.DataFrame:
    """Findings reported for a session with one fault, or none."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        info = SessionInfo(
            simulated=True, name="sweep", operator="sweep", rig=FileInfo(name="none"), profile=FileInfo(name=kind)
        )
        session = Session.create(Path(folder) / "session", info)
        for number in range(1, TRIALS + 1):
            mine = fault is not None and (fault.has(number) or (fault.trial == 0 and not fault.late))
            played = dict(fault.play) if fault is not None and mine else {}
            late_s = float(played.pop("film_late_s", 0.0))  # type: ignore[arg-type]
            if "changed" in played:
                played["changed"] = tuple(played["changed"].items())  # type: ignore[attr-defined]
            copied = fault is not None and fault.copy and mine
            stroke = stroke_of(kind, seed, FILMED if copied else number, specimen, tuple(sorted(played.items())))
            data = replace(stroke.data, number=number)
            if fault is not None and fault.change is not None and mine:
                data = fault.change(data, stroke)
            table = None
            if number == FILMED:
                camera, table = film(stroke, late_s, rng)
                data = replace(data, camera=camera)
                table = fault.film(table) if fault is not None and fault.film is not None else table
            session.add_trial(data)
            if table is not None:
                session.write_derived("angles", number, table)
        return compare_session(session, model.load_action(), **QUICK).findings


def judged(fault: Fault | None, said: set[tuple[str, int]]) -> str:
    """Return the verdict (see above) on the findings, kind and trial (0: of the session)."""
    if fault is None:
        return "wrong" if said else "silent"

    def fits(kind: str, trial: int) -> bool:
        where = trial == fault.trial if fault.trial > 0 else True
        if fault.late:  # a condition begins at one trial
            where = trial in (0, FROM)
        # a clock is told by the film alone
        return kind in (fault.named | fault.flagged) and (where or kind == "film clock")

    if any(not fits(kind, trial) for kind, trial in said):
        return "wrong"
    if not said:
        return "silent"
    return "named" if any(kind in fault.named for kind, _ in said) else "flagged"


def confusion(rows: Iterable[tuple[str, str, set[tuple[str, int]]]]) -> str:
    """Planted against found: a line per fault with its sizes, the verdicts counted, and the kinds that were found."""
    lines: dict[str, tuple[Counter[str], Counter[str]]] = {}
    for name, verdict, said in rows:
        verdicts, kinds = lines.setdefault(name, (Counter(), Counter()))
        verdicts[verdict] += 1
        kinds.update({kind for kind, _ in said})
    head = f"{'planted':42s}" + "".join(f"{v:>9s}" for v in VERDICTS) + "   found"
    out = [head]
    for name, (verdicts, kinds) in lines.items():
        found = ", ".join(f"{k} {n}" for k, n in kinds.most_common())
        out.append(f"{name:42s}" + "".join(f"{verdicts[v]:9d}" for v in VERDICTS) + f"   {found}")
    return "\n".join(out)


Case = tuple[str, str, int, str]  # name of the fault, specimen, seed, kind of stroke


def cases(planted: Sequence[Fault], clean: int, seed: int, strokes: str, specimens: str) -> Iterator[Case]:
    """The sessions asked for; those without a fault have an empty name."""
    for specimen, kind in product(specimens.split(","), strokes.split(",")):
        if clean:
            yield from (("", specimen, seed + n, kind) for n in range(clean))
        else:
            yield from ((fault.name, specimen, seed, kind) for fault in planted)


def results(
    asked: Iterable[Case], planted: Sequence[Fault], file: Path | None, until: float
) -> Iterator[dict[str, Any]]:
    """What was said of each session: kept in the file, or found now as long as there is time."""
    by_name = {fault.name: fault for fault in planted}
    kept: dict[Case, dict[str, Any]] = {}
    if file is not None and file.exists():
        rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
        kept = {(r["fault"], r["specimen"], r["seed"], r["kind"]): r for r in rows}
    for case in asked:
        if case not in kept:
            if time.monotonic() > until:
                continue
            name, specimen, seed, kind = case
            found = findings(by_name.get(name), seed, kind, specimen)
            said = sorted((str(f.kind), 0 if math.isnan(f.trial) else int(f.trial)) for f in found.itertuples())
            kept[case] = {"fault": name, "specimen": specimen, "seed": seed, "kind": kind, "said": said}
            if file is not None:
                with file.open("a", encoding="utf-8") as sheet:
                    sheet.write(json.dumps(kept[case]) + "\n")
        yield kept[case]


def main() -> None:
    """Print what is not as expected, and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="parts of the names of faults")
    parser.add_argument("--largest", action="store_true", help="the largest size of each kind only")
    parser.add_argument("--clean", type=int, default=0, help="sessions without faults of each stroke and specimen")
    parser.add_argument("--seed", type=int, default=800)
    parser.add_argument("--strokes", "--kinds", default="forte", help=f"some of {', '.join(KINDS)}")
    parser.add_argument("--specimen", default=",".join(SPECIMENS))
    parser.add_argument("--results", type=Path, help="file of what was found, a JSON line per session")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="start no session after this time")
    options = parser.parse_args()
    planted = [f for f in faults() if not options.only or any(word in f.name for word in options.only.split(","))]
    if options.largest:
        planted = list({fault.kind: fault for fault in reversed(planted)}.values())[::-1]  # the first of each kind
    by_name = {fault.name: fault for fault in planted}
    asked = cases(planted, options.clean, options.seed, options.strokes, options.specimen)
    rows = []
    for r in results(asked, planted, options.results, time.monotonic() + 60 * options.minutes):
        fault = by_name.get(r["fault"])
        said = {(kind, trial) for kind, trial in r["said"]}
        verdict = judged(fault, said)
        where = f"{r['kind']} {r['specimen']}"
        rows.append((f"clean {where}" if fault is None else fault.name, verdict, said))
        if verdict == "wrong":
            words = ", ".join(f"{k} {t or ''}".strip() for k, t in sorted(said))
            print(f"wrong: {where} seed {r['seed']} {r['fault'] or 'clean'}: {words}", flush=True)
    print(confusion(rows))
    print(dict(Counter(verdict for _, verdict, _ in rows)))


if __name__ == "__main__":
    main()
