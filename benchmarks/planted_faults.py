"""Faults that `planted_sweep` plants in sessions of the virtual bench, each kind at three sizes: how, and their list.

A fault says what the report may find: ``named`` are findings that name it (or the set of causes it belongs to),
``flagged`` findings that are its symptom, in the trial that has it. Everything else is a wrong finding. Sizes run from
gross to one that the stated detectability allows to stay silent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from benchmarks.bench_strokes import Stroke
from rig.session import TrialData

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
        return number >= FROM if self.late else self.trial in (ALL, number)


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


def louder(by: float) -> Change:
    return lambda data, _: replace(data, force_n=data.force_n * by)


def drifting(n_per_s: float) -> Change:
    return lambda data, _: replace(data, force_n=data.force_n + n_per_s * data.time_s)


def stepping(newton: float) -> Change:
    """The force's zero moves in mid-stroke, at its largest value, and stays there."""

    def change(data: TrialData, _: Stroke) -> TrialData:
        after = np.arange(data.force_n.size) > int(np.argmax(data.force_n))
        return replace(data, force_n=data.force_n + newton * after)

    return change


def bumped(newton: float) -> Change:
    """A false force for 40 ms before the largest one, and none after."""

    def change(data: TrialData, _: Stroke) -> TrialData:
        at = float(data.time_s[int(np.argmax(data.force_n))])
        during = (data.time_s > at - 0.04) & (data.time_s < at)
        return replace(data, force_n=data.force_n + newton * during)

    return change


def clipped(share: float) -> Change:
    return lambda data, _: replace(data, force_n=np.minimum(data.force_n, share * data.force_n.max()))


def delayed(by_s: float) -> Change:
    return lambda data, _: replace(data, force_n=np.interp(data.time_s - by_s, data.time_s, data.force_n))


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
TRAVEL = frozenset({"encoder scale", "encoder scale or stops"})
ALSO_BY_FILM = frozenset({"film or encoder scale"}) | SYMPTOMS
CHANGED = frozenset({"changed condition"})
LATE = frozenset({"camera offset"})


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
            yield Fault(f"decoding {c}", f"× {by:g}", _kind("encoder scale"), ALL, scaled(i, by), flagged=ALSO_BY_FILM)
        for percent in (10, 6, 2):
            yield Fault(f"scale {c}", f"{percent} %", TRAVEL, ALL, scaled(i, 1 + percent / 100), flagged=ALSO_BY_FILM)
    yield Fault("dead encoder", "", _kind("dead channel"), 3, scaled(0, 0.0))
    for counts in (2000, 600, 60):
        yield Fault("slip hammer, all trials", f"{counts}", _kind("encoder return"), ALL, slipped(2, counts))
        yield Fault("slip key", f"{counts}", _kind("encoder return"), 4, slipped(0, counts))
    for bit in (9, 6, 3):
        yield Fault("stuck bit whippen", f"{bit}", _kind("stuck bit"), 2, stuck(1, bit))
    for mm, trial in ((0.6, 1), (0.3, 5), (0.05, 5)):
        yield Fault("lift", f"{mm} mm", _kind("key lift"), trial, lifted(1e-3 * mm, 6e-3))
    yield Fault("swap and lift", "", _kind("swapped channels"), 2, both(lifted(0.3e-3, 6e-3), swapped(1, 2)))


def _forces() -> Iterator[Fault]:
    yield Fault("force sign, all trials", "", _kind("force sign"), ALL, louder(-1.0))
    yield Fault("force sign", "", _kind("force sign"), 3, louder(-1.0))
    yield Fault("force unit", "lbf", _kind("force unit"), ALL, louder(1 / 4.448222))
    yield Fault("force unit", "kgf", _kind("force unit"), ALL, louder(1 / 9.80665))
    yield Fault("force unit", "lbf in one", _kind("force unit"), 2, louder(1 / 4.448222))
    for percent in (10, 3, 1):
        yield Fault("force gain in one", f"{percent} %", SYMPTOMS, 4, louder(1 + percent / 100))
    for rate in (0.5, 0.2, 0.03):
        yield Fault("force drift", f"{rate} N/s", _kind("force drift"), ALL, drifting(rate))
    for newton in (1.0, 0.3, 0.05):
        yield Fault("force zero in one", f"{newton} N", _kind("force drift"), 5, stepping(newton))
        yield Fault("force bump in one", f"{newton} N", SYMPTOMS, 2, bumped(newton))
    for share in (0.7, 0.9, 0.99):
        yield Fault("saturation", f"{share}", _kind("force saturation"), 3, clipped(share))
    for ms in (5.0, 2.4, 0.3):
        yield Fault("undeclared delay", f"{ms} ms", _kind("force delay"), ALL, delayed(1e-3 * ms))
    for newton, hz in ((0.8, 59.95), (0.3, 50.07), (0.05, 60.0)):
        yield Fault("hum", f"{newton} N", _kind("hum"), 3, humming(newton, hz))


def _films() -> Iterator[Fault]:
    yield Fault("film mirrored", "", _kind("film mirrored"), FILMED, film=film_turned)
    yield Fault("film bodies swapped", "", _kind("film bodies swapped"), FILMED, film=film_swapped)
    for percent in (1.0, 0.5, 0.05):
        yield Fault(
            "film rate", f"{percent} %", _kind("film clock"), FILMED, film=film_rate(1 + percent / 100), flagged=LATE
        )
    for n in (20, 5, 1):
        yield Fault("frames lost", f"{n}", _kind("film clock"), FILMED, film=film_frames_lost(n), flagged=LATE)
    for ms in (2.0, 0.5, 0.05):
        yield Fault("camera late", f"{ms} ms", _kind("camera offset"), FILMED, play={"film_late_s": 1e-3 * ms})


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
    yield Fault("weak trial", "0.7", _kind("outlying trial"), 1, play={"strength": 0.7})
    yield Fault("late trial", "20 ms", _kind("outlying trial"), 6, play={"late_s": 0.02})
    yield Fault("rate", "4 kHz", _kind("sample rate"), 2, play={"rate_hz": 4000.0})
    yield Fault("truncated", "0.55", _kind("short record"), 6, cut(0.55))
    for percent in (1.0, 0.5, 0.1):
        yield Fault("time base", f"{percent} %", _kind("film clock"), ALL, stretched(1 + percent / 100), flagged=LATE)


def _actions() -> Iterator[Fault]:
    named = _kind("regulation")
    for mm in (2.0, 1.0, 0.3):
        for sign in (1, -1):
            play = {"changed": {"contact08.second.y": -sign * mm * 0.2e-3}}
            yield Fault("let-off moved", f"{sign * mm:+g} mm", named, NONE, play=play)
    for mm in (3.6, 3.0, 1.0):
        play = {"changed": {"contact04.second.x": mm * 1e-3 / 3}}
        yield Fault(
            "check moved", f"{mm:g} mm", _kind("check height"), NONE, play=play, flagged=_kind("encoder return")
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
