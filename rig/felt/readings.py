"""Means of displacement and force over short times of press and release, cut out of a trial.

Force is that above the reading at rest plus the stated preload, without mains hum. Encoders are not delayed, the force
of a bridge module is: without its delay taken off, the loop would be wider by speed times delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.configuration.rig_file import FeltConfig
from rig.errors import RigInputError
from rig.felt.press_profile import EASE
from rig.mains_hum import SEARCH_HZ, fit_mains_hum
from rig.session.trial_data import TrialData

Array = NDArray[np.float64]
BINS = 160  # points of a phase at most, means over equal times: a curve file of some 300 lines
FEWEST_SAMPLES = 3  # of a point, so that a spike is averaged
FEWEST_POINTS = 10  # of a phase: a cubic with its loop and first touch has five unknowns
LOWEST, HIGHEST = 0.5 * EASE, 1.0 - 0.5 * EASE  # share of the way that counts: at full speed
SETTLED_S = 0.15  # at the end of a press, in which the arm rests: seven periods of 50 Hz
HUM_GRID = 41  # mains frequencies that are tried: 0.01 Hz apart, a tenth of a turn in ten seconds
LEAST_COUNTS = 20  # turn of the encoder: the rounding of a count, u = 0.29, is then at most 1.5 % of it


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


def read_press(trial: TrialData, felt: FeltConfig, lowest_share: float = LOWEST) -> Readings:
    """Return means over short times of the tip's way since rest and the force, loading then unloading, where the way is
    between ``lowest_share`` and nearly all of its largest; refuse a trial in which the arm hardly turned."""
    force, rate = trial.force_info, trial.sample_rate_hz
    body = [encoder.name for encoder in trial.encoders].index(felt.encoder)
    per_count = abs(trial.encoders[body].rad_per_count) * felt.radius_m
    counts = trial.encoder_count[:, body].astype(np.float64)
    quiet = int(trial.blow_start_s * rate)
    turned = counts - counts[:quiet].mean()
    displacement_m = turned * per_count * np.sign(turned[int(np.argmax(np.abs(turned)))])
    if np.abs(turned).max() < LEAST_COUNTS:
        raise RigInputError(
            f"trial {trial.number}: the {felt.encoder} encoder turned by {np.abs(turned).max():.0f} counts, allowed "
            f"from {LEAST_COUNTS}; is its scale on the motor's shaft (felt.encoder), and the arm on the felt?"
        )
    felt_n, scatter = _pressing_force(trial, quiet)
    k = np.arange(trial.n_valid) + force.group_delay_s * rate
    felt_n = np.interp(k, np.arange(trial.n_valid), felt_n)
    change = np.gradient(felt_n) * rate
    top = float(displacement_m.max())
    inside = np.flatnonzero(displacement_m >= HIGHEST * top)
    # between the phases the arm rests at the peak
    rise = _phase_span(displacement_m, quiet, int(inside[0]), lowest_share * top)
    last = min(trial.n_valid - int(np.ceil(force.group_delay_s * rate)) - 1, displacement_m.size)
    fall = _phase_span(displacement_m[last - 1 :: -1], 0, last - 1 - int(inside[-1]), lowest_share * top)
    fall = (last - fall[1], last - fall[0])
    parts = [_bin_means(span, displacement_m, felt_n, change) for span in (rise, fall)]
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


def _pressing_force(trial: TrialData, quiet: int) -> tuple[Array, float]:
    """Return the force (n,), N, above that at rest plus the stated preload, without mains hum, and its scatter from
    sample to sample, N; ``quiet``: how many samples come before the press."""
    t, n = trial.time_s, trial.n_valid
    calm = np.zeros(n, dtype=bool)
    calm[: max(quiet, 1)] = True
    calm[-int(SETTLED_S * trial.sample_rate_hz) :] = True
    late = np.arange(n) > n // 2
    nominal = trial.force_info.mains_frequency_hz
    rest = np.column_stack([~late, late]).astype(float)  # a felt that has not come back rests at another force
    fit = fit_mains_hum(t, trial.raw_force_n, calm, nominal + np.linspace(-SEARCH_HZ, SEARCH_HZ, HUM_GRID), rest)
    scatter = float(np.sqrt(np.mean(fit.residual**2)))
    return trial.raw_force_n - fit.hum - fit.rest[0] + trial.force_info.preload_n, scatter


def _phase_span(moved: Array, start: int, top: int, low: float) -> tuple[int, int]:
    """Return first sample and end of a phase: from just after the last one with a way ``moved`` (n,) below ``low``,
    both m, between the samples ``start`` and ``top``, up to ``top``; refuse fewer than 30."""
    below = np.flatnonzero(moved[start:top] < low)
    first = start + (int(below[-1]) + 1 if below.size else 0)
    fewest = FEWEST_POINTS * FEWEST_SAMPLES
    if top - first < fewest:
        raise RigInputError(
            f"felt: a phase of {top - first} samples, allowed from {fewest}; press more slowly or harder"
        )
    return first, top


def _bin_means(span: tuple[int, int], *series: Array) -> tuple[Array, ...]:
    """Means of each series (n,) over equal times in ``span`` (first, end), and the samples of each, (bins,) each."""
    first, end = span
    bins = min(BINS, (end - first) // FEWEST_SAMPLES)
    edges = np.linspace(first, end, bins + 1).astype(int)
    size = np.diff(edges)
    return *(np.add.reduceat(one[:end], edges[:-1]) / size for one in series), size.astype(np.float64)
