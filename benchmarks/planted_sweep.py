"""Held-out planted faults: does a report identify each, and raise no false finding in any session?

    python benchmarks/planted_sweep.py [--only sign,swap] [--clean 50] [--seed 800] [--specimen printed|bench]

Every session has six strokes of the virtual bench; one trial, or all of them, or the model has one fault (or two).
Prints a line per session: what was planted, what was named, and whether that is right.  A fault for which there is no
rule must at least not be misnamed.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.bench_strokes import BENCH, Stroke, play
from rig.session import CameraInfo, Session, SessionInfo, TrialData
from rig.session.info import FileInfo
from rig.simulated.bench.plant import load_plant
from validation import compare_session

TRIALS = 6
FILMED = 2
SCALE_RADIUS_M = 0.02608
QUICK = {"keep_predictions": False, "rivals": (), "budget": False}
CHANNELS = ("key", "whippen", "hammer")
Change = Callable[[TrialData, Stroke], TrialData]


@dataclass
class Fault:
    """A planted fault: its trial (0: no single trial), how it is made, and the required findings (kind, trial)."""

    name: str
    expected: set[tuple[str, int]] = field(default_factory=set)
    trial: int = 0
    change: Change | None = None
    play: dict = field(default_factory=dict)
    late_s: float = 0.0
    allowed: set[str] = field(default_factory=set)


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


def flipped(i: int) -> Change:
    return lambda data, _: recount(data, lambda c: c * np.where(np.arange(3) == i, -1, 1))


def swapped(i: int, j: int) -> Change:
    """Angles of two bodies swapped."""

    def change(data: TrialData, stroke: Stroke) -> TrialData:
        per = np.array([e.rad_per_count for e in data.encoders])
        order = [0, 1, 2]
        order[i], order[j] = j, i
        return recount(data, lambda c: np.round((c * per)[:, order] / per).astype(np.int64))

    return change


def humming(amplitude_n: float, hz: float, drift: float = 0.0) -> Change:
    def change(data: TrialData, _: Stroke) -> TrialData:
        t = data.time_s
        return replace(data, force_n=data.force_n + amplitude_n * np.cos(2 * np.pi * hz * t * (1 + drift * t) + 0.7))

    return change


def scaled(i: int, by: float) -> Change:
    return lambda data, _: recount(data, lambda c: np.round(c * np.where(np.arange(3) == i, by, 1.0)).astype(np.int64))


def stuck(i: int, bit: int) -> Change:
    def change(c: np.ndarray) -> np.ndarray:
        c[:, i] |= 1 << bit
        return c

    return lambda data, _: recount(data, change)


def cut(share: float) -> Change:
    def change(data: TrialData, _: Stroke) -> TrialData:
        n = int(share * data.time_s.size)
        parts = ("time_s", "force_n", "force_raw", "motor_command_v", "encoder_count")
        return replace(data, **{name: getattr(data, name)[:n] for name in parts})

    return change


def louder(by: float) -> Change:
    return lambda data, _: replace(data, force_n=data.force_n * by)


def both(one: Change, other: Change) -> Change:
    return lambda data, stroke: other(one(data, stroke), stroke)


def faults() -> list[Fault]:
    """All planted faults."""
    out = [Fault(f"sign {c}", {("sign flip", 1 + i)}, 1 + i, flipped(i)) for i, c in enumerate(CHANNELS)]
    out += [
        Fault(f"swap {CHANNELS[i]} {CHANNELS[j]}", {("swapped channels", 5)}, 5, swapped(i, j))
        for i, j in ((0, 1), (0, 2), (1, 2))
    ]
    out += [Fault(f"camera {1e3 * s:+g} ms", {("camera offset", FILMED)}, late_s=s) for s in (-1e-3, 5e-4, 2e-3, 2e-4)]
    out += [
        Fault("hum 50 Hz", {("hum", 4)}, 4, humming(0.3, 50.07)),
        Fault("hum 60 Hz", {("hum", 3)}, 3, humming(0.8, 59.95)),
        Fault("hum with drift", {("hum", 3)}, 3, humming(0.4, 60.0, 3e-4)),
        Fault("lift 0.15 mm", {("key lift", 5)}, 5, lifted(0.15e-3, 8e-3)),
        Fault("lift 0.6 mm", {("key lift", 1)}, 1, lifted(0.6e-3, 5e-3)),
        Fault("weak trial 1", {("outlying trial", 1)}, 1, play={"strength": 0.7}),
        Fault("late trial 6", {("outlying trial", 6)}, 6, play={"late_s": 0.02}),
        Fault("rate 4 kHz", {("sample rate", 2)}, 2, play={"rate_hz": 4000.0}),
        Fault("sign and hum", {("sign flip", 4), ("hum", 4)}, 4, both(flipped(1), humming(0.5, 60.0))),
        Fault(
            "swap and lift",
            {("swapped channels", 2)},
            2,
            both(lifted(0.3e-3, 6e-3), swapped(1, 2)),
            allowed={"outlying trial"},
        ),
        Fault("encoder scale 2 %", set(), 3, scaled(1, 1.02), allowed={"outlying trial", "encoder scale"}),
        Fault("hammer scale 2 % in all", set(), -1, scaled(2, 1.02), allowed={"encoder scale"}),
        Fault("force scale 3 %", set(), 4, louder(1.03), allowed={"outlying trial", "force scale"}),
        Fault("force scale 3 % in all", set(), -1, louder(1.03), allowed={"force scale"}),
        Fault("stuck bit", set(), 2, stuck(2, 4), allowed={"outlying trial", "stuck bit"}),
        Fault("stuck high bit", set(), 2, stuck(1, 9), allowed={"outlying trial", "stuck bit"}),
        Fault("truncated", {("short record", 6)}, 6, cut(0.55)),
        Fault("dead encoder", {("dead channel", 3)}, 3, scaled(1, 0.0)),
    ]
    for path, factor in (
        ("key.joint_friction.A", 2.0),
        ("key.joint_friction.A", 0.5),
        ("hammer.joint_friction.A", 2.0),
        ("contact01.friction.A", 0.5),
        ("contact07.friction.A", 2.0),
        ("contact10.friction.A", 2.0),
    ):
        found = Fault(f"friction {path} x {factor:g}", {("wrong friction", 0)}, play={"friction": (path, factor)})
        out.append(found)
    return out


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
        moved[path] = factor * printed[path] - bench[path]
    return moved


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


def findings(fault: Fault, seed: int, kind: str, specimen: str) -> pd.DataFrame:
    """Findings reported for a session with one fault."""
    rng = np.random.default_rng(seed)
    changed = specimen_change(specimen, fault.play.get("friction"))
    with tempfile.TemporaryDirectory() as folder:
        info = SessionInfo(
            simulated=True, name=fault.name, operator="sweep", rig=FileInfo(name="none"), profile=FileInfo(name=kind)
        )
        session = Session.create(Path(folder) / "session", info)
        for number in range(1, TRIALS + 1):
            mine = number == fault.trial
            options = {k: v for k, v in fault.play.items() if k in ("rate_hz", "strength", "late_s")} if mine else {}
            stroke = play(kind, seed, number=number, changed=changed, alike=True, **options)
            data = stroke.data
            if fault.change is not None and (mine or fault.trial < 0):
                data = fault.change(data, stroke)
            table = None
            if number == FILMED:
                camera, table = film(stroke, fault.late_s, rng)
                data = replace(data, camera=camera)
            session.add_trial(data)
            if table is not None:
                session.write_derived("angles", number, table)
        return compare_session(session, model.load_action(), **QUICK).findings


def judged(fault: Fault, found: pd.DataFrame) -> tuple[str, set[tuple[str, int]]]:
    """Return the verdict (right, silent, missed or wrong) and the findings named."""
    named = {(str(f.kind), 0 if math.isnan(f.trial) else int(f.trial)) for f in found.itertuples()}
    wrong = {
        (k, t) for k, t in named - fault.expected if k not in fault.allowed or (fault.trial > 0 and t != fault.trial)
    }
    if fault.play.get("friction") and ("wrong friction", 0) in named:
        channel = next(f.channel for f in found.itertuples() if f.kind == "wrong friction")
        if channel != fault.play["friction"][0]:
            return f"WRONG ({channel})", named
    if wrong:
        return "WRONG", named
    if fault.expected - named:
        return "missed", named
    return "right" if named or not (fault.expected or fault.allowed) else "silent", named


def main() -> None:
    """Print a line per session."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="")
    parser.add_argument("--clean", type=int, default=0)
    parser.add_argument("--seed", type=int, default=800)
    parser.add_argument("--kinds", default="forte")
    parser.add_argument("--specimen", choices=("printed", "bench"), default="printed")
    options = parser.parse_args()
    tally: dict[str, int] = {}
    for kind in options.kinds.split(","):
        planted = [Fault(f"clean {n}") for n in range(options.clean)] or faults()
        for n, fault in enumerate(planted):
            if options.only and not any(word in fault.name for word in options.only.split(",")):
                continue
            found = findings(fault, options.seed + n, kind, options.specimen)
            verdict, named = judged(fault, found)
            tally[verdict.split()[0]] = tally.get(verdict.split()[0], 0) + 1
            if not (fault.name.startswith("clean") and verdict == "right"):
                said = ", ".join(f"{k} {t or ''}".strip() for k, t in sorted(named)) or "nothing"
                print(f"{kind:10s} {fault.name:38s} {verdict:8s} {said}", flush=True)
    print(tally)


if __name__ == "__main__":
    main()
