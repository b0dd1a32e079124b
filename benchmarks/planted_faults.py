"""Faults that `benchmarks/planted_sweep.py` plants in sessions of the virtual bench, each kind at three sizes.

A fault says what the report may find: ``named`` are findings that name it (or the set of causes it belongs to),
``flagged`` findings that are its symptom, in the trial that has it. Everything else is a wrong finding. Sizes run from
gross to one that the stated detectability allows to stay silent.
"""

from __future__ import annotations

from collections.abc import Callable
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
