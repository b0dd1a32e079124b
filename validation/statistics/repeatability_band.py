"""The 95 % repeatability band of the mean of a few curves.

With 95 % confidence the whole mean curve lies inside. Curves are (n_samples, n_trials); half
widths in the unit of the curves. Fewer than five trials give NaN (three would need a factor of 136); curves that are
equal everywhere give a band of zero width.
Source: random-field t. A curve of t values with ν degrees of freedom exceeds ±u somewhere with a probability of about
2·[P(T > u) + L/(2π)·(1 + u²/ν)^(−(ν−1)/2)] (expected Euler characteristic in one dimension, Worsley 1994; Adler and
Taylor 2007). L, the length of the curve in units of its own roughness, is the length of the path which the residuals
of all trials, scaled to unit length at each instant, describe on the sphere: free of bias for Gaussian curves whatever
the number of trials, and of any assumption that roughness or scatter stay the same along the curve (Taylor and
Worsley 2007). Where independent samples would bound u lower (rough curves), their bound is taken (Bonferroni).

Blows scatter in time as well: an event that comes later makes a step, so that the values of a few trials at one instant
are equal before it and far apart after it, and tell nothing of how far the mean may lie off. Their shift in time does:
near each instant it is the regression of a curve's deviation on the slope of the mean curve (registration to first
order). A shift counts where it explains the deviations, where the body moves (a hundredth of its largest speed, clear
of rounding), and where it is shorter than half of the time the body takes at its fastest: a longer one is not told from
a difference in value. What is found of the curves smoothed over three times as long counts where it is more: a short
bounce is over sooner than its time scatters. Delays are not made good before the action rests: the variance over time
is the non-decreasing one nearest to what is found at each instant, weighted with the squared slope, so that what looks
like a delay of slow creeping yields to what the next fast motion shows. The band reaches wherever the mean curve comes
when it is shifted by as much as a further trial's shift may be (prediction interval of Student's t), since one trial in
some that comes early has its part in the mean, and is nowhere narrower than the rounding of its samples. What this
covers on the virtual bench: benchmark `band_on_bench`. No band of a few trials knows what one blow in thirty does and
none of them did.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d, maximum_filter1d
from scipy.optimize import brentq, isotonic_regression
from scipy.special import stdtr, stdtrit

from validation.conventions import CONFIDENCE, Array

WINDOW = 1 / 6  # of the time in which the mean curve would cover its range at its largest speed
LONGEST = 0.5  # of the same time: a longer shift is not told from a difference in value
SCALES = (1, 3)  # times that time, over which the curves are smoothed (1: not)
MOVES = 0.01  # of the largest speed
EXPLAINED = 0.4  # of the squared deviations near an instant; half is what shifts explain of sharp steps
CLEAR = 3.0  # times the noise of its samples: above it a slope is the motion's, and the scatter of trials is theirs
IS_MOTION = 10.0  # times the variance of the mean's slope, all along: below, the mean is what is left of the scatter
TIME_CONFIDENCE = 0.98  # for a further trial; with it the band of the mean covers about 95 % on the virtual bench
ROUND_SAMPLES = 0.05  # to which shifts are rounded: a twentieth of a sample


def estimate_time_scatter(curves: Array, u_sample: float = 0.0) -> Array:
    """Standard deviation (n_samples,), in samples, of the trials' shifts in time of ``curves`` (n_samples, n_trials),
    not decreasing along the curve, 0 where none is found; ``u_sample``: noise of one sample, unit of the curves."""
    mean = curves.mean(axis=1)
    fastest = float(np.abs(np.gradient(mean)).max())
    if not fastest > 0:
        return np.zeros(len(mean))
    variance, weight = np.zeros((2, len(mean)))
    for scale in SCALES:
        way = scale * float(np.ptp(mean)) / fastest
        half = int(np.clip(round(WINDOW * way), 2, max(len(mean) // 4, 2)))
        window = np.hanning(2 * half + 3)[1:-1]
        window /= window.sum()
        smooth = curves if scale == 1 else convolve1d(curves, window, axis=0, mode="nearest")
        noise = u_sample * (1.0 if scale == 1 else float(np.linalg.norm(window)))
        shift, power = _estimate_shifts(smooth, noise, way, window)
        variance, weight = np.maximum(variance, shift**2), np.maximum(weight, power)
    told = np.flatnonzero(weight)
    if not told.size:
        return variance
    grown = np.sqrt(isotonic_regression(variance[told], weights=weight[told]).x)
    return np.concatenate([np.zeros(told[0]), np.repeat(grown, np.diff(np.append(told, len(mean))))])


def _estimate_shifts(curves: Array, u_sample: float, rise_samples: float, window: Array) -> tuple[Array, Array]:
    """Standard deviation (n_samples,), in samples, of the trials' shifts near each sample, and its weight, the squared
    slope; 0 where none is detectable or it exceeds half of ``rise_samples``. ``window`` (k,): weights of neighbouring
    samples, of sum 1."""
    n_samples, n = curves.shape
    mean = curves.mean(axis=1)
    slope = np.gradient(mean)
    deviation = curves - mean[:, None]
    of_slope = float(np.square(np.gradient(deviation, axis=0)).sum()) / (n * (n - 1))
    if not float(slope @ slope) > IS_MOTION * of_slope:
        return np.zeros(n_samples), np.zeros(n_samples)

    def near(values: Array) -> Array:
        return np.asarray(convolve1d(values, window, axis=0, mode="constant"))

    common = near(slope[:, None] * deviation)
    power = near(slope**2)
    moving = power > max((CLEAR * u_sample / (len(window) // 2)) ** 2, (MOVES**2) * float(power.max()))
    shift = common / np.where(power > 0, power, np.inf)[:, None]
    s = np.sqrt(np.square(shift - shift.mean(axis=1, keepdims=True)).sum(axis=1) / (n - 1))
    explained = np.square(common).sum(axis=1) > EXPLAINED * power * near(np.square(deviation).sum(axis=1))
    told = moving & explained & (s < LONGEST * rise_samples)
    return np.where(told, s, 0.0), np.where(told, power, 0.0)


def extend_in_time(mean: Array, scatter: Array, n_trials: int) -> Array:
    """Largest change (n_samples,), 0 or more, of a curve ``mean`` (n_samples,) when it is shifted in time by as much as
    a further trial may be; ``scatter`` (n_samples,): standard deviation of the shifts of ``n_trials``, in samples."""
    factor = float(stdtrit(n_trials - 1, 0.5 + TIME_CONFIDENCE / 2)) * np.sqrt(1 + 1 / n_trials)
    # rounding keeps the number of different reaches small
    rounded = np.round(scatter / ROUND_SAMPLES) * ROUND_SAMPLES
    reach = np.minimum(np.round(factor * rounded), mean.size).astype(int)
    upper, lower = mean.copy(), -mean
    edges = np.flatnonzero(np.diff(reach)) + 1
    for first, last in zip(np.r_[0, edges], np.r_[edges, mean.size], strict=True):
        by = int(reach[first])
        if by == 0:
            continue
        there = slice(max(0, first - by), min(mean.size, last + by))
        for most, sign in ((upper, 1.0), (lower, -1.0)):
            part = np.full(there.stop - there.start, -np.inf)
            part[first - there.start : last - there.start] = sign * mean[first:last]
            shifted = maximum_filter1d(part, 2 * by + 1, mode="constant", cval=-np.inf)
            np.maximum(most[there], shifted, out=most[there])
    return np.asarray(np.maximum(upper - mean, lower + mean))


FEWEST_FOR_BAND = 5  # trials: three would need a factor of 136
LARGEST_U = 1e6  # beyond any factor that is used
FEWEST_STEPS = 40  # of the path, however noisy the samples are
CLEAR_OF_NOISE = 4.0  # squared step over that of noise alone: a length is then long by a seventh at most
ROUNDING = np.sqrt(6.0)  # a count, in standard deviations of a rounded sample less its rounded zero


@dataclass(frozen=True)
class RepeatabilityBand:
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
        """Whether a curve (m,), rad, lies inside the band at every sample that has one."""
        off = np.abs(np.asarray(truth, dtype=float) - self.mean)
        known = np.isfinite(off) & np.isfinite(self.half_width)
        return bool(np.all(off[known] <= self.half_width[known]))


def exceedance(u: float, freedom: int, length: float) -> float:
    """Probability that a curve of t values leaves ±u somewhere (upper bound from its expected Euler characteristic)."""
    tail = float(stdtr(freedom, -u))
    return 2 * (tail + length / (2 * np.pi) * (1 + u * u / freedom) ** (-(freedom - 1) / 2))


def critical_value(freedom: int, length: float, n_samples: int, confidence: float = CONFIDENCE) -> float:
    """Value that the magnitude of a curve of Student's t with ``freedom`` degrees of freedom exceeds somewhere with
    probability 1 − ``confidence``; ``length``: its `roughness_length`, ``n_samples``: number of its samples.

    Parameters
    ----------
    freedom : degrees of freedom at each instant, number of trials − 1
    length : roughness length of the curve
    n_samples : samples of the curve: it cannot exceed more often than so many independent values
    """
    alpha = 1 - confidence
    independent = float(-stdtrit(freedom, alpha / 2 / max(n_samples, 1)))
    if freedom < 2 or exceedance(LARGEST_U, freedom, length) >= alpha:
        return independent
    found = float(brentq(lambda u: exceedance(u, freedom, length) - alpha, 0.0, LARGEST_U, xtol=1e-9))
    return min(found, independent)


def roughness_length(residual: Array, u_sample: float = 0.0) -> float:
    """Length of the path, rad, that the ``residual`` (n_samples, n_trials), scaled to unit length at each sample,
    describes on the sphere, in steps in which white noise of ``u_sample`` a sample is the smaller part; NaN rows are
    skipped.

    White noise of the samples would make any path long, so the path is measured in steps long enough that the noise is
    the smaller part of them.

    Parameters
    ----------
    residual : (n_samples, n_trials), deviations from the mean; NaN rows are left out
    u_sample : standard deviation of the white noise in one sample of one trial
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


def repeatability_band(curves: Array, *, u_sample: float = 0.0) -> RepeatabilityBand:
    """Simultaneous 95 % band for the mean of ``curves`` (n_samples, n_trials), which scatter in value and in time;
    ``u_sample``: noise of one sample, unit of the curves. NaN where a trial is lost, everywhere with fewer than five.

    Parameters
    ----------
    curves : (n_samples, n_trials), samples at which a trial is lost (NaN) have no band
    u_sample : standard deviation of the white noise of one sample, for instance from the counts of an encoder.  Where
        the trials scatter by less than three times this, they add no roughness; nowhere is their scatter taken for
        smaller.
    """
    values = np.asarray(curves, dtype=float)
    n_samples, n = values.shape
    mean, half = np.full(n_samples, np.nan), np.full(n_samples, np.nan)
    known = np.isfinite(values).all(axis=1)
    if n == 0 or not known.any():
        return RepeatabilityBand(mean, half, float("nan"), float("nan"), n)
    mean[known] = values[known].mean(axis=1)
    if n < FEWEST_FOR_BAND:
        return RepeatabilityBand(mean, half, float("nan"), float("nan"), n)
    residual = values[known] - mean[known, None]
    s = np.sqrt((residual**2).sum(axis=1) / (n - 1))
    scale = float(np.abs(values[known]).max())
    is_clear = s > max(CLEAR * u_sample, 1e-12 * scale)
    if not is_clear.any():
        half[known] = critical_value(n - 1, 0.0, 1) * u_sample / np.sqrt(n)
        return RepeatabilityBand(mean, half, float("nan"), 0.0, n)
    path = np.full(values.shape, np.nan)
    path[np.flatnonzero(known)[is_clear]] = residual[is_clear]
    length = roughness_length(path, u_sample)
    factor = critical_value(n - 1, length, int(is_clear.sum()))
    of_values = factor * np.maximum(s, u_sample) / np.sqrt(n)
    of_times = extend_in_time(mean[known], estimate_time_scatter(values[known], u_sample), n)
    half[known] = np.maximum.reduce([of_values, of_times + u_sample, np.full(s.size, ROUNDING * u_sample)])
    return RepeatabilityBand(mean, half, factor, length, n)
