"""Coverage of the whole true curve by the simultaneous 95 % band: 10,000 simulated sessions per line.

Curves are Gaussian.  ``even``: 200 samples, full width at half maximum of 20; ``rig-like``: the scatter grows tenfold
and the roughness fourfold along the curve, as after the impact of a blow; ``long``: 2,000 samples; ``counts``: whole
counts of an encoder.  The seed was fixed
before the first run.  Exit code 1 if a coverage lies outside 0.925 to 0.97.

    python -m benchmarks band_coverage [--sessions N]
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy import stats

from benchmarks.runner import Run, Table, interval
from validation.statistics.bands import repeatability_band

SEED = 18571
ALLOWED = (0.925, 0.97)


def smooth_curves(rng: np.random.Generator, shape: tuple[int, int], fwhm: float) -> np.ndarray:
    """Stationary Gaussian curves (n_samples, n) with unit variance and given smoothness, without edge effects."""
    sigma = fwhm / np.sqrt(4 * np.log(2))  # of the curve's derivative; white noise through a kernel of sigma/√2
    kernel_sigma = sigma / np.sqrt(2)
    reach = int(np.ceil(4 * kernel_sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / kernel_sigma) ** 2)
    kernel /= np.sqrt(np.sum(kernel**2))
    noise = rng.standard_normal((shape[0] + 2 * reach, shape[1]))
    size = 1 << int(np.ceil(np.log2(noise.shape[0] + kernel.size)))
    spectrum = np.fft.rfft(noise, size, axis=0) * np.fft.rfft(kernel, size)[:, None]
    return np.fft.irfft(spectrum, size, axis=0)[2 * reach : 2 * reach + shape[0]]


def even(rng: np.random.Generator, n: int) -> np.ndarray:
    return smooth_curves(rng, (200, n), 20.0)


def rig_like(rng: np.random.Generator, n: int) -> np.ndarray:
    whole = smooth_curves(rng, (400, n), 20.0)
    at = 399 * (0.4 * np.linspace(0, 1, 200) + 0.6 * np.linspace(0, 1, 200) ** 2.5)
    warped = np.column_stack([np.interp(at, np.arange(400), column) for column in whole.T])
    return warped * np.linspace(0.1, 1.0, 200)[:, None]


def long(rng: np.random.Generator, n: int) -> np.ndarray:
    return smooth_curves(rng, (2000, n), 60.0)


def counts(rng: np.random.Generator, n: int) -> np.ndarray:
    """Encoder readings: at rest for a fifth, then scatter growing to 30 counts; each trial has its own phase."""
    scatter = 30 * np.clip((np.linspace(0, 1, 1000) - 0.2) / 0.4, 0, 1) ** 2
    true = smooth_curves(rng, (1000, n), 40.0) * scatter[:, None]
    return np.floor(true + rng.uniform(0, 1, n))


KINDS = {"even": even, "rig-like": rig_like, "long": long, "counts": counts}
U_SAMPLE = {"counts": np.sqrt(2 / 12)}  # of a sample and of its zero, in counts


def coverage(kind: str, n: int, sessions: int) -> tuple[float, float, float, float]:
    """Share of sessions whose band contains the true mean (zero), its 95 % interval, and the median critical value."""
    rng = np.random.default_rng([SEED, n, list(KINDS).index(kind)])
    held, factors = 0, []
    for _ in range(sessions):
        band = repeatability_band(KINDS[kind](rng, n), u_sample=U_SAMPLE.get(kind, 0.0))
        held += band.covers(np.zeros(band.mean.size))
        factors.append(band.factor)
    return held / sessions, *interval(held, sessions), float(np.median(factors))


def main(run: Run) -> bool:
    """Print a row for each kind of curve and number of trials."""
    good = True
    table = Table("curves:>9s", "n:3d", "covered:.4f", "low:.4f", "high:.4f", "u (median):.2f", "t:6.2f", "outside:s")
    for kind, n in product(KINDS, (5, 10, 20)):
        share, low, high, factor = coverage(kind, n, run.sessions)
        inside = ALLOWED[0] <= share <= ALLOWED[1]
        inside |= run.quick and low <= ALLOWED[1] and high >= ALLOWED[0]  # too few to tell
        good &= inside
        table.row(kind, n, share, low, high, factor, stats.t.ppf(0.975, n - 1), "" if inside else "OUTSIDE")
    print(f"seed {SEED}; allowed {ALLOWED[0]} to {ALLOWED[1]}; 95 % intervals")
    return good
