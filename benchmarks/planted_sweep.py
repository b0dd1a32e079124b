"""Held-out planted faults: what does a report name, and does it name anything in sessions without faults?

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
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

import model
from benchmarks.bench_strokes import BENCH, Stroke, play
from benchmarks.runner import Run, Table, may_be
from rig.session import CameraInfo, Session, SessionInfo, TrialData
from rig.session.info import FileInfo
from rig.simulated.bench.plant import load_plant
from validation import compare as compare_session

SCALE_RADIUS_M = 0.02608
CHANNELS = ("key", "whippen", "hammer")
ALL, NONE = -1, 0
FROM = 4  # the trial from which on a condition is another
SYMPTOMS = frozenset({"outlying trial", "outlying residual"})
Change = Callable[[TrialData, Stroke], TrialData]
ChangeFilm = Callable[[pd.DataFrame], pd.DataFrame]


@dataclass(frozen=True)
class Fault:
    """A planted fault: its kind and size, its trial (−1: all, 0: of the session), how it is made, what may be found.

    ``play`` goes to the strokes of faulty trials; ``late`` faults begin with trial `FROM`; ``copy`` repeats trial 2.
    """

    kind: str
    size: str
    named: frozenset[str]
    trial: int = ALL
    change: Change | None = None
    film: ChangeFilm | None = None
    play: dict[str, object] = field(default_factory=dict)
    flagged: frozenset[str] = SYMPTOMS
    late: bool = False
    copy: bool = False
    strokes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Kind and size."""
        return f"{self.kind} {self.size}".strip()

    def has(self, number: int) -> bool:
        """Whether a trial has the fault."""
        return number >= FROM if self.late else self.trial in (ALL, NONE, number)


def recount(data: TrialData, columns: Callable[[np.ndarray], np.ndarray]) -> TrialData:
    """Return the trial with changed encoder counts."""
    count = columns(data.encoder_count.copy())
    return replace(data, encoder_count=count - count[0])


def lifted(size_m: float, length_s: float) -> Change:
    """Add a lift to the key's scale reading while the capstan is loaded, 60 ms after the force's peak."""

    def change(data: TrialData, stroke: Stroke) -> TrialData:
        start = float(data.time_s[int(np.argmax(data.force_n))]) + 0.06
        lift = size_m * np.sin(np.pi * np.clip((data.time_s - start) / length_s, 0, 1))
        by = np.round(lift / SCALE_RADIUS_M / data.encoders[0].rad_per_count).astype(np.int64)
        return recount(data, lambda c: c + np.outer(by, [1, 0, 0]))

    return change


def flipped(*turned: int) -> Change:
    return lambda data, _: recount(data, lambda c: c * np.where(np.isin(np.arange(3), turned), -1, 1))


def swapped(i: int, j: int) -> Change:
    """Angles of two bodies swapped."""

    def change(data: TrialData, stroke: Stroke) -> TrialData:
        per = np.array([e.rad_per_count for e in data.encoders])
        order = [0, 1, 2]
        order[i], order[j] = j, i
        return recount(data, lambda c: np.round((c * per)[:, order] / per).astype(np.int64))

    return change


def scaled(i: int, by: float) -> Change:
    return lambda data, _: recount(data, lambda c: np.round(c * np.where(np.arange(3) == i, by, 1.0)).astype(np.int64))


def stuck(i: int, bit: int) -> Change:
    def change(c: np.ndarray) -> np.ndarray:
        c[:, i] |= 1 << bit
        return c

    return lambda data, _: recount(data, change)


def slipped(i: int, counts: int) -> Change:
    """Counts lost where the encoder turns fastest."""

    def change(c: np.ndarray) -> np.ndarray:
        at = int(np.argmax(np.abs(np.diff(c[:, i])))) + 1
        c[at:, i] += counts
        return c

    return lambda data, _: recount(data, change)


def cut(share: float) -> Change:
    def change(data: TrialData, _: Stroke) -> TrialData:
        n = int(share * data.time_s.size)
        parts = ("time_s", "force_n", "force_raw", "motor_command_v", "encoder_count")
        return replace(data, **{name: getattr(data, name)[:n] for name in parts})

    return change


def force(made: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Change:
    """Another force, of that and the time."""
    return lambda data, _: replace(data, force_n=made(data.force_n, data.time_s))


def louder(by: float) -> Change:
    return force(lambda f, t: f * by)


def humming(newton: float, hz: float) -> Change:
    return force(lambda f, t: f + newton * np.cos(2 * np.pi * hz * t + 0.7))


def drifting(n_per_s: float) -> Change:
    return force(lambda f, t: f + n_per_s * t)


def stepping(newton: float) -> Change:
    """The force's zero moves in mid-stroke, at its largest value, and stays there."""
    return force(lambda f, t: f + newton * (np.arange(f.size) > int(np.argmax(f))))


def bumped(newton: float) -> Change:
    """A false force for 40 ms before the largest one, and none after."""
    return force(lambda f, t: f + newton * ((t > t[np.argmax(f)] - 0.04) & (t < t[np.argmax(f)])))


def clipped(share: float) -> Change:
    return force(lambda f, t: np.minimum(f, share * f.max()))


def delayed(by_s: float) -> Change:
    return force(lambda f, t: np.interp(t - by_s, t, f))


def stretched(by: float) -> Change:
    return lambda data, _: replace(data, time_s=data.time_s * by)


def both(one: Change, other: Change) -> Change:
    return lambda data, stroke: other(one(data, stroke), stroke)


def film_turned(table: pd.DataFrame) -> pd.DataFrame:
    angles = [c for c in table if c.endswith("_rad") and not c.endswith("_u_rad")]
    return table.assign(**{c: -table[c] for c in angles})


def film_swapped(table: pd.DataFrame) -> pd.DataFrame:
    jack, repetition = "jack_relative_rad", "repetition_relative_rad"
    return table.assign(**{jack: table[repetition], repetition: table[jack]})


def film_rate(by: float) -> ChangeFilm:
    return lambda table: table.assign(time_s=table["time_s"].iloc[0] + by * (table["time_s"] - table["time_s"].iloc[0]))


def film_frames_lost(n: int) -> ChangeFilm:
    """Frames that were never stored, in the middle of the film; all later ones get times too early."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        middle = len(table) // 2
        kept = table.drop(index=table.index[middle : middle + n]).reset_index(drop=True)
        return kept.assign(time_s=table["time_s"].to_numpy()[: len(kept)], frame=np.arange(len(kept)))

    return change


FILMED = 2
TRAVEL = frozenset({"gross travel difference", "travel difference"})
ALSO_BY_FILM = frozenset({"film travel difference"}) | SYMPTOMS
CHANGED = frozenset({"changed condition"})
LATE = frozenset({"film time offset"})


def _kind(*names: str) -> frozenset[str]:
    return frozenset(names)


def faults() -> list[Fault]:
    """All planted faults."""
    return [*_encoders(), *_forces(), *_films(), *_sessions(), *_actions()]


def _encoders() -> Iterator[Fault]:
    for i, c in enumerate(CHANNELS):
        yield Fault(f"sign {c}", "", _kind("sign flip"), 1 + i, flipped(i))
    yield Fault("sign of all encoders, all trials", "", _kind("sign flip"), ALL, flipped(0, 1, 2))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        yield Fault(f"swap {CHANNELS[i]} {CHANNELS[j]}", "", _kind("swapped channels"), 5, swapped(i, j))
    yield Fault("swap key hammer, all trials", "", _kind("swapped channels"), ALL, swapped(0, 2))
    for i, c in enumerate(CHANNELS):
        for by in (0.25, 0.5, 4.0):
            yield Fault(
                f"decoding {c}", f"× {by:g}", _kind("gross travel difference"), ALL, scaled(i, by), flagged=ALSO_BY_FILM
            )
        for percent in (10, 6, 2):
            yield Fault(f"scale {c}", f"{percent} %", TRAVEL, ALL, scaled(i, 1 + percent / 100), flagged=ALSO_BY_FILM)
    yield Fault("dead encoder", "", _kind("no motion"), 3, scaled(0, 0.0))
    for counts in (2000, 600, 60):
        yield Fault(
            "slip hammer, all trials", f"{counts}", _kind("encoder return", "reading leaps"), ALL, slipped(2, counts)
        )
        yield Fault("slip key", f"{counts}", _kind("encoder return", "reading leaps"), 4, slipped(0, counts))
    for bit in (9, 6, 3):
        yield Fault("stuck bit whippen", f"{bit}", _kind("stuck bit"), 2, stuck(1, bit))
    for mm, trial in ((0.6, 1), (0.3, 5), (0.05, 5)):
        yield Fault("lift", f"{mm} mm", _kind("capstan gap"), trial, lifted(1e-3 * mm, 6e-3))
    yield Fault("swap and lift", "", _kind("swapped channels"), 2, both(lifted(0.3e-3, 6e-3), swapped(1, 2)))


def _forces() -> Iterator[Fault]:
    yield Fault("force sign, all trials", "", _kind("reversed force"), ALL, louder(-1.0))
    yield Fault("force sign", "", _kind("reversed force"), 3, louder(-1.0))
    yield Fault("force unit", "lbf", _kind("force factor"), ALL, louder(1 / 4.448222))
    yield Fault("force unit", "kgf", _kind("force factor"), ALL, louder(1 / 9.80665))
    yield Fault("force unit", "lbf in one", _kind("force factor"), 2, louder(1 / 4.448222))
    for percent in (10, 3, 1):
        yield Fault("force gain in one", f"{percent} %", SYMPTOMS, 4, louder(1 + percent / 100))
    for rate in (0.5, 0.2, 0.03):
        yield Fault("force drift", f"{rate} N/s", _kind("force return"), ALL, drifting(rate))
    for newton in (1.0, 0.3, 0.05):
        yield Fault("force zero in one", f"{newton} N", _kind("force return"), 5, stepping(newton))
        yield Fault("force bump in one", f"{newton} N", SYMPTOMS, 2, bumped(newton))
    for share in (0.7, 0.9, 0.99):
        yield Fault("saturation", f"{share}", _kind("force saturation"), 3, clipped(share))
    for ms in (5.0, 2.4, 0.3):
        yield Fault("undeclared delay", f"{ms} ms", _kind("force lag"), ALL, delayed(1e-3 * ms))
    for newton, hz in ((0.8, 59.95), (0.3, 50.07), (0.05, 60.0)):
        yield Fault("hum", f"{newton} N", _kind("hum"), 3, humming(newton, hz))


def _films() -> Iterator[Fault]:
    yield Fault("film mirrored", "", _kind("film mirrored"), FILMED, film=film_turned)
    yield Fault("film bodies swapped", "", _kind("film bodies swapped"), FILMED, film=film_swapped)
    for percent in (1.0, 0.5, 0.05):
        yield Fault(
            "film rate",
            f"{percent} %",
            _kind("film time drift"),
            FILMED,
            film=film_rate(1 + percent / 100),
            flagged=LATE,
        )
    for n in (20, 5, 1):
        yield Fault("frames lost", f"{n}", _kind("film time drift"), FILMED, film=film_frames_lost(n), flagged=LATE)
    for ms in (2.0, 0.5, 0.05):
        yield Fault("camera late", f"{ms} ms", _kind("film time offset"), FILMED, play={"film_late_s": 1e-3 * ms})


def _sessions() -> Iterator[Fault]:
    yield Fault("duplicated trial", "", _kind("duplicated trial"), 5, copy=True)
    for factor in (2.0, 1.3, 1.03):
        play = {"friction": ("key.joint_friction.A", factor)}
        yield Fault("friction changed", f"× {factor}", CHANGED, NONE, play=play, late=True)
    for percent in (5, 2, 0.2):
        yield Fault("gain changed", f"{percent} %", CHANGED, NONE, louder(1 + percent / 100), late=True)
    for strength in (1.6, 1.3, 1.1):
        yield Fault(
            "mixed strokes", f"× {strength}", _kind("mixed strokes"), NONE, play={"strength": strength}, late=True
        )
    yield Fault("weak trial", "0.7", _kind("stroke of its own"), 1, play={"strength": 0.7})
    yield Fault("late trial", "20 ms", _kind("outlying trial"), 6, play={"late_s": 0.02})
    yield Fault("rate", "4 kHz", _kind("sample rate"), 2, play={"rate_hz": 4000.0})
    yield Fault("truncated", "0.55", _kind("short record"), 6, cut(0.55))
    for percent in (1.0, 0.5, 0.1):
        yield Fault(
            "time base", f"{percent} %", _kind("film time drift"), ALL, stretched(1 + percent / 100), flagged=LATE
        )


def _actions() -> Iterator[Fault]:
    named = _kind("let-off", "check height")
    for mm in (2.0, 1.0, 0.3):
        for sign in (1, -1):
            play = {"changed": {"contact08.second.y": -sign * mm * 0.2e-3}}
            yield Fault("let-off moved", f"{sign * mm:+g} mm", named, NONE, play=play)
    for mm in (3.6, 3.0, 1.0):
        play = {"changed": {"contact04.second.x": mm * 1e-3 / 3}}
        yield Fault(
            "check moved",
            f"{mm:g} mm",
            _kind("check height", "let-off"),
            NONE,
            play=play,
            flagged=_kind("encoder return", "reading leaps"),
        )
    for path, factor in (
        ("key.joint_friction.A", 2.0),
        ("hammer.joint_friction.A", 2.0),
        ("contact01.friction.A", 0.5),
        ("contact10.friction.A", 2.0),
        ("hammer.mass", 1.03),
    ):
        # nothing names it: the set of compatible changes is no finding
        yield Fault("parameter", f"{path} × {factor:g}", frozenset(), NONE, play={"friction": (path, factor)})
    yield Fault("parameter", "force gain × 1.01", frozenset(), NONE, louder(1.01))


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
            mine = fault is not None and fault.has(number)
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
        return kind in (fault.named | fault.flagged) and (where or kind == "film time drift")

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
