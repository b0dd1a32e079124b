"""Coverage of the trials' own band on the virtual bench, whose blows scatter in time and amplitude.

Every session is ten trials of one stroke with a seed of its own, read by encoders; the band of its first five and
of all ten is compared, over the whole record and for each encoder, with the mean of other trials of the same
stroke. Prints the share covered with its 95 % interval, and the band's root mean square half width over the range;
beside it the share that the band of the values alone would cover. A stroke is a kind, or ``KIND:PACE:STRENGTH``.
``--drawn`` is quicker: only the other trials are played, and each session draws ten of them; the rest are then the
others. Exit code 1 if the share of an encoder over all strokes lies outside 0.93 to 0.97.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from benchmarks.bench_strokes import AFTER_S, BEFORE_S, BENCH, KINDS
from benchmarks.runner import Run, Table, interval
from rig.configuration.rig_file import load_rig
from rig.simulated.bench.plant import ActionPlant, load_plant
from validation.conventions import ENCODER_CHANNELS, Array
from validation.statistics.repeatability_band import FEWEST_FOR_BAND, repeatability_band

RATE_HZ = 5000.0
LEAD_S = 0.02
TRIALS = (3, 5, 10)
ALLOWED_ON_BENCH = (0.93, 0.97)
N_PER_VOLT = 12.0


class Strokes:
    """Trials of one stroke, read in whole counts and zeroed: (n_samples, 3), rad."""

    def __init__(self, kind: str, pace: float, strength: float, seed: int) -> None:
        at, newton = KINDS[kind]
        t = np.arange(int((BEFORE_S + 1.2 * at[-1] + AFTER_S) * RATE_HZ)) / RATE_HZ
        self.command_v = strength * np.interp(t, BEFORE_S + pace * np.array(at), newton) / N_PER_VOLT
        self.first = int((BEFORE_S - LEAD_S) * RATE_HZ)
        self.plant: ActionPlant = load_plant(BENCH, seed, RATE_HZ)
        per = {e.name: 2 * np.pi / e.counts_per_revolution for e in load_rig("virtual").config.encoders}
        self.count_rad = np.array([per[name] for name in ENCODER_CHANNELS])
        self.rng = np.random.default_rng([seed, 97])

    def trial(self, session: int, number: int) -> Array:
        """One trial of the session with this seed."""
        self.plant.seed = session
        self.plant.start_trial(number)
        angle = self.plant.advance(self.command_v).angle_rad
        count = np.floor(angle / self.count_rad + self.rng.uniform(0, 1, 3))
        return np.asarray(((count - count[0]) * self.count_rad)[self.first :])


CHUNK = 50  # sessions that are a case of their own


@cache
def others_of(kind: str, pace: float, strength: float, seed: int, n: int) -> tuple[Strokes, Array]:
    """A stroke, and its other trials, (n_samples, 3, n): one seed; sessions have the following ones."""
    strokes = Strokes(kind, pace, strength, seed)
    return strokes, np.stack([strokes.trial(1_000_000 * seed, k) for k in range(1, n + 1)], axis=2)


def sessions(stroke: tuple[str, float, float, int, int], chunk: int, drawn: bool) -> Iterator[tuple[Array, Array]]:
    """Curves of each session of a chunk, (n_samples, 3, n), and the mean of the other trials, (n_samples, 3)."""
    (strokes, pool), n = others_of(*stroke), max(TRIALS)
    strokes.rng = np.random.default_rng([stroke[3], 97, chunk])
    total = pool.sum(axis=2)
    for k in range(CHUNK * chunk, CHUNK * (chunk + 1)):
        if drawn:
            mine = pool[:, :, strokes.rng.choice(pool.shape[2], n, replace=False)]
            yield mine, (total - mine.sum(axis=2)) / (pool.shape[2] - n)
            continue
        seed = 1_000_000 * stroke[3] + 1 + k
        yield np.stack([strokes.trial(seed, number) for number in range(1, n + 1)], axis=2), total / pool.shape[2]


def covered(stroke: tuple[str, float, float, int, int], chunk: int, drawn: bool) -> dict[str, Any]:
    """By number of trials and encoder, of each session of a chunk: covered, covered by the band of values alone, half
    width over the range."""
    u = others_of(*stroke)[0].count_rad / np.sqrt(6)
    found: dict[str, list[list[list[float]]]] = {str(n): [] for n in TRIALS if n >= FEWEST_FOR_BAND}
    for curves, others in sessions(stroke, chunk, drawn):
        extent = np.ptp(others, axis=0)
        for n, cells in found.items():
            row = []
            for c in range(3):
                band = repeatability_band(curves[:, c, : int(n)], u_sample=float(u[c]))
                s = np.maximum(curves[:, c, : int(n)].std(axis=1, ddof=1), u[c])
                by_value = np.all(np.abs(others[:, c] - band.mean) <= band.factor * s / np.sqrt(int(n)))
                width = float(np.sqrt(np.mean(band.half_width**2)) / extent[c])
                row.append([float(band.covers(others[:, c])), float(by_value), width])
            cells.append(row)
    return found


def main(run: Run) -> bool:
    """Print a row for each stroke and encoder, and for each encoder over all strokes."""
    table = Table(
        "stroke, encoder:26s", "n:3d", "covered:.3f", "low:.3f", "high:.3f", "by value:.3f", "half width %:.2f"
    )
    every: dict[str, list[Array]] = {}
    for stroke in run.strokes:
        kind, pace, strength = (*stroke.split(":"), "1", "1")[:3]
        key = kind, float(pace), float(strength), run.seed, run.others
        chunks = [(*key, chunk, run.drawn) for chunk in range(-(-run.sessions // CHUNK))]
        done = [outcome for _, outcome in run.cases(chunks, lambda *key: covered(key[:5], *key[5:]))]
        for n in done[0] if done else ():
            held, by_value, width = np.moveaxis(np.concatenate([np.array(part[n]) for part in done]), 2, 0)
            every.setdefault(n, []).append(held)
            for c, name in enumerate(ENCODER_CHANNELS):
                limits = interval(held[:, c].sum(), len(held))
                widths = 100 * width[:, c].mean()
                table.row(f"{stroke} {name}", int(n), held[:, c].mean(), *limits, by_value[:, c].mean(), widths)
    good = bool(every)
    for n, parts in every.items():
        for name, held in zip(ENCODER_CHANNELS, np.concatenate(parts).T, strict=True):
            low, high = interval(held.sum(), held.size)
            inside = ALLOWED_ON_BENCH[0] <= held.mean() <= ALLOWED_ON_BENCH[1]
            inside |= run.quick and low <= ALLOWED_ON_BENCH[1] and high >= ALLOWED_ON_BENCH[0]  # too few to tell
            good &= bool(inside)
            table.row(f"every {name}" + ("" if inside else " OUTSIDE"), int(n), held.mean(), low, high, None, None)
    return good
