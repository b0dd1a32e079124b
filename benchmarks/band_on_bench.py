"""Coverage of the trials' own band on the virtual bench, whose blows scatter in time and amplitude.

    python benchmarks/band_on_bench.py [--sessions 2000] [--others 2000] [--strokes forte,piano,double,staccato]
                                       [--seed 1] [--pace 1.0] [--strength 1.0] [--drawn]

Every session is ten trials of one stroke with a seed of its own, read by encoders; the band of its first five and of
all ten is compared, over the whole record and for each encoder, with the mean of other trials of the same stroke.
Prints the share covered with its 95 % interval, and the band's root mean square half width over the range; beside it
the share that the band of the values alone would cover. Pace and strength make other strokes. ``--drawn`` is quicker:
only the other trials are played, and each session draws ten of them; the rest are then the others. Exit code 1 if the
share of all encoders together lies outside 0.93 to 0.97.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.bench_strokes import AFTER_S, BEFORE_S, BENCH, KINDS
from rig.configuration.rig_file import load_rig
from rig.simulated.bench.plant import ActionPlant, load_plant
from validation.conventions import ENCODER_CHANNELS, Array
from validation.statistics.bands import FEWEST_FOR_BAND, repeatability_band

RATE_HZ = 5000.0
LEAD_S = 0.02
TRIALS = (3, 5, 10)
ALLOWED = (0.93, 0.97)
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


def sessions(strokes: Strokes, options: argparse.Namespace) -> Iterator[tuple[Array, Array]]:
    """Curves of each session, (n_samples, 3, n), and the mean of the other trials, (n_samples, 3)."""
    # the others have one seed, the sessions the following ones
    first, n = 1_000_000 * options.seed, max(TRIALS)
    if not options.drawn:
        others = sum(strokes.trial(first, k) for k in range(1, options.others + 1)) / options.others
        for k in range(options.sessions):
            yield np.stack([strokes.trial(first + 1 + k, number) for number in range(1, n + 1)], axis=2), others
        return
    pool = np.stack([strokes.trial(first, k) for k in range(1, options.others + 1)], axis=2)
    total = pool.sum(axis=2)
    for _ in range(options.sessions):
        mine = pool[:, :, strokes.rng.choice(options.others, n, replace=False)]
        yield mine, (total - mine.sum(axis=2)) / (options.others - n)


def line(name: str, n: int, held: Array, by_value: Array, width: float) -> str:
    low, high = stats.binomtest(int(held.sum()), held.size).proportion_ci(0.95, "exact")
    return (
        f"{name:18s} {n:3d} {held.size:7d} {held.mean():8.3f}  {low:.3f} to {high:.3f} {by_value.mean():10.3f} "
        f"{100 * width:9.2f} %"
    )


def coverage(kind: str, options: argparse.Namespace) -> bool:
    """Print the rows of one stroke; whether all of them are within the allowed shares."""
    start = time.perf_counter()
    strokes = Strokes(kind, options.pace, options.strength, options.seed)
    u = strokes.count_rad / np.sqrt(6)
    held = {n: np.zeros((options.sessions, 3), dtype=bool) for n in TRIALS}
    by_value = {n: np.zeros((options.sessions, 3), dtype=bool) for n in TRIALS}
    width = {n: np.zeros((options.sessions, 3)) for n in TRIALS}
    for k, (curves, others) in enumerate(sessions(strokes, options)):
        extent = np.ptp(others, axis=0)
        for n in TRIALS:
            for c in range(3) if n >= FEWEST_FOR_BAND else ():
                band = repeatability_band(curves[:, c, :n], u_sample=float(u[c]))
                s = np.maximum(curves[:, c, :n].std(axis=1, ddof=1), u[c])
                held[n][k, c] = band.covers(others[:, c])
                by_value[n][k, c] = np.all(np.abs(others[:, c] - band.mean) <= band.factor * s / np.sqrt(n))
                width[n][k, c] = np.sqrt(np.mean(band.half_width**2)) / extent[c]
    good = True
    for n in TRIALS:
        if n < FEWEST_FOR_BAND:
            print(f"{kind:18s} {n:3d} too few for a band")
            continue
        for c, name in enumerate(ENCODER_CHANNELS):
            print(line(f"{kind} {name}", n, held[n][:, c], by_value[n][:, c], width[n][:, c].mean()))
        share = held[n].mean()
        inside = ALLOWED[0] <= share <= ALLOWED[1]
        good &= bool(inside)
        print(f"{kind + ' all':18s} {n:3d} {'':7s} {share:8.3f}  {'' if inside else 'OUTSIDE'}")
    print(f"({time.perf_counter() - start:.0f} s)", flush=True)
    return good


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=2000)
    parser.add_argument("--others", type=int, default=2000)
    parser.add_argument("--strokes", default="forte,piano,double,staccato")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--pace", type=float, default=1.0)
    parser.add_argument("--strength", type=float, default=1.0)
    parser.add_argument("--drawn", action="store_true", help="draw the sessions from the other trials")
    options = parser.parse_args()
    print(f"{'stroke, encoder':18s} {'n':>3s} {'of':>7s} {'covered':>8s}  95 % interval   by values  half width")
    found = [coverage(kind, options) for kind in options.strokes.split(",")]
    return 0 if all(found) else 1


if __name__ == "__main__":
    sys.exit(main())
