"""From a trial to the readings of a press: force without delay, hum and offset, way of the arm's tip, both phases.

Force is that above the reading at rest plus the stated preload (docs/explanation/acquisition.md).
Encoders are not delayed, the force of a bridge module is: without its delay taken off, the loop would be wider by
speed times delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.configuration.felt_setup import FeltConfig
from rig.errors import RigInputError
from rig.session.trial_data import TrialData

BINS = 160
"""Points of a phase at most: means over equal times."""
FEWEST_SAMPLES = 3
"""Of a point."""
LOWEST, HIGHEST = 0.07, 0.92
"""Part of the way that counts: between where the speed is reached and where it is left."""
HARMONICS = 3
HUM_HZ = 0.15
"""How far the mains may be from its nominal frequency."""
LEAST_COUNTS = 20
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Readings:
    """Means over short times: the way of the tip since rest, m, the force, N, its rate, N/s, loading first.

    ``samples`` are the samples of each mean; ``loading`` is true for the first phase; ``count_m`` is the way of one
    count, ``u_force_n`` the scatter of the force from sample to sample.
    """

    moved_m: Array
    force_n: Array
    rate_n_per_s: Array
    samples: NDArray[np.int64]
    loading: NDArray[np.bool_]
    count_m: float
    u_force_n: float
    peak_n: float


def readings(trial: TrialData, felt: FeltConfig, lowest: float = LOWEST) -> Readings:
    """Cut press and release out of a trial.

    Parameters
    ----------
    lowest : from which share of the way on; 0 takes the beginning as well, where the speed is still growing

    Raises
    ------
    RigInputError
        The encoder did not turn, or the trial is too short.
    """
    force, rate = trial.force_info, trial.sample_rate_hz
    body = [encoder.name for encoder in trial.encoders].index(felt.encoder)
    per_count = abs(trial.encoders[body].rad_per_count) * felt.radius_m
    counts = trial.encoder_count[:, body].astype(np.float64)
    quiet = int(trial.blow_start_s * rate)
    turned = counts - counts[:quiet].mean()
    moved = turned * per_count * np.sign(turned[int(np.argmax(np.abs(turned)))])
    if np.abs(turned).max() < LEAST_COUNTS:
        raise RigInputError(
            f"trial {trial.number}: the {felt.encoder} encoder turned by {np.abs(turned).max():.0f} counts, allowed "
            f"from {LEAST_COUNTS}; is its scale on the motor's shaft (felt.encoder), and the arm on the felt?"
        )
    felt_n, scatter = _pressed(trial, quiet)
    k = np.arange(trial.n_valid) + force.group_delay_s * rate
    felt_n = np.interp(k, np.arange(trial.n_valid), felt_n)
    change = np.gradient(felt_n) * rate
    top = float(moved.max())
    inside = np.flatnonzero(moved >= HIGHEST * top)
    # between the phases the arm rests at the peak
    rise = _between(moved, quiet, int(inside[0]), lowest * top)
    last = min(trial.n_valid - int(np.ceil(force.group_delay_s * rate)) - 1, moved.size)
    fall = _between(moved[last - 1 :: -1], 0, last - 1 - int(inside[-1]), lowest * top)
    fall = (last - fall[1], last - fall[0])
    parts = [_binned(span, moved, felt_n, change) for span in (rise, fall)]
    columns = [np.concatenate([part[k] for part in parts]) for k in range(4)]
    return Readings(
        moved_m=columns[0],
        force_n=columns[1],
        rate_n_per_s=columns[2],
        samples=columns[3].astype(np.int64),
        loading=np.arange(columns[0].size) < parts[0][0].size,
        count_m=per_count,
        u_force_n=scatter,
        peak_n=float(felt_n[quiet:].max()),
    )


def loading_speed(
    x_m: Array, loading: NDArray[np.bool_], samples: NDArray[np.int64], rate_hz: float
) -> tuple[float, float]:
    """Return the mean speed of the first phase, m/s, and that of its last third, where the loop is widest."""
    at = np.cumsum(samples[loading]) / rate_hz
    x = x_m[loading]
    last = x > x[-1] * 2.0 / 3.0
    return float(np.polyfit(at, x, 1)[0]), float(np.polyfit(at[last], x[last], 1)[0])


def _pressed(trial: TrialData, quiet: int) -> tuple[Array, float]:
    """Force above rest plus preload, without mains hum, and its scatter from sample to sample, N."""
    t, n = trial.time_s, trial.n_valid
    calm = np.zeros(n, dtype=bool)
    calm[: max(quiet - 5, 1)] = True
    calm[-int(0.15 * trial.sample_rate_hz) :] = True
    late = np.arange(n) > n // 2
    nominal = trial.force_info.mains_frequency_hz
    best: tuple[float, Array, Array] | None = None
    for mains in nominal + np.linspace(-HUM_HZ, HUM_HZ, 31):
        waves = [f(2 * np.pi * k * mains * t) for k in range(1, HARMONICS + 1) for f in (np.sin, np.cos)]
        terms = np.column_stack([~late, late, *waves])  # a felt that has not come back rests at another force
        found, *_ = np.linalg.lstsq(terms[calm], trial.force_n[calm], rcond=None)
        left = trial.force_n[calm] - terms[calm] @ found
        if best is None or float(left @ left) < best[0]:
            best = float(left @ left), terms, found
    assert best is not None
    _, terms, found = best
    hum = terms[:, 2:] @ found[2:]
    return trial.force_n - hum - found[0] + trial.force_info.preload_n, float(np.sqrt(best[0] / calm.sum()))


def _between(moved: Array, start: int, top: int, low: float) -> tuple[int, int]:
    """First sample after the last one below ``low``, up to the first one that has reached the top."""
    below = np.flatnonzero(moved[start:top] < low)
    first = start + (int(below[-1]) + 1 if below.size else 0)
    if top - first < 10 * FEWEST_SAMPLES:
        raise RigInputError(
            f"felt: a phase of {top - first} samples, allowed from {10 * FEWEST_SAMPLES}; press more slowly or harder"
        )
    return first, top


def _binned(span: tuple[int, int], *series: Array) -> tuple[Array, ...]:
    """Means over equal times, and how many samples each has."""
    first, end = span
    bins = min(BINS, (end - first) // FEWEST_SAMPLES)
    edges = np.linspace(first, end, bins + 1).astype(int)
    size = np.diff(edges)
    return *(np.add.reduceat(one[:end], edges[:-1]) / size for one in series), size.astype(np.float64)
