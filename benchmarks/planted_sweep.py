"""Held-out planted faults: what does a report name, and does it name anything in sessions without faults?

    python -m benchmarks planted_sweep [--only sign,swap] [--seed 800] [--strokes forte,piano] [--specimen bench]
    python -m benchmarks planted_sweep --clean 17 --seed 9100 --strokes forte,piano,double,staccato,slow,fortissimo

Every session has six strokes of the virtual bench, one of them filmed; one trial, or all of them, or the specimen has
one fault of `planted_faults`. Prints a line per session that is not as expected, and a confusion table:
kinds planted against what was found. ``named``: the fault, or the set of causes it belongs to; ``flagged``: a symptom,
in the right trial; ``wrong``: any finding else. ``--largest`` plants the largest size of each kind only.
"""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

import model
from benchmarks.bench_strokes import BENCH, Stroke, play
from benchmarks.planted_faults import FILMED, FROM, Fault, faults
from benchmarks.runner import Run, Table, may_be
from rig.session import CameraInfo, Session, SessionInfo
from rig.session.info import FileInfo
from rig.simulated.bench.plant import load_plant
from validation import compare_session

TRIALS = 6
QUICK = {"keep_predictions": False, "rivals": (), "budget": False}
VERDICTS = ("named", "flagged", "silent", "wrong")


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


def confusion(rows: Iterable[tuple[str, str, set[tuple[str, int]]]]) -> None:
    """Print planted against found: a line per fault with its sizes, the verdicts counted, and the kinds found."""
    lines: dict[str, tuple[Counter[str], Counter[str]]] = {}
    for name, verdict, said in rows:
        verdicts, kinds = lines.setdefault(name, (Counter(), Counter()))
        verdicts[verdict] += 1
        kinds.update({kind for kind, _ in said})
    table = Table("planted:42s", *(f"{verdict}:d" for verdict in VERDICTS), "found:s")
    for name, (verdicts, kinds) in lines.items():
        table.row(name, *(verdicts[v] for v in VERDICTS), ", ".join(f"{k} {n}" for k, n in kinds.most_common()))


def main(run: Run) -> bool:
    """Print what is not as expected, and the table; whether 99 % of reports may name nothing wrong."""
    planted = [f for f in faults() if not run.only or any(word in f.name for word in run.only)]
    if run.largest:
        planted = list({fault.kind: fault for fault in reversed(planted)}.values())[::-1]  # the first of each kind
    by_name: dict[str, Fault | None] = {"": None} if run.clean else {fault.name: fault for fault in planted}
    keys = [
        (name, specimen, run.seed + n, kind)
        for specimen, kind, name, n in product(run.specimen, run.strokes, by_name, range(run.clean or 1))
    ]

    def said_of(name: str, specimen: str, seed: int, kind: str) -> list[tuple[str, int]]:
        found = findings(by_name[name], seed, kind, specimen)
        return sorted((str(f.kind), 0 if math.isnan(f.trial) else int(f.trial)) for f in found.itertuples())

    rows = []
    for (name, specimen, seed, kind), kept in run.cases(keys, said_of):
        fault, said = by_name[name], {(what, trial) for what, trial in kept}
        verdict, where = judged(fault, said), f"{kind} {specimen}"
        rows.append((name or f"clean {where}", verdict, said))
        if verdict == "wrong":
            words = ", ".join(f"{k} {t or ''}".strip() for k, t in sorted(said))
            print(f"wrong: {where} seed {seed} {name or 'clean'}: {words}", flush=True)
    confusion(rows)
    counts = Counter(verdict for _, verdict, _ in rows)
    print(dict(counts))
    if run.clean:
        run.figure("planted-clean", f"in {counts['wrong']} of {len(rows)}")
    return may_be(0.99, len(rows) - counts["wrong"], len(rows))
