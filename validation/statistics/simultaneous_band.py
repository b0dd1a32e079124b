"""Simultaneous 95 % band for the mean of a few curves: with that confidence the whole mean curve lies inside.

Conventions: curves are (n_samples, n_trials); half widths in the unit of the curves. Fewer than five trials give NaN
(three would need a factor of 136); curves that are equal everywhere give a band of zero width.
Source: random-field t. A curve of t values with ν degrees of freedom exceeds ±u somewhere with a probability of about
2·[P(T > u) + L/(2π)·(1 + u²/ν)^(−(ν−1)/2)] (expected Euler characteristic in one dimension, Worsley 1994; Adler and
Taylor 2007). L, the length of the curve in units of its own roughness, is the length of the path which the residuals
of all trials, scaled to unit length at each instant, describe on the sphere: free of bias for Gaussian curves whatever
the number of trials, and of any assumption that roughness or scatter stay the same along the curve (Taylor and
Worsley 2007). Where independent samples would bound u lower (rough curves), their bound is taken (Bonferroni).
Blows scatter in time as well (`time_scatter`): the band reaches wherever the mean curve comes when it is shifted as far
as trials are, and is nowhere narrower than the rounding of its samples. What this covers on the virtual bench:
`benchmarks/band_on_bench.py`. No band of a few trials knows what one blow in thirty does and none of them did.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtr, stdtrit

from validation.conventions import Array
from validation.statistics.time_scatter import reach_in_time, time_scatter

CONFIDENCE = 0.95
FEWEST_FOR_BAND = 5
LARGEST_U = 1e6
FEWEST_STEPS = 40  # of the path, however noisy the samples are
CLEAR_OF_NOISE = 4.0
ROUNDING = np.sqrt(6.0)  # a count, in standard deviations of a rounded sample less its rounded zero
CLEAR_SCATTER = 3.0  # times the noise of a sample: above it the scatter of a few trials is that of the trials


@dataclass(frozen=True)
class Band:
    """Mean curve, half width of its simultaneous band, and what the width came from.

    ``factor`` is the critical value u, ``length`` the roughness length L, ``n_trials`` the curves; the pointwise
    interval of Student's t would have the half width ``half_width · t/u`` where the values' scatter makes the band.
    """

    mean: Array
    half_width: Array
    factor: float
    length: float
    n_trials: int

    def covers(self, truth: Array) -> bool:
        """Whether a curve lies inside the band everywhere it is known."""
        off = np.abs(np.asarray(truth, dtype=float) - self.mean)
        known = np.isfinite(off) & np.isfinite(self.half_width)
        return bool(np.all(off[known] <= self.half_width[known]))


def exceedance(u: float, freedom: int, length: float) -> float:
    """Probability that a curve of t values leaves ±u somewhere (upper bound from its expected Euler characteristic)."""
    tail = float(stdtr(freedom, -u))
    return 2 * (tail + length / (2 * np.pi) * (1 + u * u / freedom) ** (-(freedom - 1) / 2))


def critical_value(freedom: int, length: float, n_samples: int, confidence: float = CONFIDENCE) -> float:
    """Critical value of a curve of t values.

    Parameters
    ----------
    freedom : int
        Degrees of freedom at each instant, number of trials − 1.
    length : float
        Roughness length of the curve.
    n_samples : int
        Samples of the curve: it cannot exceed more often than so many independent values.
    confidence : float

    Examples
    --------
    >>> round(critical_value(4, 0.0, 1), 3)  # a single value: Student's t
    2.776
    """
    alpha = 1 - confidence
    independent = float(-stdtrit(freedom, alpha / 2 / max(n_samples, 1)))
    if freedom < 2 or exceedance(LARGEST_U, freedom, length) >= alpha:
        return independent
    found = float(brentq(lambda u: exceedance(u, freedom, length) - alpha, 0.0, LARGEST_U, xtol=1e-9))
    return min(found, independent)


def roughness_length(residual: Array, u_sample: float = 0.0) -> float:
    """Length of the path of the residuals, scaled to unit length at each instant, on the sphere.

    White noise of the samples would make any path long, so the path is measured in steps long enough that the noise is
    the smaller part of them.

    Parameters
    ----------
    residual : (n_samples, n_trials) array
        Deviations from the mean; NaN rows are left out.
    u_sample : float
        Standard deviation of the white noise in one sample of one trial.
    """
    size = np.linalg.norm(residual, axis=1)
    unit = residual / size[:, None]
    n = residual.shape[1]
    # the noise of two samples, along the n − 2 directions in which the scaled residuals can move
    noise = 2 * (n - 2) * (u_sample / size) ** 2
    stride, longest = 1, max(residual.shape[0] // FEWEST_STEPS, 1)
    while True:
        square = ((unit[stride:] - unit[:-stride]) ** 2).sum(axis=1)
        part = 0.5 * (noise[stride:] + noise[:-stride])
        known = np.isfinite(square)
        if not known.any():
            return 0.0
        clear = np.median(square[known]) >= CLEAR_OF_NOISE * np.median(part[known])
        if clear or 2 * stride > longest:
            return float(np.sqrt(square[known]).sum() / stride)
        stride *= 2


def simultaneous_band(curves: Array, *, u_sample: float = 0.0, confidence: float = CONFIDENCE) -> Band:
    """Simultaneous band for the mean of curves that scatter in value and in time.

    Parameters
    ----------
    curves : (n_samples, n_trials) array
        Samples at which a trial is lost (NaN) have no band.
    u_sample : float
        Standard deviation of the white noise of one sample, for instance from the counts of an encoder.  Where the
        trials scatter by less than three times this, they add no roughness; nowhere is their scatter taken for smaller.
    confidence : float
    """
    values = np.asarray(curves, dtype=float)
    n_samples, n = values.shape
    mean, half = np.full(n_samples, np.nan), np.full(n_samples, np.nan)
    known = np.isfinite(values).all(axis=1)
    if n == 0 or not known.any():
        return Band(mean, half, float("nan"), float("nan"), n)
    mean[known] = values[known].mean(axis=1)
    if n < FEWEST_FOR_BAND:
        return Band(mean, half, float("nan"), float("nan"), n)
    residual = values[known] - mean[known, None]
    s = np.sqrt((residual**2).sum(axis=1) / (n - 1))
    scale = float(np.abs(values[known]).max())
    is_clear = s > max(CLEAR_SCATTER * u_sample, 1e-12 * scale)
    if not is_clear.any():
        half[known] = critical_value(n - 1, 0.0, 1, confidence) * u_sample / np.sqrt(n)
        return Band(mean, half, float("nan"), 0.0, n)
    path = np.full(values.shape, np.nan)
    path[np.flatnonzero(known)[is_clear]] = residual[is_clear]
    length = roughness_length(path, u_sample)
    factor = critical_value(n - 1, length, int(is_clear.sum()), confidence)
    of_values = factor * np.maximum(s, u_sample) / np.sqrt(n)
    of_times = reach_in_time(mean[known], time_scatter(values[known], u_sample), n)
    half[known] = np.maximum.reduce([of_values, of_times + u_sample, np.full(s.size, ROUNDING * u_sample)])
    return Band(mean, half, factor, length, n)
